"""Reports of a diagnosis and of an identification: conclusion first, then log and model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING

from avc_casadi._util.text import Table, number
from avc_casadi._util.units import FORCE, MASS, Wording, spoken_key
from avc_casadi.present.figures.diagnosis import draw_diagnosis
from avc_casadi.present.figures.identification import draw_correlations, draw_identification
from avc_casadi.present.report.frame import Picture, filled, items_html, page_html, table_html

if TYPE_CHECKING:
    from avc_casadi.identification.diagnosis.model import Diagnosis
    from avc_casadi.identification.model import Identification


_CAPTION = Wording.of(
    lambda: (
        "the grey stretch is the oscillation (a); the position without the hand's slow motion, with the envelope of "
        f"the oscillation (b); commanded {FORCE} against position in its middle (c); its spectrum, with the frequency "
        "of the loop model (d)"
    )
)


def diagnosis_html(found: Sequence[Diagnosis], versions: Mapping[str, str]) -> str:
    """Return the self-contained page of a diagnosis.

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
    from avc_casadi.identification.diagnosis.causes import (  # noqa: PLC0415 - SciPy's signals and statistics, which no other page needs
        CAUSES,
    )

    cures = Table(
        ("change", "growth then\n1/s"), tuple((cure.change, cure.growth_per_s) for cure in found.cures), (0,), digits=3
    )
    shares = Table(
        ("cause", "share of what the log bears out\n%"),
        tuple((str(CAUSES.get(cause, "none of them")), 100 * share) for cause, share in found.shares.items()),
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


def identification_html(found: Identification, versions: Mapping[str, str]) -> str:
    """Return the self-contained page of an identification.

    Args:
        found: the identification.
        versions: versions by package.
    """
    from avc_casadi.identification.device import device_text  # noqa: PLC0415 - SciPy, which no other page needs
    from avc_casadi.identification.terms import TERMS, words_of  # noqa: PLC0415 - SciPy, which no other page needs

    estimates = Table(
        ("what", "value", "from", "to", "unit", "how"),
        tuple(
            (spoken_key(one.key), one.value, one.low, one.high, one.unit or "-", one.told)
            for one in found.estimates.values()
        ),
        (0, 4, 5),
    )
    refused = Table(
        ("what", "why", "what would tell it"),
        tuple((spoken_key(one.key), one.why, one.excitation) for one in found.refused),
        (0, 1, 2),
    )
    evidence = Table(
        ("term", "taken", "change of the error, %", "standard errors", "why"),
        tuple(
            (str(TERMS[one.term].words), one.taken, 100 * one.held_out_change, one.standard_errors, one.why)
            for one in found.trials
        ),
        (0, 1, 4),
    )
    shown = found.shown[0]
    caption = (
        f"{shown.record}: the model runs through {shown.time_s[-1] - shown.time_s[0]:.2g} s of the log on the "
        f"commanded {FORCE}, an observer of 4 rad/s holding it near (a, b); frequency response where {FORCE} and "
        "motion are coherent (c, d); intervals (e); prediction error from sample to sample, white inside the grey band "
        "(f)"
    )
    named = ", ".join(
        f"{spoken_key(one.key)} {number(one.value)} {one.unit or ''}".strip() for one in found.estimates.values()
    )
    figures = (
        Picture.of(draw_identification, found, caption, f"{shown.record}: log and model side by side; found: {named}"),
        Picture.of(
            draw_correlations,
            found,
            "Correlations of the estimates: two numbers near +-1 are known together better than alone",
            (
                f"Correlations of {', '.join(map(spoken_key, found.estimates))} as a table of shades; the numbers "
                "stand in --json"
            ),
        ),
    )
    device = (
        f"No device file: {MASS} or damping was not identified." if found.device is None else device_text(found.device)
    )
    source = f"{', '.join(found.sources)}: {number(found.seconds, 3)} s at {number(1 / found.sample_time_s)} Hz"
    body = filled(
        "identification",
        model=escape(
            f"Model: {words_of(found.terms, found.amplifier_order)}. Intervals of 95 % from {found.spread_from}."
        ),
        estimates=table_html(estimates),
        notes=items_html(found.notes),
        refused=table_html(refused),
        figures="\n".join(one.html() for one in figures),
        evidence=table_html(evidence),
        device=escape(device),
    )
    title = "Device identified from its log" if found.device is None else found.device.title
    return page_html(title, source, body, versions)
