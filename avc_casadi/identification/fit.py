"""Prediction error fit of one model structure, its evidence and intervals, from blocks of the records drawn anew."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.optimize import least_squares

from avc_casadi._util.arrays import FloatArray
from avc_casadi.identification.log import excerpts
from avc_casadi.identification.predictor import Observer, Predictor
from avc_casadi.identification.terms import FRICTION, LOOP_RATIO, MASS_RATIO, Structure

# A record is judged from so many seconds on, or from this share of it: by then the initial state must have decayed, but
# for e^-8 of a state that may be a centimetre off.
_START_S, _START_SHARE, _DECAY = 1.0, 0.1, 8.0
# Errors and slopes beyond it are those of a diverging model.
_DIVERGENCE = 1e100
FIRST_RATE_PER_S = 60.0
"""Observer rate of a search from a distant start."""


@dataclass(frozen=True, eq=False)
class Block:
    """Contribution of a stretch of a record: squared error, gradient J'e and curvature J'J."""

    samples: int
    square: float
    gradient: FloatArray
    curvature: FloatArray


@dataclass(frozen=True, eq=False)
class Fit:
    """A model structure at given coordinates."""

    structure: Structure
    search: FloatArray
    observer: Observer
    error_m: tuple[FloatArray, ...]
    blocks: tuple[Block, ...]
    unit_m: float
    turning: float

    @property
    def values(self) -> dict[str, float]:
        """Values of all parameters."""
        return self.structure.values(self.search)

    @property
    def rms_m(self) -> float:
        """Root mean square of the prediction error."""
        return float(np.sqrt(np.mean(np.concatenate(self.error_m) ** 2)))


@dataclass(frozen=True)
class Window:
    """Partition of the records: samples at the start that are not judged, and samples of a block."""

    skip: int
    block: int

    @classmethod
    def of(cls, predictor: Predictor) -> Window:
        """Choose the blocks: at least 30 where the records are long enough, of 0.1 to 2 seconds."""
        sizes, period = [record.position_m.size for record in predictor.records], predictor.sample_time_s
        block = int(min(max(sum(sizes) // 40, 0.1 / period), 2.0 / period, min(sizes) // 2))
        return cls(int(min(_START_S / period, _START_SHARE * min(sizes))), max(block, 20))


def slowest_observer(predictor: Predictor) -> float:
    """Return the slowest observer rate under which the initial state of a record has decayed before it is judged."""
    shortest = min(record.seconds for record in predictor.records)
    return _DECAY / min(_START_S, _START_SHARE * shortest)


def fit(
    predictor: Predictor,
    structure: Structure,
    start: Mapping[str, float],
    observer: Observer,
    window: Window,
    *,
    steps: int = 30,
    tolerance: float = 1e-8,
) -> Fit:
    """Minimise the squared prediction error by Gauss-Newton steps in a trust region."""
    low, high = structure.bounds()
    inside = 1e-9 * np.maximum(1.0, np.abs(np.where(np.isfinite(low), low, 0.0)))
    begin = np.clip(structure.start(start), low + inside, high - inside)
    last: dict[bytes, tuple[FloatArray, FloatArray]] = {}
    unit: list[float] = []

    def both(search: FloatArray) -> tuple[FloatArray, FloatArray]:
        key = search.tobytes()
        if key not in last:
            last.clear()
            records = predictor.predict(structure, search, observer)
            e = np.concatenate([one.error_m[window.skip :] for one in records])
            j = np.concatenate([one.slopes[window.skip :] for one in records])
            if (np.abs(e) < _DIVERGENCE).all() and (np.abs(j) < _DIVERGENCE).all():
                unit.append(float(np.sqrt(np.mean(e**2))) or 1.0)
                last[key] = e / unit[0], j / unit[0]
            else:
                last[key] = np.full_like(e, 1e3), np.zeros_like(j)
        return last[key]

    def error(search: FloatArray) -> FloatArray:
        return both(search)[0]

    def slopes(search: FloatArray) -> FloatArray:
        return both(search)[1]

    # A diverging slope may overflow in a trial step of the solver, which it then rejects.
    with np.errstate(over="ignore"):
        result = least_squares(
            error,
            begin,
            jac=slopes,
            bounds=(low, high),
            x_scale="jac",
            ftol=tolerance,
            xtol=1e-9,
            gtol=1e-12,
            max_nfev=steps,
        )
    return evaluate(predictor, structure, result.x, observer, window)


def evaluate(predictor: Predictor, structure: Structure, search: FloatArray, observer: Observer, window: Window) -> Fit:
    """Return a structure at given coordinates with the contribution of each block."""
    predictions = predictor.predict(structure, search, observer)
    errors = tuple(_clip(one.error_m[window.skip :]) for one in predictions)
    unit = float(np.sqrt(np.mean(np.concatenate(errors) ** 2))) or 1.0
    blocks = []
    for one, error in zip(predictions, errors, strict=True):
        slopes = _clip(one.slopes[window.skip :]) / unit
        count = max(1, error.size // window.block)
        for e, j in zip(np.array_split(error / unit, count), np.array_split(slopes, count), strict=True):
            blocks.append(Block(e.size, float(e @ e), j.T @ e, j.T @ j))
    moves = [
        np.diff(record.position_m[window.skip :] - error)
        for record, error in zip(predictor.records, errors, strict=True)
    ]
    turning = float(np.mean(np.concatenate([one[1:] * one[:-1] < 0 for one in moves])))
    return Fit(structure, search, observer, errors, tuple(blocks), unit, turning)


def _clip(numbers: FloatArray) -> FloatArray:
    """Clip the output of a diverging model to numbers that can be squared."""
    return np.nan_to_num(np.clip(numbers, -_DIVERGENCE, _DIVERGENCE), nan=_DIVERGENCE)


def best_observer(predictor: Predictor, initial: Fit, window: Window) -> Observer:
    """Return the observer rate that minimises the prediction error."""
    slowest, fastest = slowest_observer(predictor), 1.0 / predictor.sample_time_s
    rates = list(np.geomspace(slowest, fastest, max(4, int(np.ceil(2 * np.log2(fastest / slowest))) // 2)))

    def square(rate: float) -> float:
        errors = predictor.predict(initial.structure, initial.search, Observer(rate), slopes=False)
        return float(sum(np.sum(one.error_m[window.skip :] ** 2) for one in errors))

    squares = {float(rate): square(rate) for rate in rates}
    best = rates.index(min(squares, key=lambda rate: np.nan_to_num(squares[rate], nan=np.inf)))
    near = (float(np.sqrt(rates[best] * rates[other])) for other in (best - 1, best + 1) if 0 <= other < len(rates))
    squares |= {rate: square(rate) for rate in near}
    return Observer(min(squares, key=lambda rate: np.nan_to_num(squares[rate], nan=np.inf)))


def coarse_fit(predictor: Predictor, structure: Structure, start: Mapping[str, float], rate_per_s: float) -> Fit:
    """Fit coarsely, with a slow observer, to pieces of long records: a start for `fine_fit`."""
    records = excerpts(predictor.records, 10_000)
    pieces = Predictor(records, predictor)
    observer = Observer(max(rate_per_s, slowest_observer(pieces)))
    return fit(pieces, structure, start, observer, Window.of(pieces), steps=12, tolerance=1e-4)


def fine_fit(predictor: Predictor, initial: Fit, window: Window, steps: int = 10, tolerance: float = 1e-5) -> Fit:
    """Fit to all records under the best observer."""
    observer = best_observer(predictor, initial, window)
    return fit(predictor, initial.structure, initial.values, observer, window, steps=steps, tolerance=tolerance)


WORTH = 2e-3
"""A rung must better the held-out error by this share of it, and by three standard errors."""
# Least errors of what is found from a resonance inside a sample or from a lag, and of every parameter by the clock:
# calibrated on a simulation in steps of 1/200 sample.
_LEAST = {
    "resonance.frequency_hz": 1e-3,
    "resonance.damping_ratio": 3e-2,
    MASS_RATIO: 4e-2,
    "amplifier_bandwidth_hz": 1e-2,
    LOOP_RATIO: 1e-2,
}


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


def cross_validation(fit: Fit) -> FloatArray:
    """Return the squared error of each block, m^2, under the fit to the others: one Gauss-Newton step from this."""
    whole, scale = _curvature(fit)
    gradient = np.sum([block.gradient for block in fit.blocks], axis=0)
    squares = []
    for block in fit.blocks:
        rest = (whole - block.curvature) / scale / scale[:, None]
        step = -np.linalg.lstsq(rest, (gradient - block.gradient) / scale, rcond=1e-10)[0] / scale
        squares.append(block.square + 2 * block.gradient @ step + step @ block.curvature @ step)
    return np.array(squares) * fit.unit_m**2


def compare(simple: Fit, rich: Fit, rung: str) -> Trial:
    """Return whether a richer model predicts held-out data better, on the same blocks."""
    one, other = cross_validation(simple), cross_validation(rich)
    size = float(np.sum(one)) or 1.0
    least = 1e-12 * size / one.size
    # Where a simple model fails in a few blocks, their gains differ by orders of magnitude: then the logarithm decides.
    gains = (one - other, np.log((one + least) / (other + least)))
    sure = max(float(np.mean(gain)) / (float(stats.sem(gain)) or 1e-300) for gain in gains)
    change = -float(np.sum(gains[0])) / size
    return Trial(rung, sure > 3 and -change > WORTH, change, sure)


def collinearity(fit: Fit) -> float:
    """Return 1/sqrt of the smallest eigenvalue of the normalised sensitivities: above 100 some are confounded."""
    whole, scale = _curvature(fit)
    return 1 / math.sqrt(max(float(np.linalg.eigvalsh(whole / scale / scale[:, None])[0]), 1e-16))


def bootstrap(fit: Fit) -> FloatArray:
    """Return half the 95 % interval of each coordinate: blocks drawn anew move the estimate by a Gauss-Newton step."""
    gradients = np.array([block.gradient for block in fit.blocks])
    curvatures = np.array([block.curvature for block in fit.blocks])
    _, scale = _curvature(fit)
    count = len(fit.blocks)
    random = np.random.default_rng(20)
    # At a bound the gradient does not vanish; it is no measure of the spread.
    gradients = gradients - gradients.mean(axis=0)
    moves = []
    for _ in range(500):
        draw = random.integers(0, count, count)
        curvature = curvatures[draw].sum(axis=0) / scale / scale[:, None]
        moves.append(-np.linalg.lstsq(curvature, gradients[draw].sum(axis=0) / scale, rcond=1e-12)[0] / scale)
    deviation = np.std(moves, axis=0, ddof=1) * math.sqrt(count / max(1, count - 1))
    return np.asarray(stats.t.ppf(0.975, max(1, count - 1)) * deviation)


def half_widths(predictor: Predictor, fit: Fit, window: Window, rivals: Mapping[str, Fit]) -> FloatArray:
    """Return half the interval of each coordinate, shape (free,): bootstrap, other observers and rungs, clock."""
    half = bootstrap(fit)
    rate, slowest, fastest = fit.observer.rate_per_s, slowest_observer(predictor), 1 / predictor.sample_time_s
    # A wrong model has other estimates under other observers.
    rates = {min(max(rate * by, slowest), fastest) for by in (3.0, 0.4, 0.12)} - {rate}
    others = [evaluate(predictor, fit.structure, fit.search, Observer(other), window) for other in sorted(rates)]
    shifts = [_beyond_chance(fit, other) for other in others]
    scatter = max(record.scatter for record in predictor.records)
    clock = max(1e-5, scatter**2 / 6)
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
    """Return what the model leaves out inside a sample: dry friction assumes a velocity that decays evenly there."""
    values = fit.values
    angle = 0.0
    if fit.structure.present("resonance.frequency_hz"):
        angle = 2 * math.pi * values["resonance.frequency_hz"] * period
    bend = (values["damping_ns_per_m"] / values["mass_kg"] * period) ** 2 + angle**2
    # Friction changes by twice its level where the motor reverses; means over a sample of a curved and of a linear
    # course differ by a twelfth of the curvature.
    share = fit.turning * values[FRICTION] / fit.structure.units[FRICTION] * bend / 6
    error = {
        "mass_kg": share,
        "delay_samples": (share / angle if angle else share) + late_samples(values, fit.structure.order, period) * 1e-2,
        "resonance.frequency_hz": share,
        "resonance.damping_ratio": share / values["resonance.damping_ratio"],
        MASS_RATIO: 4 * share / values[MASS_RATIO],
    }
    return np.array(
        [
            max(error.get(one.name, share * abs(q) if one.kind == "linear" else 0.0), _LEAST.get(one.name, 0.0))
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
    apart = np.zeros(fit.search.size)
    for index, name in enumerate(fit.structure.names):
        # A bandwidth is another number of another kind of amplifier.
        if name in widths and name != "amplifier_bandwidth_hz":
            value, width = widths[name]
            if name == "delay_samples" and not late_samples(fit.values, fit.structure.order, period):
                value = value + late_samples(rival.values, rival.structure.order, period)
            apart[index] = abs(value - fit.search[index]) + (width if rung == "friction" else 0.0)
    return apart
