"""Prediction error fit of one model structure, its evidence and intervals.

The fit minimises the squared prediction error by Gauss-Newton steps in a trust region. Blocks of the records give the
rest: held out one by one they say whether a richer model predicts better, and drawn anew how far the estimate spreads.
Neither fits the model again: a block moves the estimate by one Gauss-Newton step.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.optimize import least_squares

from avc_casadi._util.arrays import FloatArray
from avc_casadi.identification.log import excerpts
from avc_casadi.identification.predictor import Predictor, SteadyObserver
from avc_casadi.identification.terms import FRICTION, LOOP_RATIO, MASS_RATIO, ModelStructure

_START_S = 1.0
"""A record is judged from so many seconds on ..."""
_START_SHARE = 0.1
"""... or from this share of it, if that is sooner."""
_DECAY = 8.0
"""By then the initial state has decayed to e^-8 of itself: it may be a centimetre off."""
_DIVERGENCE = 1e100
"""Errors and slopes beyond it are those of a diverging model, m and m per coordinate."""
_DIVERGED_ERROR = 1e3
"""Error of a diverging model in the search, in units of the first error."""
FIRST_RATE_PER_S = 60.0
"""Observer rate of a search from a distant start, 1/s."""

_MOST_BLOCKS = 40
"""Blocks of long records, about."""
_SHORTEST_BLOCK_S = 0.1
"""Shortest block, s, ..."""
_FEWEST_BLOCK_SAMPLES = 20
"""... and fewest samples of it."""
_LONGEST_BLOCK_S = 2.0
"""Longest block, s."""

_INSIDE_BOUNDS = 1e-9
"""Share of a bound by which a search starts inside it."""
_STEP_TOLERANCE = 1e-9
"""Share of the coordinates below which a step ends the search."""
_GRADIENT_TOLERANCE = 1e-12
"""Scaled gradient below which a search ends."""
_TINY = 1e-300
"""Stands for 0 in a divisor."""

_COARSE_SAMPLES = 10_000
"""Samples of a coarse fit."""
_COARSE_STEPS = 12
"""Most evaluations of a coarse fit."""
_COARSE_TOLERANCE = 1e-4
"""Share of the squared error by which a step of a coarse fit must lower it for the search to go on."""


@dataclass(frozen=True, eq=False)
class Block:
    """Contribution of a stretch of a record: squared error e'e, gradient J'e and curvature J'J.

    Errors e and slopes J are in the unit of the fit, `Fit.unit_m`; the gradient has the shape (free,), the curvature
    (free, free).
    """

    samples: int
    square: float
    gradient: FloatArray
    curvature: FloatArray


@dataclass(frozen=True, eq=False)
class Fit:
    """A model structure at given coordinates.

    `search` has the shape (free,). `error_m` is the judged prediction error of each record, `unit_m` its root mean
    square, which scales the blocks. `turning` is the share of samples in which the modelled device reverses.
    """

    structure: ModelStructure
    search: FloatArray
    observer: SteadyObserver
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
class Partition:
    """Partition of the records: samples at the start that are not judged, and samples of a block."""

    skip: int
    block: int

    @classmethod
    def of(cls, predictor: Predictor) -> Partition:
        """Choose the blocks: at least 30 where the records are long enough, of 0.1 to 2 seconds."""
        sizes = [record.position_m.size for record in predictor.records]
        period_s = predictor.sample_time_s
        shortest = _SHORTEST_BLOCK_S / period_s
        longest = min(_LONGEST_BLOCK_S / period_s, min(sizes) // 2)
        block = int(min(max(sum(sizes) // _MOST_BLOCKS, shortest), longest))
        skip = int(min(_START_S / period_s, _START_SHARE * min(sizes)))
        return cls(skip, max(block, _FEWEST_BLOCK_SAMPLES))


def slowest_observer(predictor: Predictor) -> float:
    """Return the slowest observer rate, 1/s, that lets the initial state of a record decay before it is judged."""
    shortest = min(record.seconds for record in predictor.records)
    return _DECAY / min(_START_S, _START_SHARE * shortest)


class _Objective:
    """Error and slopes of a structure by its search coordinates, in the unit of the first error, once a point."""

    def __init__(self, predictor: Predictor, structure: ModelStructure, observer: SteadyObserver, skip: int) -> None:
        """Set up the prediction error of a structure under an observer, without the first samples of a record."""
        self._predictor = predictor
        self._structure = structure
        self._observer = observer
        self._skip = skip
        self._unit_m: float | None = None
        self._point: bytes | None = None
        self._error: FloatArray = np.zeros(0)
        self._slopes: FloatArray = np.zeros((0, 0))

    def error(self, search: FloatArray) -> FloatArray:
        """Return the prediction error of all judged samples, shape (samples,)."""
        self._move_to(search)
        return self._error

    def slopes(self, search: FloatArray) -> FloatArray:
        """Return the slopes of the error, shape (samples, free)."""
        self._move_to(search)
        return self._slopes

    def _move_to(self, search: FloatArray) -> None:
        """Compute error and slopes at a point of the search coordinates, once; a diverging model has a large error."""
        point = search.tobytes()
        if point == self._point:
            return
        predictions = self._predictor.predict(self._structure, search, self._observer)
        error_m = np.concatenate([prediction.error_m[self._skip :] for prediction in predictions])
        slopes_m = np.concatenate([prediction.slopes[self._skip :] for prediction in predictions])
        if (np.abs(error_m) < _DIVERGENCE).all() and (np.abs(slopes_m) < _DIVERGENCE).all():
            if self._unit_m is None:
                self._unit_m = float(np.sqrt(np.mean(error_m**2))) or 1.0
            self._error, self._slopes = error_m / self._unit_m, slopes_m / self._unit_m
        else:
            self._error, self._slopes = np.full_like(error_m, _DIVERGED_ERROR), np.zeros_like(slopes_m)
        self._point = point


def fit(
    predictor: Predictor,
    structure: ModelStructure,
    start: Mapping[str, float],
    observer: SteadyObserver,
    window: Partition,
    *,
    steps: int = 30,
    tolerance: float = 1e-8,
) -> Fit:
    """Minimise the squared prediction error by Gauss-Newton steps in a trust region.

    Args:
        predictor: of the records.
        structure: the model.
        start: values of its parameters, in SI units.
        observer: that keeps the prediction near the log.
        window: which samples are judged, and their blocks.
        steps: most evaluations of the error.
        tolerance: share of the squared error by which a step must lower it for the search to go on.
    """
    low, high = structure.bounds()
    finite_low = np.where(np.isfinite(low), low, 0.0)
    inside = _INSIDE_BOUNDS * np.maximum(1.0, np.abs(finite_low))
    begin = np.clip(structure.start(start), low + inside, high - inside)
    objective = _Objective(predictor, structure, observer, window.skip)
    # A diverging slope may overflow in a trial step of the solver, which it then rejects.
    with np.errstate(over="ignore"):
        result = least_squares(
            objective.error,
            begin,
            jac=objective.slopes,
            bounds=(low, high),
            x_scale="jac",
            ftol=tolerance,
            xtol=_STEP_TOLERANCE,
            gtol=_GRADIENT_TOLERANCE,
            max_nfev=steps,
        )
    return evaluate(predictor, structure, result.x, observer, window)


def evaluate(
    predictor: Predictor, structure: ModelStructure, search: FloatArray, observer: SteadyObserver, window: Partition
) -> Fit:
    """Return a structure at given coordinates: prediction errors, and error, slope and curvature of each block."""
    predictions = predictor.predict(structure, search, observer)
    errors_m = tuple(_clip(prediction.error_m[window.skip :]) for prediction in predictions)
    unit_m = float(np.sqrt(np.mean(np.concatenate(errors_m) ** 2))) or 1.0
    blocks = []
    for prediction, error_m in zip(predictions, errors_m, strict=True):
        slopes = _clip(prediction.slopes[window.skip :]) / unit_m
        count = max(1, error_m.size // window.block)
        parts = zip(np.array_split(error_m / unit_m, count), np.array_split(slopes, count), strict=True)
        blocks += [Block(e.size, float(e @ e), j.T @ e, j.T @ j) for e, j in parts]
    turning = _turning(predictor, errors_m, window)
    return Fit(structure, search, observer, errors_m, tuple(blocks), unit_m, turning)


def _turning(predictor: Predictor, errors_m: Sequence[FloatArray], window: Partition) -> float:
    """Return the share of samples in which the predicted position reverses."""
    reversals = []
    for record, error_m in zip(predictor.records, errors_m, strict=True):
        moves = np.diff(record.position_m[window.skip :] - error_m)
        reversals.append(moves[1:] * moves[:-1] < 0)
    return float(np.mean(np.concatenate(reversals)))


def _clip(numbers: FloatArray) -> FloatArray:
    """Clip the output of a diverging model to numbers that can be squared."""
    return np.nan_to_num(np.clip(numbers, -_DIVERGENCE, _DIVERGENCE), nan=_DIVERGENCE)


def best_observer(predictor: Predictor, initial: Fit, window: Partition) -> SteadyObserver:
    """Return the observer rate that minimises the prediction error."""
    slowest = slowest_observer(predictor)
    fastest = 1.0 / predictor.sample_time_s
    octaves = np.log2(fastest / slowest)
    rates = list(np.geomspace(slowest, fastest, max(4, int(np.ceil(2 * octaves)) // 2)))

    def square(rate: float) -> float:
        predictions = predictor.predict(initial.structure, initial.search, SteadyObserver(rate), slopes=False)
        return float(sum(np.sum(prediction.error_m[window.skip :] ** 2) for prediction in predictions))

    def known_square(rate: float) -> float:
        """Return the square of a diverging model as the largest."""
        return float(np.nan_to_num(squares[rate], nan=np.inf))

    squares = {float(rate): square(rate) for rate in rates}
    best = rates.index(min(squares, key=known_square))
    neighbours = [place for place in (best - 1, best + 1) if 0 <= place < len(rates)]
    # Half way between the best rate and its neighbours.
    for place in neighbours:
        rate = float(np.sqrt(rates[best] * rates[place]))
        squares[rate] = square(rate)
    return SteadyObserver(min(squares, key=known_square))


def coarse_fit(predictor: Predictor, structure: ModelStructure, start: Mapping[str, float], rate_per_s: float) -> Fit:
    """Fit coarsely, with a slow observer, to pieces of long records: a start for `fine_fit`."""
    records = excerpts(predictor.records, _COARSE_SAMPLES)
    pieces = Predictor(records, predictor)
    observer = SteadyObserver(max(rate_per_s, slowest_observer(pieces)))
    window = Partition.of(pieces)
    return fit(pieces, structure, start, observer, window, steps=_COARSE_STEPS, tolerance=_COARSE_TOLERANCE)


def fine_fit(predictor: Predictor, initial: Fit, window: Partition, steps: int = 10, tolerance: float = 1e-5) -> Fit:
    """Fit to all records under the best observer."""
    observer = best_observer(predictor, initial, window)
    return fit(predictor, initial.structure, initial.values, observer, window, steps=steps, tolerance=tolerance)


WORTH = 2e-3
"""A rung must better the held-out error by this share of it ..."""
_STANDARD_ERRORS = 3
"""... and by so many standard errors."""
_EQUAL_SHARE = 1e-12
"""Share of the mean squared error of a block that is added before logarithms are taken of it."""
_RANK = 1e-10
"""Singular values below this share of the largest count as 0 where a block is held out or moves the estimate."""
_DRAW_RANK = 1e-12
"""The same where blocks are drawn anew."""
_LEAST_EIGENVALUE = 1e-16
"""Smaller eigenvalues of normalised sensitivities are rounding."""

_DRAWS = 500
"""Draws of the bootstrap."""
_SEED = 20
"""Seed of the draws, so that an interval is the same each time."""
_UPPER_QUANTILE = 0.975
"""An interval of 95 % leaves 2.5 % above it."""
_OTHER_OBSERVERS = (3.0, 0.4, 0.12)
"""Rates of other observers that look for a wrong model, in units of the rate of the fit."""
_LEAST_CLOCK_ERROR = 1e-5
"""Least error of every parameter by the clock, as a share of it."""
_LAG_ERROR = 1e-2
"""Error of the delay, as a share of the lag of an amplifier beside it."""
_LEAST_ERRORS = {
    "resonance.frequency_hz": 1e-3,
    "resonance.damping_ratio": 3e-2,
    MASS_RATIO: 4e-2,
    "amplifier_bandwidth_hz": 1e-2,
    LOOP_RATIO: 1e-2,
}
"""Least errors of the coordinates of a resonance and of an amplifier, by what the model leaves out inside a sample.

