"""A diagnosis as a JSON document and as text, conclusion first."""

from __future__ import annotations

import math
from typing import Any

from avc_casadi._util.json_values import plain
from avc_casadi._util.text import number
from avc_casadi.identification.diagnosis.causes import CAUSES
from avc_casadi.identification.diagnosis.model import Diagnosis

SCHEMA = "avc-diagnose/1"


def diagnosis_document(found: Diagnosis) -> dict[str, Any]:
    """Return the document ``avc-diagnose/1``."""
    law = found.law
    document = {
        "schema": SCHEMA,
        "log": found.source,
        "seconds": found.seconds,
        "verdict": found.verdict,
        "cause": found.cause,
        "candidates": list(found.candidates),
        "conclusion": found.conclusion,
        "evidence": list(found.evidence),
        "shares": dict(found.shares),
        "cures": [vars(cure) | {"key": cure.key} for cure in found.cures],
        "decides": found.decides,
        "oscillation": {**vars(found.oscillation), "sustained": found.oscillation.sustained},
        "ticks": vars(found.ticks),
        "encoder_resolution_m": found.encoder_m or None,
        "law": None
        if law is None
        else {
            "told": law.told,
            "stiffness_n_per_m": law.stiffness_n_per_m,
            "damping_ns_per_m": law.damping_ns_per_m,
            "velocity_filter_hz": law.filter_hz(found.ticks.period_s),
            "lag_samples": law.lag,
            "wall_m": law.wall_m,
            "misfit": law.misfit,
            "samples": law.samples,
        },
        "measured": None if found.measured is None else vars(found.measured),
        "notes": list(found.notes),
    }
    result: dict[str, Any] = plain(document)
    return result


def diagnosis_text(found: Diagnosis) -> str:
    """Return the diagnosis as printed text."""
    lines = [f"{found.source}: {found.conclusion}", ""]
    if found.cures:
        lines += ["would settle with (each alone, checked on the loop model or in the scene):"]
        lines += [f"  {remedy_text(cure.change, cure.growth_per_s)}" for cure in found.cures]
        lines += [""]
    if found.decides:
        lines += [f"would decide: {found.decides}", ""]
    lines += ["evidence:", *(f"  {line}" for line in found.evidence)]
    if len(found.shares) > 1:
        lines.append(f"  of what the log bears out: {shares_text(found)}")
    lines += [f"note: {note}" for note in found.notes]
    return "\n".join(lines)


def remedy_text(change: str, growth_per_s: float) -> str:
    """Return a remedy with its effect on the loop."""
    return change if math.isnan(growth_per_s) else f"{change}: decays by {number(-growth_per_s, 2)} 1/s"


def shares_text(found: Diagnosis) -> str:
    """Return the shares of the causes as text."""
    return ", ".join(
        f"{CAUSES.get(cause, 'none of them')} {100 * share:.0f} %"
        for cause, share in found.shares.items()
        if share > 0.005
    )
