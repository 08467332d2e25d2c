"""Self-contained HTML reports: a verdict, and sections of rows and figures in one frame."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Any

from avc_casadi._util.text import number
from avc_casadi.paper.errata import ASSUMPTIONS, PAPER_ERRORS
from avc_casadi.present.figures.style import files_of
from avc_casadi.present.row import Row, row
from avc_casadi.present.rows.design import comparison, gain_rows
from avc_casadi.present.rows.judge import levels, passivity, stability
from avc_casadi.present.rows.recommend import verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from avc_casadi._util.progress import Progress
    from avc_casadi._util.units import Units
    from avc_casadi.design.comparison.comparison import Comparison
    from avc_casadi.diagnose.causes import Diagnosis
    from avc_casadi.identification.device import Identification
    from avc_casadi.model.problem import Problem
    from avc_casadi.present.row import Answer
    from avc_casadi.recommendation.deployed import Deployed
    from avc_casadi.recommendation.recommendation import Recommendation

# Rows of the first screen.
_FIRST = 10
_OF_WALL = {
    "rendered": "Rendered against wanted: stiffness by sinusoidal excitation, and simulated hands that press.",
    "loop": "The loop opened at the actuator, with its margins, and the impact on the wall in the linear loop.",
}
_OF_PAPER = {
    "perceived": "Perceived impedance between the bounds that feel real, Re Z that (12) constrains, and the gains.",
    "comparison": "Errors of the methods and the verdict at each frequency.",
}


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
        return (
            f'<figure><div class="wide" tabindex="0" role="region" aria-label="{caption}">'
            f'<img src="{source}" alt="{caption}"></div><figcaption>{caption}</figcaption></figure>'
        )


@dataclass(frozen=True)
class Section:
    """A part of a report: a heading, a sentence, figures and rows; folded up at first where it holds details."""

    title: str
    rows: Sequence[Row] = ()
    pictures: Sequence[Picture] = ()
    text: str = ""
    folded: bool = False

    def html(self, units: Units) -> str:
        """Return it as HTML."""
        text = f"<p>{escape(self.text)}</p>" if self.text else ""
        body = "\n".join([text, *(one.html() for one in self.pictures), _rows_html(self.title, self.rows, units)])
        if self.folded:
            return f"<details>\n<summary>{escape(self.title)}</summary>\n{body}\n</details>"
        return f"<h2>{escape(self.title)}</h2>\n{body}"


def _rows_html(title: str, rows: Iterable[Row], units: Units) -> str:
    lines = [
        f'<tr><td class="{one.mark.name.lower()}">{escape(one.label)}</td><td>{escape(one.text(units))}</td></tr>'
        for one in rows
    ]
    if not lines:
        return ""
    return (
        f'<div class="wide" tabindex="0" role="region" aria-label="{escape(title)}">\n'
        f"<table>{''.join(lines)}</table></div>"
    )


def page_html(
    title: str,
    source: str,
    said: tuple[str, bool],
    sections: Iterable[Section],
    units: Units,
    versions: Mapping[str, str],
) -> str:
    """Return a page: its title and source, a verdict and whether that is a yes, its sections, and the versions."""
    text, good = said
    parts = [f'<p class="verdict {"pass" if good else "fail"}">{escape(text)}</p>']
    parts += [one.html(units) for one in sections]
    made = _rows_html("versions", (row(name, version) for name, version in versions.items()), units)
    frame = Template(Path(__file__).with_suffix(".html").read_text(encoding="utf-8"))
    body = "\n\n".join(parts)
    return frame.substitute(title=escape(title), source=escape(source), body=body, versions=made)


def report_html(
    answer: Answer,
    problem: Problem,
    pictures: Sequence[Picture],
    versions: Mapping[str, str],
    more: Sequence[Section] = (),
) -> str:
    """Return the report of a recommendation: verdict, one picture and ten rows first, then the rest of it."""
    shown = [one for one in answer.rows if one.rank == 0 and one.label != "Written"]
    details = [one for one in answer.rows if one.rank > 0]
    certificate = answer.data["certificate"] or {}
    claims: list[Row] = levels(certificate.get("levels", {}))
    if problem.simulation is not None and certificate:
        claims = stability(certificate)
        if problem.simulation.tool_mass_kg is not None:
            claims += passivity(certificate["passivity"], problem)
    settings = [
        row(problem.units.key(key), text)
        for key, text in _settings(problem.model_dump(exclude={"name", "title", "source"}))
    ]
    sections = [
        Section("What to deploy", shown[:_FIRST], pictures[:1]),
        Section("Margins and time responses", shown[_FIRST:], pictures[1:]),
        *more,
        Section("Details", details, folded=True),
        *([Section("Certificate", claims, folded=True)] if claims else []),
        Section("Problem: every value of it", settings, folded=True),
    ]
    title = ": ".join(filter(None, (problem.name, problem.title)))
    said = verdict(answer.data, shown)
    return page_html(
        title, problem.source, said, [one for one in sections if one.rows or one.pictures], problem.units, versions
    )


def paper_sections(
    data: Mapping[str, Any],
    certificate: Mapping[str, Any],
    problem: Problem,
    drawn: Mapping[str, Picture],
    question: Sequence[Row],
) -> list[Section]:
    """Return the paper's question: closed form, CasADi and the exact optimum, and what the comparison is made of."""
    text = "Which gains keep each frequency passive and feel real? They are for comparison, not for a hand."
    delivered = data["methods"][data["delivered"]]
    every = gain_rows(delivered, len(data["frequency_hz"]))
    errors = [
        row(one.equation, f"printed {one.as_printed}; correct {one.correct}; effect: {one.effect}")
        for one in PAPER_ERRORS
    ]
    return [
        Section("The paper's question", question, list(drawn.values()), text),
        Section("Comparison of the methods", comparison(data, problem).rows, folded=True),
        Section(f"Certificate of the gains of {data['delivered']}", levels(certificate["levels"]), folded=True),
        Section(f"Gains: all rows of {data['delivered']}", every, folded=True),
        Section("What is assumed", [row(one.what, str(one.assumed)) for one in ASSUMPTIONS], folded=True),
        Section("Errors of the printed paper", errors, folded=True),
    ]