They and the least error by the clock are calibrated on a simulation in steps of 1/200 sample.
"""


@dataclass(frozen=True)
class FitTrial:
    """A rung that was tried.

    `change` is that of the held-out squared error, as a share of the simpler model's (negative where the rung helps),
    and `standard_errors` how far it is from 0. `why` says why a rung that helps was not taken.
    """

    rung: str
    taken: bool
    change: float
    standard_errors: float
    why: str = ""


def _curvature(fit: Fit) -> tuple[FloatArray, FloatArray]:
    """Return J'J of all blocks, (free, free), and the root of its diagonal, which scales the parameters to one size."""
    total = np.sum([block.curvature for block in fit.blocks], axis=0)
    return total, np.sqrt(np.maximum(np.diag(total), _TINY))


def _normalised(curvature: FloatArray, scale: FloatArray) -> FloatArray:
    """Return a curvature in coordinates of one size."""
    return np.asarray(curvature / scale / scale[:, None])


def cross_validation(fit: Fit) -> FloatArray:
    """Return the squared error of each block, m^2, under the fit to the others, shape (blocks,).

    The fit to the others is one Gauss-Newton step d from this fit, and the error of the held-out block under it
    e'e + 2 d'J'e + d'J'J d.
    """
    total, scale = _curvature(fit)
    gradient = np.sum([block.gradient for block in fit.blocks], axis=0)
    squares = []
    for block in fit.blocks:
        rest = _normalised(total - block.curvature, scale)
        step = -np.linalg.lstsq(rest, (gradient - block.gradient) / scale, rcond=_RANK)[0] / scale
        squares.append(block.square + 2 * block.gradient @ step + step @ block.curvature @ step)
    return np.array(squares) * fit.unit_m**2


