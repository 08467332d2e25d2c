"""The page of an identification: conclusion first, then the log beside the model."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import TYPE_CHECKING

from avc_casadi.figures import draw_correlations, draw_identification
from avc_casadi.report._frame import Picture, filled, items_html, page_html, table_html
from avc_casadi.support import Table, number

if TYPE_CHECKING:
    from avc_casadi.identification import Identification


def identification_html(found: Identification, versions: Mapping[str, str]) -> str:
    """Return the page, self-contained.

    Args:
        found: the identification.
        versions: versions by package.
    """
    from avc_casadi.identification import TERMS, device_text, words_of  # noqa: PLC0415 - SciPy, which no other page needs

    estimates = Table(
        ("what", "value", "from", "to", "unit", "how"),
        tuple((one.key, one.value, one.low, one.high, one.unit or "-", one.how) for one in found.estimates.values()),
        (0, 4, 5),
    )
    refused = Table(
        ("what", "why", "what would tell it"),
        tuple((one.key, one.why, one.excitation) for one in found.refused),
        (0, 1, 2),
    )
    evidence = Table(
        ("term", "taken", "change of the error, %", "standard errors", "why"),
        tuple(
            (TERMS[one.term].words, one.taken, 100 * one.held_out_change, one.standard_errors, one.why)
            for one in found.trials
        ),
        (0, 1, 4),
    )
    shown = found.shown[0]
    caption = (
        f"{shown.record}: the model runs through {shown.time_s[-1] - shown.time_s[0]:.2g} s of the log on the "
        f"commanded "
        "force, an observer of 4 rad/s holding it near (a, b); frequency response where force and motion are coherent "
        "(c, d); intervals (e); prediction error from sample to sample, white inside the grey band (f)"
    )
    named = ", ".join(f"{one.key} {number(one.value)} {one.unit or ''}".strip() for one in found.estimates.values())
    figures = (
        Picture.of(draw_identification, found, caption, f"{shown.record}: log and model side by side; found: {named}"),
        Picture.of(
            draw_correlations,
            found,
            "Correlations of the estimates: two numbers near +-1 are known together better than alone",
            f"Correlations of {', '.join(found.estimates)} as a table of shades; the numbers stand in --json",
        ),
    )
    device = "No device file: mass or damping is not told." if found.device is None else device_text(found.device)
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