def wall_pictures(found: Recommendation) -> dict[str, Picture]:
    """Return the figures of a coupling to a wall; none without one."""
    from avc_casadi.present.figures.deployed import draw_loop, draw_rendered  # noqa: PLC0415 - likewise
    from avc_casadi.recommendation.deployed import deployed  # noqa: PLC0415 - likewise

    if found.coupling is None or found.coupling.end != "wall":
        return {}
    responses = deployed(found.coupling)
    draws: dict[str, Callable[[Deployed], Figure]] = {"rendered": draw_rendered, "loop": draw_loop}
    return {name: Picture.of(draw(responses), _OF_WALL[name]) for name, draw in draws.items()}


def paper_pictures(found: Comparison) -> dict[str, Picture]:
    """Return the figures of the paper's question."""
    from avc_casadi.present.figures.comparison import draw_comparison  # noqa: PLC0415 - as above
    from avc_casadi.present.figures.perceived import draw_perceived  # noqa: PLC0415 - as above

    draws: dict[str, Callable[[Comparison], Figure]] = {"perceived": draw_perceived, "comparison": draw_comparison}
    return {name: Picture.of(draw(found), _OF_PAPER[name]) for name, draw in draws.items()}


def pair_pictures(found: Recommendation, progress: Progress) -> dict[str, Picture]:
    """Return the figures of a coupling to another end: the rendering, and of a simulation the stable couplings."""
    from dataclasses import replace  # noqa: PLC0415 - as above

    from avc_casadi.design.tool_region import tool_region  # noqa: PLC0415 - as above
    from avc_casadi.present.figures.tool_impedance import draw_rendered_impedance  # noqa: PLC0415 - as above
    from avc_casadi.present.figures.tool_region import draw_tool_region  # noqa: PLC0415 - as above
    from avc_casadi.recommendation.tool_impedance import rendered_band  # noqa: PLC0415 - as above

    drawn, coupling = {}, found.coupling
    gains = None if coupling is None else coupling.gains
    if gains is not None:
        band = rendered_band(found.problem, gains)
        caption = "Rendered against wanted: device and other end as one body, and the coupling's spring."
        drawn["rendered"] = Picture.of(draw_rendered_impedance(band), caption)
    if found.problem.simulation is not None:
        region = replace(tool_region(found.problem, progress), chosen=gains)
        caption = "Springs and dampers that are stable with every corner hand, tool and contact, by engine rate."
        drawn["region"] = Picture.of(draw_tool_region(region), caption)
    return drawn


