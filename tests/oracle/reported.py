"""The report of a run before a wall, without its files."""

import avc_casadi as avc
from avc_casadi.present.report import paper_pictures, paper_sections, report_html, wall_pictures
from avc_casadi.present.rows.deploy import pushed
from avc_casadi.present.rows.recommend import recommendation


def report_of(problem, push, hands=10):
    """The page, with the result of a push."""
    found, comparison = avc.recommend(problem, hands=hands), avc.compare(problem)
    drawn = paper_pictures(comparison)
    more = paper_sections(comparison, drawn, pushed(push))
    pictures = list(wall_pictures(found).values())
    return report_html(recommendation(found), found, pictures, {"avc-casadi": avc.__version__}, more)