def compare(simple: Fit, rich: Fit, rung: str) -> FitTrial:
    """Return whether a richer model predicts held-out blocks better: its gain, and that in standard errors.

    The gain is of squared errors, block by block, and of their logarithms.
    """
    simple_squares = cross_validation(simple)
    rich_squares = cross_validation(rich)
    total = float(np.sum(simple_squares)) or 1.0
    least = _EQUAL_SHARE * total / simple_squares.size
    gains = simple_squares - rich_squares
    # Where a simple model fails in a few blocks, their gains differ by orders of magnitude: then the logarithm decides.
    log_gains = np.log((simple_squares + least) / (rich_squares + least))
    standard_errors = max(_standard_errors(gains), _standard_errors(log_gains))
    change = -float(np.sum(gains)) / total
    return FitTrial(rung, standard_errors > _STANDARD_ERRORS and -change > WORTH, change, standard_errors)


def _standard_errors(gains: FloatArray) -> float:
    """Return how many standard errors the mean of a gain is from 0."""
    return float(np.mean(gains)) / (float(stats.sem(gains)) or _TINY)


def collinearity(fit: Fit) -> float:
    """Return 1/sqrt of the smallest eigenvalue of the normalised sensitivities: above 100 some are confounded."""
    smallest = float(np.linalg.eigvalsh(_normalised(*_curvature(fit)))[0])
    return 1 / math.sqrt(max(smallest, _LEAST_EIGENVALUE))


