"""What rings beyond the frequencies that a log excites, and looks like an amplifier that lags.

Below the frequencies of a resonance and its antiresonance a device behind them answers as one behind a low-pass does:
less and less, or more and more. With a delay that makes up for the phase, a log tells one from the other by little.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from avc_casadi.identification._evidence import WORTH
from avc_casadi.identification._fit import Fit, Window
from avc_casadi.identification._frequency import Response
from avc_casadi.identification._near import closely, rms_m_of, roughly
from avc_casadi.identification._predictor import Predictor
from avc_casadi.identification._terms import HIGHEST_SEEN

MIMICS = {
    "amplifier": "cannot be told from a resonance beyond the frequencies that the force excites",
    "resonance": "lies beyond the frequencies that the force excites, where an amplifier's lag looks like it",
}
"""Why neither is told."""
# Where it may lie, as multiples of the highest frequency that is excited, and how it may be.
_BEYOND = (1.3, 2.5)
_LIKELY = {"resonance.damping_ratio": 0.03, "resonance.mass_ratio": 0.4}
_RATE_PER_S = 60.0


def mimic(
    predictor: Predictor,
    simple: Fit,
    lagging: Fit,
    rivals: Mapping[str, Fit],
    response: Response,
    window: Window,
    sides: Sequence[str],
) -> Fit | None:
    """Return a model with a resonance beyond the excited frequencies that does as well as one with an amplifier.

    Args:
        predictor: of the records.
        simple: the model without either.
        lagging: the model with the amplifier.
        rivals: models that were not taken; one with a resonance of the same other terms may be among them.
        response: of the log.
        window: of the fits.
        sides: where the encoder may sit.

    Returns:
        None where there is none, beside a resonance, or where all frequencies are excited.
    """
    band = response.excited_hz
    if band is None or "resonance" in simple.structure.terms:
        return None
    terms = simple.structure.ordered((*simple.structure.terms, "resonance"))
    worst_m = (1 + WORTH / 2) * lagging.rms_m
    seen = rivals.get("resonance")
    if seen is not None and seen.structure.terms == terms and seen.rms_m <= worst_m:
        return seen
    places = [share * band[1] for share in _BEYOND if share * band[1] < HIGHEST_SEEN / predictor.sample_time_s]
    rough = [
        roughly(
            predictor,
            replace(simple.structure, terms=terms, encoder_at="handle" if side == "handle" else "motor"),
            {**simple.values, **_LIKELY, "resonance.frequency_hz": place},
            _RATE_PER_S,
        )
        for side in sides
        for place in places
    ]
    if not rough:
        return None
    found = closely(predictor, min(rough, key=rms_m_of), window)
    return found if found.rms_m <= worst_m else None