def _settings(table: Mapping[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    """Return every value of nested tables beside its dotted key, without those not given."""
    rows = []
    for key, value in table.items():
        if isinstance(value, Mapping):
            rows += _settings(value, f"{prefix}{key}.")
        elif value is not None:
            rows.append((f"{prefix}{key}", _value(value)))
    return rows


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list | tuple):
        return ", ".join(map(_value, value)) or "none"
    return number(value) if isinstance(value, float) else str(value)


def identification_html(answer: Answer, found: Identification, versions: Mapping[str, str]) -> str:
    """Return the report of an identification: its rows, log and model side by side, and the device file."""
    from avc_casadi.identification.device import device_text  # noqa: PLC0415 - SciPy, which no other page needs
    from avc_casadi.present.figures.identification import draw_identification  # noqa: PLC0415

    caption = (
        "The model on the commanded input, held near by a slow observer (a, b); frequency response "
        "where input and motion are coherent (c, d); intervals (e); prediction error, white inside the grey band (f)"
    )
    pictures = [Picture.of(draw_identification(found), caption)]
    text = "no device file: see the rows" if found.device is None else device_text(found.device)
    shown_rows = [one for one in answer.rows if one.rank == 0]
    sections = [
        Section("What the logs show", shown_rows, pictures),
        Section("Evidence", [one for one in answer.rows if one.rank > 0]),
        Section(
            "Device file", [row(f"{place + 1}", line) for place, line in enumerate(text.splitlines())], folded=True
        ),
    ]
    source = f"{', '.join(found.sources)}: {number(found.seconds, 3)} s at {number(1 / found.sample_time_s)} Hz"
    title = "Device identified from its log" if found.device is None else found.device.title
    said = (f"{sum(one.identified for one in found.estimates.values())} values identified.", found.device is not None)
    return page_html(title, source, said, sections, answer.units, versions)


def diagnosis_html(answer: Answer, found: Sequence[Diagnosis], versions: Mapping[str, str]) -> str:
    """Return the report of a diagnosis: its rows, and a picture of each log."""
    from avc_casadi.present.figures.diagnosis import draw_diagnosis  # noqa: PLC0415 - as above
    from avc_casadi.present.rows.measure import diagnosis  # noqa: PLC0415 - as above

    sections = []
    for one in found:
        caption = f"{one.log.name}: the grey stretch is the oscillation, the force against position is of its middle"
        rows = diagnosis(answer.data, [one], "", ()).rows
        sections.append(Section(one.log.name, rows, [Picture.of(draw_diagnosis(one), caption)]))
    title = "Diagnosis of a log" if len(found) == 1 else f"Diagnosis of {len(found)} logs"
    said = ("; ".join(one.conclusion for one in found), all(one.verdict == "nothing wrong" for one in found))
    return page_html(title, ", ".join(one.log.name for one in found), said, sections, answer.units, versions)