def bootstrap(fit: Fit) -> FloatArray:
    """Return half the 95 % interval of each coordinate, shape (free,).

    Blocks drawn anew move the estimate by a Gauss-Newton step each time. The interval is Student's, of as many degrees
    of freedom as there are blocks less 1.
    """
    gradients = np.array([block.gradient for block in fit.blocks])
    curvatures = np.array([block.curvature for block in fit.blocks])
    _, scale = _curvature(fit)
    count = len(fit.blocks)
    degrees = max(1, count - 1)
    random = np.random.default_rng(_SEED)
    # At a bound the gradient does not vanish; it is no measure of the spread.
    gradients = gradients - gradients.mean(axis=0)
    moves = []
    for _ in range(_DRAWS):
        draw = random.integers(0, count, count)
        curvature = _normalised(curvatures[draw].sum(axis=0), scale)
        moves.append(-np.linalg.lstsq(curvature, gradients[draw].sum(axis=0) / scale, rcond=_DRAW_RANK)[0] / scale)
    deviation = np.std(moves, axis=0, ddof=1) * math.sqrt(count / degrees)
    return np.asarray(stats.t.ppf(_UPPER_QUANTILE, degrees) * deviation)


def half_widths(predictor: Predictor, fit: Fit, window: Partition, rivals: Mapping[str, Fit]) -> FloatArray:
    """Return half the interval of each coordinate, shape (free,).

    It is the sum of the bootstrap's, of the largest shift under other observers, of what the model leaves out inside a
    sample, and of the clock; and no less than the distance to each rival rung that predicts as well.
    """
    period_s = predictor.sample_time_s
    half = bootstrap(fit)
    half = (
        half + _shift_by_observer(predictor, fit, window) + _inside_a_sample(fit, period_s) + _by_clock(predictor, fit)
    )
    for rung, rival in rivals.items():
        if rival.rms_m <= (1 + WORTH / 2) * fit.rms_m:
            half = np.maximum(half, _apart(fit, rival, rung, period_s))
    return np.asarray(half)


