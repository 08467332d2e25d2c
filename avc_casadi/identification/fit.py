"""Prediction error fit of one model structure: least squares, with gradient and curvature at the minimum."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from avc_casadi._util.arrays import FloatArray
from avc_casadi.identification.log import shortened
from avc_casadi.identification.predictor import Observer, Predictor
from avc_casadi.identification.terms import Structure

# A record is judged from so many seconds on, or from this share of it: by then the initial state must have decayed, but
# for e^-8 of a state that may be a centimetre off.
_START_S, _START_SHARE, _FORGOTTEN = 1.0, 0.1, 8.0
# Errors and slopes beyond it are those of a diverging model.
_LOST = 1e100
FIRST_RATE_PER_S = 60.0
"""Observer rate of a search from a distant start."""
_ROUGH_SAMPLES = 10_000


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
    return _FORGOTTEN / min(_START_S, _START_SHARE * shortest)


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
            found = predictor.predict(structure, search, observer)
            e = np.concatenate([one.error_m[window.skip :] for one in found])
            j = np.concatenate([one.slopes[window.skip :] for one in found])
            if (np.abs(e) < _LOST).all() and (np.abs(j) < _LOST).all():
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
        solved = least_squares(
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
    return judged(predictor, structure, solved.x, observer, window)


def judged(predictor: Predictor, structure: Structure, search: FloatArray, observer: Observer, window: Window) -> Fit:
    """Return a structure at given coordinates with the contribution of each block."""
    found = predictor.predict(structure, search, observer)
    errors = tuple(_bounded(one.error_m[window.skip :]) for one in found)
    unit = float(np.sqrt(np.mean(np.concatenate(errors) ** 2))) or 1.0
    blocks = []
    for one, error in zip(found, errors, strict=True):
        slopes = _bounded(one.slopes[window.skip :]) / unit
        count = max(1, error.size // window.block)
        for e, j in zip(np.array_split(error / unit, count), np.array_split(slopes, count), strict=True):
            blocks.append(Block(e.size, float(e @ e), j.T @ e, j.T @ j))
    moves = [
        np.diff(record.position_m[window.skip :] - error)
        for record, error in zip(predictor.records, errors, strict=True)
    ]
    turning = float(np.mean(np.concatenate([one[1:] * one[:-1] < 0 for one in moves])))
    return Fit(structure, search, observer, errors, tuple(blocks), unit, turning)


def _bounded(numbers: FloatArray) -> FloatArray:
    """Clip the output of a diverging model to numbers that can be squared."""
    return np.nan_to_num(np.clip(numbers, -_LOST, _LOST), nan=_LOST)


def best_observer(predictor: Predictor, found: Fit, window: Window) -> Observer:
    """Return the observer rate that minimises the prediction error."""
    slowest, fastest = slowest_observer(predictor), 1.0 / predictor.sample_time_s
    rates = list(np.geomspace(slowest, fastest, max(4, int(np.ceil(2 * np.log2(fastest / slowest))) // 2)))

    def square(rate: float) -> float:
        errors = predictor.predict(found.structure, found.search, Observer(rate), slopes=False)
        return float(sum(np.sum(one.error_m[window.skip :] ** 2) for one in errors))

    squares = {float(rate): square(rate) for rate in rates}
    best = rates.index(min(squares, key=lambda rate: np.nan_to_num(squares[rate], nan=np.inf)))
    near = (float(np.sqrt(rates[best] * rates[other])) for other in (best - 1, best + 1) if 0 <= other < len(rates))
    squares |= {rate: square(rate) for rate in near}
    return Observer(min(squares, key=lambda rate: np.nan_to_num(squares[rate], nan=np.inf)))


def roughly(predictor: Predictor, structure: Structure, start: Mapping[str, float], rate_per_s: float) -> Fit:
    """Fit coarsely, with a slow observer, to pieces of long records: a start for `closely`."""
    records = shortened(predictor.records, _ROUGH_SAMPLES)
    pieces = Predictor(records, predictor)
    observer = Observer(max(rate_per_s, slowest_observer(pieces)))
    return fit(pieces, structure, start, observer, Window.of(pieces), steps=12, tolerance=1e-4)


def closely(predictor: Predictor, found: Fit, window: Window, steps: int = 10, tolerance: float = 1e-5) -> Fit:
    """Fit to all records under the best observer."""
    observer = best_observer(predictor, found, window)
    return fit(predictor, found.structure, found.values, observer, window, steps=steps, tolerance=tolerance)
