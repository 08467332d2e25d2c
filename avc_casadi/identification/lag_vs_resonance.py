"""Discrimination of a first-order amplifier lag, a second-order current loop and a resonance.

Below the frequencies of a resonance and its antiresonance a device behind them responds as one behind a low-pass: less
and less, or more and more. With a delay that makes up for the phase, a log separates the two only weakly.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from avc_casadi._util.units import FORCE, Wording
from avc_casadi.identification.fit import FIRST_RATE_PER_S, Fit, Window, closely, fit, judged, richer, rms_m_of, roughly
from avc_casadi.identification.frequency import Response
from avc_casadi.identification.predictor import Predictor
from avc_casadi.identification.terms import HIGHEST_SEEN, LINEAR, LOOP_DAMPING, LOOP_RATIO, lag_of
from avc_casadi.identification.uncertainty import WORTH, Trial, compared

A_LAG_FROM = 1.5
"""Damping ratio above which a current loop is a lag, with a second pole that is far quicker."""
# Admissible bandwidth of a current loop, as shares of the sample rate.
_PLACES = (0.2, 0.1, 0.05)
# Initial share of the lag in the sum of delay and lag.
_SHARES = (0.2, 0.5, 0.9)
# A lag as a current loop whose other pole is so many times as fast: of this times its bandwidth, and this ratio.
_LIKE_A_LAG = (2.0, 1.25)
# Damping ratios: the most of a structural mode and the least of a current loop; hardly any handle exceeds the second.
_LOOP_LIKE, _STRUCTURE_LIKE = 0.2, 0.6
# Mass fractions at a handle.
_HANDLES = (0.3, 0.6)


def of_the_other_order(predictor: Predictor, found: Fit, window: Window) -> Fit:
    """Return the fitted model with an amplifier of the other order.

    Args:
        predictor: of the records.
        found: the model with an amplifier of one order.
        window: of the fits.
    """
    order = found.structure.amplifier_order
    structure = replace(found.structure, amplifier_order=1 if order == 2 else 2)
    turn = 2 * math.pi * predictor.sample_time_s
    values, ratio = found.values, structure.loop_damping_ratio
    late = values["delay_samples"] + lag_of(order, ratio) / (turn * values["amplifier_bandwidth_hz"])
    lag = lag_of(structure.amplifier_order, ratio)
    starts = [
        {**values, "delay_samples": (1 - share) * late, "amplifier_bandwidth_hz": lag / (turn * share * late)}
        for share in _SHARES
    ]
    return _best(predictor, [roughly(predictor, structure, start, FIRST_RATE_PER_S) for start in starts], window)


def damped_as_it_is(predictor: Predictor, found: Fit, window: Window) -> tuple[Trial, Fit]:
    """Return a model with a current loop of free damping ratio, and the evidence for it.

    Args:
        predictor: of the records.
        found: with a lag, or with a current loop of an assumed ratio.
        window: of the fits.
    """
    start = found.values
    if found.structure.amplifier_order == 1:
        faster, ratio = _LIKE_A_LAG
        turns = 2 * math.pi * start["amplifier_bandwidth_hz"] * predictor.sample_time_s
        more = (2 * ratio / faster - 1) / turns
        start = {
            **start,
            "amplifier_bandwidth_hz": faster * start["amplifier_bandwidth_hz"],
            LOOP_RATIO: ratio,
            "delay_samples": max(start["delay_samples"] - more, 0.0),
        }
    structure = replace(richer(found.structure, LOOP_DAMPING), amplifier_order=2)
    near = judged(predictor, structure, structure.start(start), found.observer, window)
    hope = compared(found, near, LOOP_DAMPING)
    if hope.standard_errors < 0:
        return replace(hope, taken=False), near
    begun = roughly(predictor, structure, start, FIRST_RATE_PER_S).values
    # Under the same observer: the difference is smaller than the effect of another one.
    free = fit(predictor, structure, begun, found.observer, window, steps=20)
    return compared(found, free, LOOP_DAMPING), free


def in_place_of_a_resonance(predictor: Predictor, found: Fit, window: Window, *, doubted: bool = False) -> Fit | None:
    """Return a model with a lightly damped current loop in place of a resonance, where it fits as well.

    With the encoder at the handle a resonance is a current loop, but for a zero and the effect of friction.

    Args:
        predictor: of the records.
        found: with a resonance.
        window: of the fits.
        doubted: whether its parameters are not identifiable, and may have any value.

    Returns:
        None where the resonance is structural, or the current loop fits worse.
    """
    values = found.values
    if values["resonance.damping_ratio"] < _LOOP_LIKE and not doubted:
        return None
    structure = replace(richer(found.structure.less("resonance"), "amplifier", LOOP_DAMPING), amplifier_order=2)
    starts: list[Mapping[str, float]] = [
        {
            **values,
            "amplifier_bandwidth_hz": values["resonance.frequency_hz"],
            LOOP_RATIO: values["resonance.damping_ratio"],
        }
    ]
    if "amplifier" in found.structure.terms:
        starts.append({**values, LOOP_RATIO: structure.loop_damping_ratio})
    elif doubted:
        rate = 1 / predictor.sample_time_s
        starts += [{**values, "amplifier_bandwidth_hz": share * rate, LOOP_RATIO: 0.5} for share in _PLACES]
    loop = _best(predictor, [roughly(predictor, structure, start, FIRST_RATE_PER_S) for start in starts], window)
    return None if compared(loop, found, "resonance").taken else loop


def behind_a_structure(predictor: Predictor, found: Fit, window: Window) -> Fit | None:
    """Return a model with a resonance before an encoder at the handle in place of a current loop, where better.

    A second resonance is removed with the loop: with the encoder assumed at the motor, the loop may stand for the mode,
    and the resonance for its residual.

    Args:
        predictor: of the records.
        found: with a current loop of an identified damping ratio.
        window: of the fits.

    Returns:
        None where the loop is damped unlike any structure, or the resonance fits no better.
    """
    values = found.values
    if values[LOOP_RATIO] > _STRUCTURE_LIKE:
        return None
    rigid = found.structure.less("amplifier").less("resonance")
    structure = replace(richer(rigid, "resonance"), encoder_at="handle")
    mode = {
        "resonance.frequency_hz": values["amplifier_bandwidth_hz"],
        "resonance.damping_ratio": values[LOOP_RATIO],
    }
    starts = [{**values, **mode, "resonance.mass_ratio": share} for share in _HANDLES]
    ringing = _best(predictor, [roughly(predictor, structure, start, FIRST_RATE_PER_S) for start in starts], window)
    return ringing if compared(found, ringing, "resonance").taken else None


def _best(predictor: Predictor, rough: list[Fit], window: Window) -> Fit:
    return closely(predictor, min(rough, key=rms_m_of), window)


NOT_TOLD_APART = {
    "amplifier": Wording.of(
        lambda: f"cannot be distinguished from a resonance beyond the frequencies that the {FORCE} excites"
    ),
    "resonance": Wording.of(
        lambda: f"lies beyond the frequencies that the {FORCE} excites, where an amplifier's lag looks like it"
    ),
}
"""Reasons why neither is identifiable."""
ALIKE = 1.02
"""Ratio of the two errors up to which further terms may separate them."""
# Its frequency as multiples of the highest excited frequency, and its other parameters.
_BEYOND = (1.3, 2.5)
_LIKELY = {"resonance.damping_ratio": 0.03, "resonance.mass_ratio": 0.4}


def rival_resonance(
    predictor: Predictor,
    lagging: Fit,
    seen: Fit | None,
    response: Response,
    window: Window,
    sides: Sequence[str],
) -> Fit | None:
    """Return a model with a resonance beyond the excited frequencies that fits as well as one with an amplifier.

    Args:
        predictor: of the records.
        lagging: the model with the amplifier.
        seen: a model with a resonance and no amplifier, perhaps beside other terms.
        response: of the log.
        window: of the fits.
        sides: where the encoder may sit.

    Returns:
        None where no such model exists, a resonance is in the model, or all frequencies are excited.
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
            FIRST_RATE_PER_S,
        )
        for side in sides
        for place in places
    ]
    if not rough:
        return None
    found = closely(predictor, min(rough, key=rms_m_of), window)
    return found if found.rms_m <= worst_m else None