def _shift_by_observer(predictor: Predictor, fit: Fit, window: Partition) -> FloatArray:
    """Return the largest shift of each coordinate under other observers: a wrong model has other estimates there."""
    rate = fit.observer.rate_per_s
    slowest = slowest_observer(predictor)
    fastest = 1 / predictor.sample_time_s
    rates = {min(max(rate * factor, slowest), fastest) for factor in _OTHER_OBSERVERS} - {rate}
    shifts = []
    for other_rate in sorted(rates):
        other_fit = evaluate(predictor, fit.structure, fit.search, SteadyObserver(other_rate), window)
        shifts.append(_beyond_chance(fit, other_fit))
    return np.asarray(np.max(shifts, axis=0))


def _by_clock(predictor: Predictor, fit: Fit) -> list[float]:
    """Return the error of each coordinate by the clock: s^2/6 of the parameter under steps that scatter by s."""
    scatter = max(record.scatter for record in predictor.records)
    share = max(_LEAST_CLOCK_ERROR, scatter**2 / 6)
    pairs = zip(fit.structure.free, fit.search, strict=True)
    return [share * (1.0 if parameter.kind == "log" else abs(q)) for parameter, q in pairs]


def _beyond_chance(fit: Fit, other_fit: Fit) -> FloatArray:
    """Return the shift of the estimate under another observer, less its chance part, shape (free,).

    The chance part is two standard errors of the sum of the blocks' shifts.
    """
    moves = _moves(other_fit) - _moves(fit)
    low, high = fit.structure.bounds()
    shift = np.clip(fit.search + moves.sum(axis=0), low, high) - fit.search
    chance = 2.0 * np.sqrt(len(moves)) * moves.std(axis=0, ddof=1)
    return np.asarray(np.sqrt(np.maximum(shift**2 - chance**2, 0.0)))


