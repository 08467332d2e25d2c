"""Evidence for a model and intervals of its parameters, from blocks of the records drawn anew."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import stats

from avc_casadi._util.arrays import FloatArray
from avc_casadi.identification.fit import Fit, Window, judged, slowest_observer
from avc_casadi.identification.predictor import Observer, Predictor
from avc_casadi.identification.terms import FRICTION, LOOP_RATIO, MASS_RATIO

SURE, WORTH = 3.0, 2e-3
"""A rung must better the held-out error by this many standard errors, and by this share of it."""
LEVEL = 0.95
_DRAWS, _SEED = 500, 20
# Rates of other observers, as multiples of the best: a wrong model has other estimates under them.
_OTHER_OBSERVERS = (3.0, 0.4, 0.12)
# Least errors of what is found from a resonance inside a sample or from a lag, and of every parameter by the clock:
# calibrated on a simulation in steps of 1/200 sample.
_LEAST = {
    "resonance.frequency_hz": 1e-3,
    "resonance.damping_ratio": 3e-2,
    MASS_RATIO: 4e-2,
    "amplifier_bandwidth_hz": 1e-2,
    LOOP_RATIO: 1e-2,
}
_CLOCK, _SCATTER = 1e-5, 1 / 6
# Dry friction changes by twice its level where the motor reverses; means over a sample of a curved and of a linear
# course differ by a twelfth of the curvature.
_BENT = 6.0


@dataclass(frozen=True)
class Trial:
    """A rung that was tried."""

    rung: str
    taken: bool
    change: float
    standard_errors: float
    why: str = ""


def _curvature(fit: Fit) -> tuple[FloatArray, FloatArray]:
    """Return J'J of all blocks, and the root of its diagonal, which scales the parameters to one size."""
    whole = np.sum([block.curvature for block in fit.blocks], axis=0)
    return whole, np.sqrt(np.maximum(np.diag(whole), 1e-300))


def held_out(fit: Fit) -> FloatArray:
    """Return the squared error of each block under the fit to the others, shape (blocks,), m^2.

    The fit without a block is one Gauss-Newton step from the fit with all, or from a point beside it.
    """
    whole, scale = _curvature(fit)
    gradient = np.sum([block.gradient for block in fit.blocks], axis=0)
    squares = []
    for block in fit.blocks:
        rest = (whole - block.curvature) / scale / scale[:, None]
        step = -np.linalg.lstsq(rest, (gradient - block.gradient) / scale, rcond=1e-10)[0] / scale
        squares.append(block.square + 2 * block.gradient @ step + step @ block.curvature @ step)
    return np.array(squares) * fit.unit_m**2


def compared(simple: Fit, rich: Fit, rung: str) -> Trial:
    """Return whether a richer model predicts held-out data better, on the same blocks."""
    one, other = held_out(simple), held_out(rich)
    size = float(np.sum(one)) or 1.0
    least = 1e-12 * size / one.size
    # Where a simple model fails in a few blocks, their gains differ by orders of magnitude: then the logarithm decides.
    gains = (one - other, np.log((one + least) / (other + least)))
    sure = max(float(np.mean(gain)) / (float(stats.sem(gain)) or 1e-300) for gain in gains)
    change = -float(np.sum(gains[0])) / size
    return Trial(rung, sure > SURE and -change > WORTH, change, sure)


def collinearity(fit: Fit) -> float:
    """Return 1/sqrt of the smallest eigenvalue of the normalised sensitivities: above 100 some are confounded."""
    whole, scale = _curvature(fit)
    return 1 / math.sqrt(max(float(np.linalg.eigvalsh(whole / scale / scale[:, None])[0]), 1e-16))


def bootstrap(fit: Fit) -> FloatArray:
    """Return half the interval of each coordinate: blocks drawn anew move the estimate by a Gauss-Newton step."""
    gradients = np.array([block.gradient for block in fit.blocks])
    curvatures = np.array([block.curvature for block in fit.blocks])
    _, scale = _curvature(fit)
    count = len(fit.blocks)
    random = np.random.default_rng(_SEED)
    # At a bound the gradient does not vanish; it is no measure of the spread.
    gradients = gradients - gradients.mean(axis=0)
    moves = []
    for _ in range(_DRAWS):
        drawn = random.integers(0, count, count)
        curvature = curvatures[drawn].sum(axis=0) / scale / scale[:, None]
        moves.append(-np.linalg.lstsq(curvature, gradients[drawn].sum(axis=0) / scale, rcond=1e-12)[0] / scale)
    deviation = np.std(moves, axis=0, ddof=1) * math.sqrt(count / max(1, count - 1))
    return np.asarray(stats.t.ppf(0.5 + LEVEL / 2, max(1, count - 1)) * deviation)


