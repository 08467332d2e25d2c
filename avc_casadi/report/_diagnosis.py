"""The page of a diagnosis: conclusion first, then the cures, the evidence and the log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING

from avc_casadi.figures import draw_diagnosis
from avc_casadi.report._frame import Picture, filled, items_html, page_html, table_html
from avc_casadi.support import Table, number

if TYPE_CHECKING:
    from avc_casadi.diagnosis import Diagnosis

_CAPTION = (
    "the grey stretch is the oscillation (a); the position without the hand's slow motion, with the envelope of the "
    "oscillation (b); commanded force against position in its middle (c); its spectrum, with the frequency of the loop "
    "model (d)"
)


def diagnosis_html(found: Sequence[Diagnosis], versions: Mapping[str, str]) -> str:
    """Return the page, self-contained.

    Args:
        found: the diagnosis of each log.
        versions: versions by package.
    """
    sources = ", ".join(
        f"{each.source}: {number(each.seconds, 3)} s at {number(1 / each.ticks.period_s)} Hz" for each in found
    )
    title = "Diagnosis of a log" if len(found) == 1 else f"Diagnosis of {len(found)} logs"
    return page_html(title, sources, "\n".join(map(_body, found)), versions)


def _body(found: Diagnosis) -> str:
    from avc_casadi.diagnosis import CAUSES  # noqa: PLC0415 - SciPy's signals and statistics, which no other page needs

    cures = Table(
        ("change", "growth then\n1/s"), tuple((cure.change, cure.growth_per_s) for cure in found.cures), (0,), digits=3
    )
    shares = Table(
        ("cause", "share of what the log bears out\n%"),
        tuple((CAUSES.get(cause, "none of them"), 100 * share) for cause, share in found.shares.items()),
        (0,),
        digits=3,
    )
    return filled(
        "diagnosis",
        conclusion=escape(f"{found.source}: {found.conclusion}"),
        decides=escape(f"Would decide: {found.decides}." if found.decides else ""),
        cures=table_html(cures),
        evidence=items_html(found.evidence),
        shares=table_html(shares),
        figures=Picture.of(
            draw_diagnosis, found, f"{found.source}: {_CAPTION}", f"{found.source}: {found.conclusion}"
        ).html(),
        notes=items_html(found.notes or ("nothing beyond what was declared",)),
    )
