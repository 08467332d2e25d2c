"""Self-contained HTML reports: a verdict, and sections of rows and figures in one frame."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from string import Template

from matplotlib.figure import Figure

from avc_casadi._util.units import Units
from avc_casadi.claims.levels import read_levels
from avc_casadi.design.comparison.comparison import Comparison
from avc_casadi.files.problem_file import dump_problem
from avc_casadi.paper.errata import ASSUMPTIONS, PAPER_ERRORS
from avc_casadi.present.figures.deployed import draw_loop, draw_rendered
from avc_casadi.present.figures.paper import draw_comparison, draw_perceived
from avc_casadi.present.figures.style import files_of
from avc_casadi.present.row import Answer, Row, row
from avc_casadi.present.rows.design import comparison, printed_errors
from avc_casadi.present.rows.judge import levels
from avc_casadi.present.rows.recommend import verdict
from avc_casadi.recommendation.recommendation import Recommendation
from avc_casadi.recommendation.rendered import deployed


@dataclass(frozen=True)
class Picture:
    """A figure for a page, with its caption, which is also its alternative text."""

    caption: str
    png: bytes
    svg: bytes

    @classmethod
    def of(cls, figure: Figure, caption: str) -> Picture:
        """Return a figure as the contents of its files."""
        return cls(caption, *files_of(figure, "png", "svg"))

    def html(self) -> str:
        """Return the figure with its picture inside."""
        source = f"data:image/svg+xml;base64,{base64.b64encode(self.svg).decode()}"
        caption = escape(self.caption)
        picture = _wide(self.caption, f'<img src="{source}" alt="{caption}">')
        return f"<figure>{picture}<figcaption>{caption}</figcaption></figure>"


@dataclass(frozen=True)
class Section:
    """A part of a report: a heading, a sentence, figures, rows, a file; folded up at first where it holds details."""

    title: str
    rows: Sequence[Row] = ()
    pictures: Sequence[Picture] = ()
    text: str = ""
    folded: bool = False
    file: str = ""

    def html(self, units: Units) -> str:
        """Return it as HTML."""
        text = f"<p>{escape(self.text)}</p>" if self.text else ""
        file = _wide(self.title, f"<pre>{escape(self.file)}</pre>") if self.file else ""
        body = "\n".join(
            [text, *(picture.html() for picture in self.pictures), _table(self.title, self.rows, units), file]
        )
        if self.folded:
            return f"<details>\n<summary>{escape(self.title)}</summary>\n{body}\n</details>"
        return f"<h2>{escape(self.title)}</h2>\n{body}"


def _wide(name: str, content: str) -> str:
    """Return content that a narrow screen moves sideways, by the keyboard too."""
    return f'<div class="wide" tabindex="0" role="region" aria-label="{escape(name)}">{content}</div>'


def _table(title: str, rows: Iterable[Row], units: Units) -> str:
    lines = [
        f'<tr><td class="{shown.mark.name.lower()}">{escape(shown.name(units))}</td>'
        f"<td>{escape(shown.text(units))}</td></tr>"
        for shown in rows
    ]
    return _wide(title, f"<table>{''.join(lines)}</table>") if lines else ""


def report_html(
    answer: Answer,
    recommended: Recommendation,
    pictures: Sequence[Picture],
    versions: Mapping[str, str],
    more: Sequence[Section] = (),
) -> str:
    """Return the report of a recommendation: verdict, one picture and ten rows first, then the rest of it."""
    shown = [line for line in answer.rows if line.rank == 0]
    problem = recommended.problem
    units = problem.units
    claims = levels(read_levels(recommended.certificate or {}))
    sections = [
        Section("What to deploy", shown[:10], pictures[:1]),
        Section("Margins and time responses", shown[10:], pictures[1:]),
        *more,
        Section("Details", [line for line in answer.rows if line.rank > 0], folded=True),
        Section("Certificate", claims, folded=True),
        Section("Problem file", file=dump_problem(problem), folded=True),
    ]
    text, good = verdict(recommended, shown)
    body = [f'<p class="verdict {"pass" if good else "fail"}">{escape(text)}</p>']
    body += [section.html(units) for section in sections if section.rows or section.pictures or section.file]
    made = _table("versions", (row(name, version) for name, version in versions.items()), units)
    title = ": ".join(filter(None, (problem.name, problem.title)))
    frame = Template(Path(__file__).with_suffix(".html").read_text(encoding="utf-8"))
    values = {"title": escape(title), "source": escape(problem.source), "versions": made}
    return frame.substitute(values, body="\n\n".join(body))


def paper_sections(compared: Comparison, drawn: Mapping[str, Picture], pushed: Row) -> list[Section]:
    """Return the paper's question: the methods side by side, and what the comparison is made of."""
    text = "Which gains keep each frequency passive and feel real? They are for comparison, not for a hand."
    errors = printed_errors(PAPER_ERRORS)
    question = [*comparison(compared).rows, pushed]
    return [
        Section("The paper's question", question, list(drawn.values()), text),
        Section("What is assumed", [row(subject, assumed) for subject, assumed in ASSUMPTIONS], folded=True),
        Section("Errors of the printed paper", errors, folded=True),
    ]


def wall_pictures(recommended: Recommendation) -> dict[str, Picture]:
    """Return the figures of a coupling to a wall; none without one."""
    if recommended.coupling is None:
        return {}
    responses = deployed(recommended.coupling)
    rendered = "Rendered against wanted: stiffness by sinusoidal excitation, and simulated hands that press."
    loop = "The loop opened at the actuator, with its margins, and the impact on the wall in the linear loop."
    return {
        "rendered": Picture.of(draw_rendered(responses), rendered),
        "loop": Picture.of(draw_loop(responses), loop),
    }


def paper_pictures(compared: Comparison) -> dict[str, Picture]:
    """Return the figures of the paper's question."""
    perceived = "Perceived impedance between the bounds that feel real, Re Z that (12) constrains, and the gains."
    errors = "Errors of the methods at each frequency."
    return {
        "perceived": Picture.of(draw_perceived(compared), perceived),
        "comparison": Picture.of(draw_comparison(compared), errors),
    }
