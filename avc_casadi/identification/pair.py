"""A resonance behind an amplifier's lag, each of which hides what the other alone would explain."""

from __future__ import annotations

from dataclasses import replace

from avc_casadi.identification.beginnings import FIRST_RATE_PER_S
from avc_casadi.identification.fit import Fit, Window
from avc_casadi.identification.near import closely, richer, roughly
from avc_casadi.identification.predictor import Predictor


def ringing_behind_a_lag(predictor: Predictor, simple: Fit, ringing: Fit, lagging: Fit, window: Window) -> Fit:
    """Fit both at once, from where each alone came out.

    Args:
        predictor: of the records.
        simple: the model with neither.
        ringing: with the resonance alone.
        lagging: with the amplifier alone.
        window: of the fit.
    """
    late = {key: lagging.values[key] for key in ("delay_samples", "amplifier_bandwidth_hz")}
    both = richer(simple.structure, "resonance", "amplifier")
    structure = replace(
        both, encoder_at=ringing.structure.encoder_at, amplifier_order=lagging.structure.amplifier_order
    )
    start = {**ringing.values, **late}
    found = roughly(predictor, structure, start, min(simple.observer.rate_per_s, FIRST_RATE_PER_S))
    return closely(predictor, found, window)