def half_widths(predictor: Predictor, fit: Fit, window: Window, rivals: Mapping[str, Fit]) -> FloatArray:
    """Return half the interval of each coordinate, shape (free,).

    To the bootstrap is added what other observers would have found beyond chance (there the disturbance, or the model,
    is not as assumed), what is left out inside a sample, and the clock; rungs that were not taken and predict as well
    widen it to what they say.
    """
    half = bootstrap(fit)
    rate, slowest, fastest = fit.observer.rate_per_s, slowest_observer(predictor), 1 / predictor.sample_time_s
    rates = {min(max(rate * by, slowest), fastest) for by in _OTHER_OBSERVERS} - {rate}
    others = [judged(predictor, fit.structure, fit.search, Observer(other), window) for other in sorted(rates)]
    shifts = [_beyond_chance(fit, other) for other in others]
    scatter = max(record.scatter for record in predictor.records)
    clock = max(_CLOCK, _SCATTER * scatter**2)
    pairs = zip(fit.structure.free, fit.search, strict=True)
    by_clock = [clock * (1.0 if one.kind == "log" else abs(q)) for one, q in pairs]
    half = half + np.max(shifts, axis=0) + _inside_a_sample(fit, predictor.sample_time_s) + by_clock
    for rung, rival in rivals.items():
        if rival.rms_m <= (1 + WORTH / 2) * fit.rms_m:
            half = np.maximum(half, _apart(fit, rival, rung, predictor.sample_time_s))
    return np.asarray(half)


def _beyond_chance(fit: Fit, other: Fit) -> FloatArray:
    """Return the shift of the estimate under another observer, less its chance part."""
    moves = _moves(other) - _moves(fit)
    low, high = fit.structure.bounds()
    shift = np.clip(fit.search + moves.sum(axis=0), low, high) - fit.search
    chance = 2.0 * np.sqrt(len(moves)) * moves.std(axis=0, ddof=1)
    return np.asarray(np.sqrt(np.maximum(shift**2 - chance**2, 0.0)))


def _moves(fit: Fit) -> FloatArray:
    """Return the Gauss-Newton step by each block, shape (blocks, free); they add up."""
    whole, scale = _curvature(fit)
    gradients = np.array([block.gradient for block in fit.blocks]).T / scale[:, None]
    return np.asarray(-(np.linalg.lstsq(whole / scale / scale[:, None], gradients, rcond=1e-10)[0] / scale[:, None]).T)


def _inside_a_sample(fit: Fit, period: float) -> FloatArray:
    """Return what the model leaves out inside a sample, of each coordinate.

    The linear part is exact. Dry friction assumes a velocity that decays evenly over a sample: the error is of second
    order in damping, of first order in a resonance, and counts in samples in which the motor reverses.
    """
    values = fit.values
    angle = 0.0
    if fit.structure.present("resonance.frequency_hz"):
        angle = 2 * math.pi * values["resonance.frequency_hz"] * period
    bend = (values["damping_ns_per_m"] / values["mass_kg"] * period) ** 2 + angle**2
    share = fit.turning * values[FRICTION] / fit.structure.units[FRICTION] * bend / _BENT
    left = {
        "mass_kg": share,
        "delay_samples": (share / angle if angle else share) + late_samples(values, fit.structure.order, period) * 1e-2,
        "resonance.frequency_hz": share,
        "resonance.damping_ratio": share / values["resonance.damping_ratio"],
        MASS_RATIO: 4 * share / values[MASS_RATIO],
    }
    return np.array(
        [
            max(left.get(one.name, share * abs(q) if one.kind == "linear" else 0.0), _LEAST.get(one.name, 0.0))
            for one, q in zip(fit.structure.free, fit.search, strict=True)
        ]
    )


def late_samples(values: Mapping[str, float], order: int, period: float) -> float:
    """Return the lag of the amplifier at low frequencies, samples."""
    if math.isnan(values["amplifier_bandwidth_hz"]):
        return 0.0
    radians = 1.0 if order == 1 else 2 * values[LOOP_RATIO]
    return radians / (2 * math.pi * values["amplifier_bandwidth_hz"] * period)


def _apart(fit: Fit, rival: Fit, rung: str, period: float) -> FloatArray:
    """Return how far a rung that was not taken moves each coordinate; a lag beside none counts in the delay."""
    widths = dict(zip(rival.structure.names, zip(rival.search, bootstrap(rival), strict=True), strict=True))
    found = np.zeros(fit.search.size)
    for index, name in enumerate(fit.structure.names):
        # A bandwidth is another number of another kind of amplifier.
        if name in widths and name != "amplifier_bandwidth_hz":
            value, width = widths[name]
            if name == "delay_samples" and not late_samples(fit.values, fit.structure.order, period):
                value = value + late_samples(rival.values, rival.structure.order, period)
            found[index] = abs(value - fit.search[index]) + (width if rung == "friction" else 0.0)
    return found
