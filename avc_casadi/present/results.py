"""What a result prints from Python: the page that its command prints on a terminal."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

from avc_casadi.files.catalogue import catalogue_names
from avc_casadi.present.pages.bilateral import bilateral_page
from avc_casadi.present.pages.recommendation import recommendation_page
from avc_casadi.present.pages.virtual_tool import tool_page
from avc_casadi.present.terminal import Page

if TYPE_CHECKING:
    from avc_casadi.recommendation.bilateral import BilateralRecommendation
    from avc_casadi.recommendation.recommend import Recommendation
    from avc_casadi.recommendation.virtual_tool import ToolRecommendation

    Result = Recommendation | ToolRecommendation | BilateralRecommendation


def text_of(result: Result) -> str:
    """Return a recommendation as `avc recommend` prints it."""
    problem = result.problem
    shown = problem.name if problem.name in catalogue_names() else f"{problem.name or 'problem'}.toml"
    page = (
        tool_page
        if problem.simulation is not None
        else bilateral_page
        if problem.follower is not None
        else recommendation_page
    )
    return page(result.document(), problem, Page(), shown)


def html_of(result: Result) -> str:
    """Return the same for a notebook."""
    return f"<pre>{escape(text_of(result))}</pre>"
