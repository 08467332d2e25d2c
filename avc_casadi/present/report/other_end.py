"""The report of a coupling to a simulation or a second device: what to deploy first, then the details."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

from avc_casadi._util.text import quantity
from avc_casadi.present.pages.bilateral import bilateral_rows
from avc_casadi.present.pages.tool_claims import passivity_rows, stability_rows
from avc_casadi.present.pages.virtual_tool import tool_rows
from avc_casadi.present.report.frame import Picture, columns_html, filled, items_html, page_html, rows_html, settings
from avc_casadi.present.terminal import Mark

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem
    from avc_casadi.present.terminal import Row


def other_end_rows(document: dict[str, Any], problem: Problem) -> list[Row]:
    """Return the rows of the `recommend` document.

    Args:
        document: of `avc recommend --json`.
        problem: with [simulation] or [follower].
    """
    return tool_rows(document, problem) if problem.follower is None else bilateral_rows(document, problem)


def other_end_html(
    document: dict[str, Any], problem: Problem, figures: Sequence[Picture], versions: Mapping[str, str]
) -> str:
    """Return the self-contained page.

    Args:
        document: of `avc recommend --json`.
        problem: with [simulation] or [follower].
        figures: the first of them stands above the rows.
        versions: by package.
    """
    rows, certificate = other_end_rows(document, problem), document["certificate"] if problem.follower is None else None
    unit = problem.units.unit("N/m")
    claims = helps = ""
    if certificate:
        judged = stability_rows(certificate, problem)
        if problem.simulation is not None and problem.simulation.tool_mass_kg is not None:
            judged += passivity_rows(certificate["passivity"], problem)
        said = items_html((certificate["claim"], certificate["passivity"]["claim"]))
        claims = f"<h3>What is claimed of it</h3>\n{rows_html(judged)}\n<ul>\n{said}\n</ul>"
    if document.get("what_would_help"):
        limits = [("as it is", document["simulation"]["stiffest_n_per_m"])]
        limits += [(one["change"], one["stiffest_n_per_m"]) for one in document["what_would_help"]]
        told = [(change, quantity(limit, unit)) for change, limit in limits]
        helps = f"<h3>What would help</h3>\n{columns_html(('change', 'stiffest K, by linear stability alone'), told)}"
    body = filled(
        "other_end",
        verdict=_verdict(document, rows),
        first="\n".join(figure.html() for figure in figures[:1]),
        rows=rows_html(rows),
        figures="\n".join(figure.html() for figure in figures[1:]),
        reason=escape(document["reason"]),
        claims=claims,
        helps=helps,
        notes=items_html((*document["assumed"], *document["not_used"]) or ("nothing beyond what was declared",)),
        problem=columns_html(("key", "value"), settings(problem.model_dump(exclude={"name", "title", "source"}))),
    )
    return page_html(": ".join(filter(None, (problem.name, problem.title))), problem.source, body, versions)


def _verdict(document: dict[str, Any], rows: Sequence[Row]) -> str:
    """Return the verdict in a line: deploy this, with cautions, or nothing."""
    if not document["deployable"]:
        return f'<p class="verdict fail">Deploy nothing: {escape(document["reason"].partition(";")[0])}.</p>'
    doubts = ", ".join(row.label for row in rows if row.mark is Mark.CAUTION)
    return f'<p class="verdict pass">Deploy this coupling{escape(f"; see {doubts}") if doubts else ""}.</p>'
