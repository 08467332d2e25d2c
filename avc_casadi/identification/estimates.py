"""Values and intervals as a device file takes them, from a fit in search coordinates."""

from __future__ import annotations

import math
from collections.abc import Container, Mapping, Sequence
from collections.abc import Set as AbstractSet

import numpy as np
from scipy import stats

from avc_casadi._util.units import METRE, NEWTON
from avc_casadi.identification.closed_loop import autocorrelation, coloured
from avc_casadi.identification.fit import Fit
from avc_casadi.identification.model import Estimate
from avc_casadi.identification.terms import LOOP_DAMPING, LOOP_RATIO, SIZE_OF, lag_of, offset_of
from avc_casadi.identification.uncertainty import LEVEL, SURE, WORTH, Spread, compared, spread_of

# Encoder resolution is known to this share of it.
_STEP_SHARE = 1e-3
# Noise above the encoder's own is identified from this share of it on.
_LEAST_NOISE = 0.3
# Damping ratio of most current loops, 0.7, within a factor of e to this, whatever a log leaves open.
_USUAL_RATIOS = 0.5
# Terms whose rejected model widens intervals always, and those for which it does only where it is significant.
_BESIDE = ("amplifier", LOOP_DAMPING, "coulomb")
_SURE_BESIDE = ("drift", "stribeck", "dead-zone", "drag")
# The division of the error into noise, rounding and disturbance is known to about this share of its square.
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
    """Return the estimates by key.

    Args:
        fit: the fitted model.
        spread: its uncertainty.
        rivals: richer models that were rejected; they bound what they add.
        refused: keys of parameters that are not identifiable.
        inseparable: terms of rivals that the evidence supports but that are confounded with the rest of the model.
        step_m: encoder resolution.
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
        found[one.name] = Estimate(
            one.name, str(one.unit), value, low, high, LEVEL, of_log.get(one.name, "output error")
        )
    if "coulomb" not in fit.structure.terms and "coulomb" in rivals and "coulomb_friction_n" not in refused:
        rival = rivals["coulomb"]
        index = [one.name for one in rival.structure.free].index("coulomb_friction_n")
        most = spread_of(rival, ()).half_width[index] + rival.search[index]
        high = rival.structure.outward(rival.structure.free[index], float(most))
        # Nothing is bounded beyond the largest force of the log.
        if high < rival.structure.units["coulomb_friction_n"]:
            found["coulomb_friction_n"] = Estimate(
                "coulomb_friction_n",
                str(NEWTON),
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
            "encoder_resolution_m", str(METRE), step_m, low, high, LEVEL, "lattice of the readings"
        )
    noise = None if coloured(autocorrelation(fit.error_m)) else _noise(fit, step_m or 0.0)
    if noise is not None:
        found["position_noise_rms_m"] = noise
    return found


def widened(fit: Fit, spread: Spread, rivals: Mapping[str, Fit], inseparable: AbstractSet[str]) -> list[float]:
    """Return half the interval of each coordinate, covering rival models that are not excluded.

    Args:
        fit: the fitted model.
        spread: its uncertainty.
        rivals: richer models that were rejected; they bound what they add.
        inseparable: terms of rivals that the evidence supports but that are confounded with the rest of the model.
    """
    return [
        _widened(fit, rivals, inseparable, one.name, float(fit.search[index]), float(spread.half_width[index]))
        for index, one in enumerate(fit.structure.free)
    ]


def _widened(
    fit: Fit, rivals: Mapping[str, Fit], inseparable: AbstractSet[str], name: str, coordinate: float, half: float
) -> float:
    """Widen half an interval to cover richer models that are neither accepted nor excluded.

    An amplifier's lag trades with a delay; a drift that is significant, but too small to better the prediction, shifts
    the constant force by more than its interval; significant breakaway friction that left the model with an
    unidentifiable resonance is confounded with damping and dry friction. Insignificant dry friction shows as damping
    where it is left out. Parameters that a log of one frequency cannot separate from mass, damping and delay are
    confounded with these.
    """
    for term in dict.fromkeys((*_BESIDE, *_SURE_BESIDE, *sorted(inseparable))):
        rival = rivals.get(term)
        if rival is None or rival.rms_m > (1 + WORTH / 2) * fit.rms_m:
            continue
        places = [one.name for one in rival.structure.free]
        if name not in places:
            # A model that predicts as well without the term leaves its presence open.
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
    """Return the noise after subtracting the rounding from the error, or None where rounding dominates."""
    squares = np.array([block.square / block.samples for block in fit.blocks]) * fit.unit_m**2 * fit.noise_share
    rounding = step_m**2 / 12
    mean = float(squares.mean())
    half = float(stats.t.ppf(0.5 + LEVEL / 2, squares.size - 1) * squares.std(ddof=1) / math.sqrt(squares.size))
    half = math.hypot(half, _DIVIDED * mean)
    if mean - rounding < max(_LEAST_NOISE * rounding, half):
        return None
    value, low, high = (math.sqrt(max(each - rounding, 0.0)) for each in (mean, mean - half, mean + half))
    return Estimate(
        "position_noise_rms_m", str(METRE), value, low, high, LEVEL, "prediction error less the encoder's rounding"
    )
