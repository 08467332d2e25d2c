"""Self-contained HTML reports: a verdict, and sections of rows and figures in one frame."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from string import Template

from avc_casadi._util.units import Units
from avc_casadi.claims.deployable import DeployedCertificate
from avc_casadi.design.comparison.comparison import Comparison
from avc_casadi.files.problem_file import dump_problem
from avc_casadi.paper.errata import ASSUMPTIONS, PAPER_ERRORS
from avc_casadi.present.figures.deployed import opened_loop, rendered
from avc_casadi.present.figures.paper import errors, perceived
from avc_casadi.present.figures.style import Drawing, files_of
from avc_casadi.present.row import Answer, Mark, Row, grade, row
from avc_casadi.present.rows.design import comparison, printed_errors
from avc_casadi.present.rows.judge import levels
from avc_casadi.present.rows.recommend import ringing, verdict
from avc_casadi.recommendation.recommendation import Recommendation
from avc_casadi.recommendation.rendered import deployed


@dataclass(frozen=True)
class PanelPicture:
    """A panel of a picture alone, with its title."""

    title: str
    svg: bytes


@dataclass(frozen=True)
class Picture:
    """A drawing with its caption: as files, and its panels alone for a page that is as wide as it happens to be."""

    caption: str
    png: bytes
    svg: bytes
    panels: tuple[PanelPicture, ...]

    @classmethod
    def of(cls, drawing: Drawing, caption: str) -> Picture:
        """Return a drawing as the contents of its files."""
        png, svg = files_of(drawing.figure(), "png", "svg")
        panels = (PanelPicture(panel.title, files_of(panel.figure, "svg")[0]) for panel in drawing.panels())
        return cls(caption, png, svg, tuple(panels))

    def html(self) -> str:
        """Return the panels, each with its title, which is also its alternative text, under the caption."""
        panels = []
        for panel in self.panels:
            source = f"data:image/svg+xml;base64,{base64.b64encode(panel.svg).decode()}"
            title = escape(panel.title)
            picture = f'<img src="{source}" alt="{title}">'
            panels.append(f"<figure><figcaption>{title}</figcaption>{picture}</figure>")
        return f'<p class="caption">{escape(self.caption)}</p>\n<div class="panels">{"".join(panels)}</div>'


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
        # Rows first: on a narrow screen they stand above the pictures, on a wide one next to them.
        table = _table(self.title, self.rows, units)
        pictures = "\n".join(picture.html() for picture in self.pictures)
        body = "\n".join([text, f'<div class="sides">{table}<div>{pictures}</div></div>' if pictures else table, file])
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
    """Return the report of a recommendation: verdict, ten rows and one picture first, then the rest of it."""
    shown = [line for line in answer.rows if line.rank == 0]
    problem = recommended.problem
    units = problem.units
    certificate = recommended.certificate
    claims = levels(certificate.certificate.levels) if isinstance(certificate, DeployedCertificate) else []
    sections = [
        Section("What to deploy", shown[:10], pictures[:1]),
        Section("Margins and time responses", shown[10:], pictures[1:]),
        *more,
        Section("Details", [line for line in answer.rows if line.rank > 0], folded=True),
        Section("Certificate", claims, folded=True),
        Section("Problem file", file=dump_problem(problem), folded=True),
    ]
    text, good = verdict(recommended, shown)
    mark = grade(good and not ringing(shown), Mark.CAUTION if good else Mark.FAIL)
    body = [f'<p class="verdict {mark.name.lower()}">{escape(text)}</p>']
    body += [section.html(units) for section in sections if section.rows or section.pictures or section.file]
    made = _table("versions", (row(name, version) for name, version in versions.items()), units)
    title = ": ".join(filter(None, (problem.name, problem.title)))
    frame = Template(Path(__file__).with_suffix(".html").read_text(encoding="utf-8"))
    values = {"title": escape(title), "source": escape(problem.source), "versions": made}
    return frame.substitute(values, body="\n\n".join(body))


def paper_sections(compared: Comparison, drawn: Mapping[str, Picture], pushed: Row) -> list[Section]:
    """Return what became of the push, and folded the paper's question, which a deployer does not need."""
    text = "Which gains keep each frequency passive and feel real? These gains are for comparison, not for a hand."
    question = comparison(compared).rows
    return [
        Section("Push to the device", [pushed]),
        Section("The paper's question", question, list(drawn.values()), text, folded=True),
        Section("What is assumed", [row(subject, assumed) for subject, assumed in ASSUMPTIONS], folded=True),
        Section("Errors of the printed paper", printed_errors(PAPER_ERRORS), folded=True),
    ]


def wall_pictures(recommended: Recommendation) -> dict[str, Picture]:
    """Return the figures of a coupling to a wall; none without one."""
    if recommended.coupling is None:
        return {}
    responses = deployed(recommended.coupling)
    felt = "Rendered and required stiffness of the wall, for a sine of the handle and for simulated hands that press."
    loop = "The control loop, opened at the actuator, with its margins, and an impact on the wall in the linear loop."
    return {"rendered": Picture.of(rendered(responses), felt), "loop": Picture.of(opened_loop(responses), loop)}


def paper_pictures(compared: Comparison) -> dict[str, Picture]:
    """Return the figures of the paper's question."""
    felt = "Perceived impedance between the bounds that feel real, Re Z (0 or more if passive), and the gains."
    of_methods = "Impedance errors of the paper's methods at each frequency."
    return {
        "perceived": Picture.of(perceived(compared), felt),
        "comparison": Picture.of(errors(compared), of_methods),
    }
