"""Values and intervals as a device file takes them, from a fit in its own coordinates."""

from __future__ import annotations

import math
from collections.abc import Container, Mapping, Sequence
from collections.abc import Set as AbstractSet

import numpy as np
from scipy import stats

from avc_casadi.identification.closed_loop import autocorrelation, coloured
from avc_casadi.identification.fit import Fit
from avc_casadi.identification.model import Estimate
from avc_casadi.identification.terms import LOOP_DAMPING, LOOP_RATIO, SIZE_OF, lag_of, offset_of
from avc_casadi.identification.uncertainty import LEVEL, SURE, WORTH, Spread, compared, spread_of

# A step of the encoder is known to this share of it.
_STEP_SHARE = 1e-3
# Noise above the encoder's own is told from this share of it on.
_LEAST_NOISE = 0.3
# A current loop is damped as most are, 0.7, within a factor of e to this, whatever a log leaves open.
_USUAL_RATIOS = 0.5
# Terms whose rival widens intervals, and those whose rival does where it is sure.
_BESIDE = ("amplifier", LOOP_DAMPING, "coulomb")
_SURE_BESIDE = ("drift", "stribeck")
# How the error divides into noise, rounding and disturbance is known to about this share of its square.
_DIVIDED = 0.12


def estimates_of(
    fit: Fit,
    spread: Spread,
    rivals: Mapping[str, Fit],
    refused: Container[str],
    inseparable: AbstractSet[str],
    step_m: float | None,
    logs: Sequence[str],
) -> dict[str, Estimate]:
    """Return what is told.

    Args:
        fit: at its best.
        spread: its uncertainty.
        rivals: richer models that were not borne out; they bound what they add.
        refused: keys that are not told.
        inseparable: terms of rivals that are borne out and not told from the rest of the model.
        step_m: of the encoder.
        logs: their names.
    """
    of_log = {offset_of(index): f"output error, in {name}" for index, name in enumerate(logs)} if len(logs) > 1 else {}
    found: dict[str, Estimate] = {}
    halves = widened(fit, spread, rivals, inseparable)
    for index, one in enumerate(fit.structure.free):
        if one.name.partition(".")[0] in refused:
            continue
        q, half = float(fit.search[index]), halves[index]
        down, up = (float(each) for each in half + spread.beyond[:, index])
        ends = [fit.structure.outward(one, end) for end in (q - down, q + up)]
        low, high = (min(max(end, one.lowest), one.highest) for end in ends)
        value = fit.structure.outward(one, q)
        found[one.name] = Estimate(one.name, one.unit, value, low, high, LEVEL, of_log.get(one.name, "output error"))
    if "coulomb" not in fit.structure.terms and "coulomb" in rivals and "coulomb_friction_n" not in refused:
        rival = rivals["coulomb"]
        index = [one.name for one in rival.structure.free].index("coulomb_friction_n")
        most = spread_of(rival, ()).half_width[index] + rival.search[index]
        high = rival.structure.outward(rival.structure.free[index], float(most))
        # Beyond the force that acted nothing is bounded.
        if high < rival.structure.units["coulomb_friction_n"]:
            found["coulomb_friction_n"] = Estimate(
                "coulomb_friction_n",
                "N",
                0.0,
                0.0,
                max(high, 0.0),
                LEVEL,
                "no evidence of any; the upper end bounds it",
            )
    for key, value in fit.structure.known.items():
        found[key] = Estimate(key, "", value, value, value, 1.0, "known beforehand")
    if step_m is not None:
        low, high = step_m * (1 - _STEP_SHARE), step_m * (1 + _STEP_SHARE)
        found["encoder_resolution_m"] = Estimate(
            "encoder_resolution_m", "m", step_m, low, high, LEVEL, "lattice of the readings"
        )
    noise = None if coloured(autocorrelation(fit.error_m)) else _noise(fit, step_m or 0.0)
    if noise is not None:
        found["position_noise_rms_m"] = noise
    return found


def widened(fit: Fit, spread: Spread, rivals: Mapping[str, Fit], inseparable: AbstractSet[str]) -> list[float]:
    """Return half the interval of each coordinate, which also holds what rivals find that are not excluded.

    Args:
        fit: at its best.
        spread: its uncertainty.
        rivals: richer models that were not borne out.
        inseparable: terms of rivals that are borne out and not told from the rest of the model.
    """
    return [
        _widened(fit, rivals, inseparable, one.name, float(fit.search[index]), float(spread.half_width[index]))
        for index, one in enumerate(fit.structure.free)
    ]


def _widened(
    fit: Fit, rivals: Mapping[str, Fit], inseparable: AbstractSet[str], name: str, coordinate: float, half: float
) -> float:
    """Return half an interval that also holds what richer models find that are not borne out and not excluded either.

    An amplifier's lag trades with a delay; a drift that is sure, but too small to better the prediction, moves the
    constant force to which it belongs, by more than that force is known to; friction from rest that is sure, and left
    the model with a resonance that is not told, is in damping and dry friction. Dry friction that is not sure is
    damping where it is left out. What a log of one frequency does not tell from mass, damping and delay is in these.
    """
    for term in dict.fromkeys((*_BESIDE, *_SURE_BESIDE, *sorted(inseparable))):
        rival = rivals.get(term)
        if rival is None or rival.rms_m > (1 + WORTH / 2) * fit.rms_m:
            continue
        places = [one.name for one in rival.structure.free]
        if name not in places:
            # What does as well without it leaves open whether it is there.
            without = term in inseparable and name in SIZE_OF.values()
            half = max(half, abs(coordinate)) if without else half
            continue
        lag_within = "amplifier" not in fit.structure.terms
        if term in {"amplifier", LOOP_DAMPING} and name == "delay_samples" and lag_within:
            half = max(half, abs(_with_lag(rival) - coordinate))
            continue
        place = places.index(name)
        moved = abs(float(rival.search[place]) - coordinate)
        if term == "drift" and moved <= half:
            continue
        if term in _SURE_BESIDE and compared(fit, rival, term).standard_errors <= SURE:
            continue
        if term != "amplifier":
            halves = spread_of(rival, ()).half_width
            known = 1.0 if term != LOOP_DAMPING else min(1.0, _USUAL_RATIOS / float(halves[places.index(LOOP_RATIO)]))
            moved += known * float(halves[place])
        half = max(half, moved)
    return half


def _with_lag(fit: Fit) -> float:
    """Return the delay with the lag of the amplifier, samples."""
    values = fit.values
    turns = 2 * math.pi * values["amplifier_bandwidth_hz"] * fit.sample_time_s
    return values["delay_samples"] + lag_of(fit.structure.amplifier_order, values[LOOP_RATIO]) / turns


def _noise(fit: Fit, step_m: float) -> Estimate | None:
    """Return the noise that is left when the rounding is taken from the error, or None where that hides it."""
    squares = np.array([block.square / block.samples for block in fit.blocks]) * fit.unit_m**2 * fit.noise_share
    rounding = step_m**2 / 12
    mean = float(squares.mean())
    half = float(stats.t.ppf(0.5 + LEVEL / 2, squares.size - 1) * squares.std(ddof=1) / math.sqrt(squares.size))
    half = math.hypot(half, _DIVIDED * mean)
    if mean - rounding < max(_LEAST_NOISE * rounding, half):
        return None
    value, low, high = (math.sqrt(max(each - rounding, 0.0)) for each in (mean, mean - half, mean + half))
    return Estimate(
        "position_noise_rms_m", "m", value, low, high, LEVEL, "prediction error less the encoder's rounding"
    )
