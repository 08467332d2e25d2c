"""What rings beyond the frequencies that a log excites, and looks like an amplifier that lags.

Below the frequencies of a resonance and its antiresonance a device behind them answers as one behind a low-pass does:
less and less, or more and more. With a delay that makes up for the phase, a log tells one from the other by little.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from avc_casadi.identification.evidence import WORTH
from avc_casadi.identification.fit import Fit, Window, fit
from avc_casadi.identification.frequency import Response
from avc_casadi.identification.near import closely, rms_m_of, roughly
from avc_casadi.identification.predictor import Predictor
from avc_casadi.identification.terms import HIGHEST_SEEN, LINEAR

MIMICS = {
    "amplifier": "cannot be told from a resonance beyond the frequencies that the force excites",
    "resonance": "lies beyond the frequencies that the force excites, where an amplifier's lag looks like it",
}
"""Why neither is told."""
ALIKE = 1.02
"""The error of one beside that of the other up to which more terms may tell them apart."""
# Where it may lie, as multiples of the highest frequency that is excited, and how it may be.
_BEYOND = (1.3, 2.5)
_LIKELY = {"resonance.damping_ratio": 0.03, "resonance.mass_ratio": 0.4}
_RATE_PER_S = 60.0


def mimic(
    predictor: Predictor,
    lagging: Fit,
    seen: Fit | None,
    response: Response,
    window: Window,
    sides: Sequence[str],
) -> Fit | None:
    """Return a model with a resonance beyond the excited frequencies that does as well as one with an amplifier.

    Args:
        predictor: of the records.
        lagging: the model with the amplifier.
        seen: a model with a resonance and no amplifier, perhaps beside other terms.
        response: of the log.
        window: of the fits.
        sides: where the encoder may sit.

    Returns:
        None where there is none, beside a resonance, or where all frequencies are excited.
    """
    band = response.excited_hz
    if band is None or "resonance" in lagging.structure.terms:
        return None
    terms = lagging.structure.ordered((*lagging.structure.less("amplifier").terms, "resonance"))
    worst_m = (1 + WORTH / 2) * lagging.rms_m
    if seen is not None:
        if seen.structure.terms != terms:
            start = {**lagging.values, **{key: seen.values[key] for key in LINEAR}}
            beside = replace(seen.structure, terms=terms)
            seen = closely(predictor, fit(predictor, beside, start, seen.observer, window, steps=15), window)
        if seen.rms_m <= worst_m:
            return seen
    places = [share * band[1] for share in _BEYOND if share * band[1] < HIGHEST_SEEN / predictor.sample_time_s]
    rough = [
        roughly(
            predictor,
            replace(lagging.structure, terms=terms, encoder_at="handle" if side == "handle" else "motor"),
            {**lagging.values, **_LIKELY, "resonance.frequency_hz": place},
            _RATE_PER_S,
        )
        for side in sides
        for place in places
    ]
    if not rough:
        return None
    found = closely(predictor, min(rough, key=rms_m_of), window)
    return found if found.rms_m <= worst_m else None