def _moves(fit: Fit) -> FloatArray:
    """Return the Gauss-Newton step by each block, shape (blocks, free); they add up."""
    total, scale = _curvature(fit)
    gradients = np.array([block.gradient for block in fit.blocks]).T / scale[:, None]
    steps = np.linalg.lstsq(_normalised(total, scale), gradients, rcond=_RANK)[0] / scale[:, None]
    return np.asarray(-steps.T)


def _inside_a_sample(fit: Fit, period_s: float) -> FloatArray:
    """Return what the model leaves out inside a sample, as an error of each coordinate, shape (free,).

    Dry friction assumes a velocity that decays evenly inside a sample; its curvature there is (b T/m)^2, and that of a
    resonance (w T)^2 besides. Friction changes by twice its level where the motor reverses, and means over a sample of
    a curved and of a linear course differ by a twelfth of the curvature: a sixth of it in all.
    """
    values = fit.values
    angle = 0.0
    if fit.structure.present("resonance.frequency_hz"):
        angle = 2 * math.pi * values["resonance.frequency_hz"] * period_s
    curvature = (values["damping_ns_per_m"] / values["mass_kg"] * period_s) ** 2 + angle**2
    share = fit.turning * values[FRICTION] / fit.structure.units[FRICTION] * curvature / 6
    lag = late_samples(values, fit.structure.order, period_s)
    errors = {
        "mass_kg": share,
        "delay_samples": (share / angle if angle else share) + lag * _LAG_ERROR,
        "resonance.frequency_hz": share,
        "resonance.damping_ratio": share / values["resonance.damping_ratio"],
        MASS_RATIO: 4 * share / values[MASS_RATIO],
    }
    of_coordinates = []
    for parameter, q in zip(fit.structure.free, fit.search, strict=True):
        of_linear = share * abs(q) if parameter.kind == "linear" else 0.0
        error = errors.get(parameter.name, of_linear)
        of_coordinates.append(max(error, _LEAST_ERRORS.get(parameter.name, 0.0)))
    return np.array(of_coordinates)


def late_samples(values: Mapping[str, float], order: int, period_s: float) -> float:
    """Return the lag of the amplifier at low frequencies, samples: 1/(w T) of a lag, 2 z/(w T) of a current loop."""
    if math.isnan(values["amplifier_bandwidth_hz"]):
        return 0.0
    radians = 1.0 if order == 1 else 2 * values[LOOP_RATIO]
    return radians / (2 * math.pi * values["amplifier_bandwidth_hz"] * period_s)


def _apart(fit: Fit, rival: Fit, rung: str, period_s: float) -> FloatArray:
    """Return how far a rung that was not taken moves each coordinate, (u,); a lag beside none counts in the delay."""
    rival_search = dict(zip(rival.structure.names, rival.search, strict=True))
    rival_half = dict(zip(rival.structure.names, bootstrap(rival), strict=True))
    apart = np.zeros(fit.search.size)
    for index, name in enumerate(fit.structure.names):
        # A bandwidth is another number of another kind of amplifier.
        if name not in rival_search or name == "amplifier_bandwidth_hz":
            continue
        q = rival_search[name]
        if name == "delay_samples" and not late_samples(fit.values, fit.structure.order, period_s):
            q = q + late_samples(rival.values, rival.structure.order, period_s)
        apart[index] = abs(q - fit.search[index]) + (rival_half[name] if rung == "friction" else 0.0)
    return apart
