"""Prediction error fit of one model structure: least squares, with gradient and curvature at the minimum."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from avc_casadi._util.arrays import FloatArray, IndexArray
from avc_casadi.identification.linear import linear_step, taps_of
from avc_casadi.identification.predictor import Observer, Predictor
from avc_casadi.identification.record import shortened
from avc_casadi.identification.terms import PLAY, Structure

_MOST_STEPS = 30
# A record is judged from so many seconds on, or from this share of it: by then the initial state must have decayed, but
# for e^-8 of a state that may be a centimetre off.
_START_S = 1.0
_START_SHARE = 0.1
_FORGOTTEN = 8.0
# A period of repeated data is cut into so many parts, none shorter than so many samples.
_PARTS, _SHORTEST_PART = 25, 5
CLOCK = 1e-5
"""Relative accuracy of an even clock."""
# Of a clock with jitter of standard deviation s samples the mean square of a step is 1 + s^2 of an even one's;
# parameters are known to this share of s^2: errors of devices under clocks of 100 to 400 Hz and s = 0.3 were up to 0.6
# of it.
_SCATTERED = 1 / 6
# Errors and slopes beyond it are those of a diverging model.
_LOST = 1e100


@dataclass(frozen=True, eq=False)
class Block:
    """Contribution of a stretch of a record: squared error, gradient and curvature.

    Attributes:
        record: index of its record.
        samples: number of samples.
        square: sum of e^2.
        gradient: J'e, shape (free,).
        curvature: J'J, shape (free, free).
    """

    record: int
    samples: int
    square: float
    gradient: FloatArray
    curvature: FloatArray


@dataclass(frozen=True, eq=False)
class Fit:
    """A model structure at its least-squares estimate.

    Attributes:
        structure: terms.
        search: coordinates of the free parameters.
        observer: of the disturbance.
        error_m: prediction error of each record after its start.
        blocks: stretches of the records.
        unit_m: unit of the blocks' errors.
        noise_share: share of the error's variance that is measurement noise.
        turning: share of samples in which the model's motion reverses.
        taking_up: share of samples in which the device reverses and takes up backlash.
        sample_time_s: T.
        repeated: whether a block holds the same part of several repeats.
        clock: relative accuracy of the log's clock, and so of every parameter.
    """

    structure: Structure
    search: FloatArray
    observer: Observer
    error_m: tuple[FloatArray, ...]
    blocks: tuple[Block, ...]
    unit_m: float
    noise_share: float
    turning: float
    taking_up: float
    sample_time_s: float
    repeated: bool
    clock: float = CLOCK

    @property
    def values(self) -> dict[str, float]:
        """Values of all parameters."""
        return self.structure.values(self.search)

    @property
    def resampled(self) -> bool:
        """Whether its records were laid evenly from a clock that scatters."""
        return self.clock > CLOCK

    @property
    def hides_play(self) -> bool:
        """Whether its backlash is below the residual of encoder and noise."""
        return self.structure.present(PLAY) and self.values[PLAY] < self.rms_m

    @property
    def rms_m(self) -> float:
        """Root mean square of the prediction error."""
        return float(np.sqrt(np.mean(np.concatenate(self.error_m) ** 2)))


@dataclass(frozen=True)
class Window:
    """Partition of the records into blocks.

    Attributes:
        skip: samples at the start of each record that are not judged.
        block: samples of a block.
        repeats: period of each record at which it repeats to the encoder's step, samples, or 0; a block of it holds the
            same part of every repeat, whose errors are the same. Empty where none repeats.
    """

    skip: int
    block: int
    repeats: tuple[int, ...] = ()

    @classmethod
    def of(cls, sizes: Sequence[int], period: float, repeats: tuple[int, ...] = ()) -> Window:
        """Choose the blocks: at least 30 where the records are long enough, of a second at most."""
        total = sum(sizes)
        block = int(min(max(total // 40, 0.1 / period), 2.0 / period, min(sizes) // 2))
        return cls(skip=int(min(_START_S / period, _START_SHARE * min(sizes))), block=max(block, 20), repeats=repeats)

    def parts(self, record: int, size: int) -> list[IndexArray]:
        """Return the samples of each block of a record, counted from the first that is judged."""
        repeat = self.repeats[record] if self.repeats else 0
        samples = np.arange(size)
        if not repeat:
            return np.array_split(samples, max(1, size // self.block))
        count = min(_PARTS, max(1, repeat // _SHORTEST_PART))
        part = samples % repeat * count // repeat
        return [samples[part == one] for one in range(min(count, int(part.max()) + 1))]


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
    steps: int = _MOST_STEPS,
    tolerance: float = 1e-8,
) -> Fit:
    """Minimise the squared prediction error by Gauss-Newton steps in a trust region.

    Args:
        predictor: of the records.
        structure: terms.
        start: initial guess of each free parameter.
        observer: of the prediction.
        window: which samples are judged.
        steps: maximum number of evaluations.
        tolerance: relative change of the sum of squares at which the search ends.
    """
    low, high = structure.bounds()
    inside = 1e-9 * np.maximum(1.0, np.abs(np.where(np.isfinite(low), low, 0.0)))
    begin = np.clip(structure.start(start), low + inside, high - inside)
    cache: dict[bytes, tuple[FloatArray, FloatArray]] = {}
    unit: list[float] = []

    def both(search: FloatArray) -> tuple[FloatArray, FloatArray]:
        key = search.tobytes()
        if key not in cache:
            cache.clear()
            found = predictor.predict(structure, search, observer)
            e = np.concatenate([one.error_m[window.skip :] for one in found])
            j = np.concatenate([one.slopes[window.skip :] for one in found if one.slopes is not None])
            if all(bool((np.abs(part) < _LOST).all()) for part in (e, j)):
                if not unit:
                    unit.append(float(np.sqrt(np.mean(e**2))) or 1.0)
                cache[key] = e / unit[0], j / unit[0]
            else:
                cache[key] = np.full_like(e, 1e3), np.zeros_like(j)
        return cache[key]

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
    for index, one in enumerate(found):
        assert one.slopes is not None  # noqa: S101 - they were asked for
        error, slopes = errors[index] / unit, _bounded(one.slopes[window.skip :]) / unit
        for part in window.parts(index, error.size):
            e, j = error[part], slopes[part]
            blocks.append(Block(index, e.size, float(e @ e), j.T @ e, j.T @ j))
    values = structure.values(search)
    step = linear_step(values, structure, predictor.sample_time_s, taps_of(values), parts=0)
    _, share = observer.gain(step, values["mass_kg"], predictor.sample_time_s)
    turning = _turning([record.position_m[window.skip :] for record in predictor.records], errors)
    taking_up = 0.0
    if structure.present(PLAY) and predictor.last_went is not None:
        taking_up = float(np.mean(np.abs(np.concatenate(predictor.last_went)) < 1))
    return Fit(
        structure,
        search,
        observer,
        errors,
        tuple(blocks),
        unit,
        share,
        turning,
        taking_up,
        predictor.sample_time_s,
        any(window.repeats),
        max(max(CLOCK, _SCATTERED * record.scatter**2) for record in predictor.records),
    )


def _bounded(numbers: FloatArray) -> FloatArray:
    """Clip the output of a diverging model to numbers that can be squared."""
    return np.nan_to_num(np.clip(numbers, -_LOST, _LOST), nan=_LOST)


def _turning(positions: Sequence[FloatArray], errors: Sequence[FloatArray]) -> float:
    """Return the share of samples in which the predicted motion reverses."""
    steps = [np.diff(position - error) for position, error in zip(positions, errors, strict=True)]
    return float(np.mean(np.concatenate([one[1:] * one[:-1] < 0 for one in steps])))


def best_observer(predictor: Predictor, found: Fit, window: Window) -> Observer:
    """Return the observer rate that minimises the prediction error."""
    slowest = slowest_observer(predictor)
    fastest = 1.0 / predictor.sample_time_s
    rates = np.geomspace(slowest, fastest, max(4, int(np.ceil(2 * np.log2(fastest / slowest))) // 2))

    def square(rate: float) -> float:
        errors = predictor.predict(found.structure, found.search, Observer(rate), slopes=False)
        return float(sum(np.sum(one.error_m[window.skip :] ** 2) for one in errors))

    squares = [square(float(rate)) for rate in rates]
    best = int(np.nanargmin(squares))
    near = [float(np.sqrt(rates[best] * rates[other])) for other in (best - 1, best + 1) if 0 <= other < rates.size]
    choices = [(squares[best], float(rates[best])), *((square(rate), rate) for rate in near)]
    return Observer(min(choices)[1])


FIRST_RATE_PER_S = 60.0
"""Observer rate of a search from a distant initial guess."""
# Samples from which a final fit may start.
_ROUGH_SAMPLES = 10_000


def richer(structure: Structure, *terms: str) -> Structure:
    """Return a model with added terms."""
    assumed = {} if "resonance" in terms else structure.assumed
    return replace(structure, terms=structure.ordered((*structure.terms, *terms)), assumed=assumed)


def roughly(predictor: Predictor, structure: Structure, start: Mapping[str, float], rate_per_s: float) -> Fit:
    """Fit coarsely, with a slow observer, to pieces of long records: an initial guess for the final fit.

    Args:
        predictor: of the records.
        structure: terms.
        start: initial guess.
        rate_per_s: of the observer.
    """
    records, _ = shortened(predictor.records, _ROUGH_SAMPLES)
    pieces = predictor.of(records) if len(records) > len(predictor.records) else predictor
    window = Window.of([record.position_m.size for record in pieces.records], pieces.sample_time_s)
    observer = Observer(max(rate_per_s, slowest_observer(pieces)))
    return fit(pieces, structure, start, observer, window, steps=12, tolerance=1e-4)


def closely(predictor: Predictor, found: Fit, window: Window) -> Fit:
    """Fit to all records under the best observer."""
    observer = best_observer(predictor, found, window)
    return fit(predictor, found.structure, found.values, observer, window, steps=10, tolerance=1e-5)


def rms_m_of(found: Fit) -> float:
    """Return the root mean square of the prediction error."""
    return found.rms_m


def ringing_behind_a_lag(predictor: Predictor, simple: Fit, ringing: Fit, lagging: Fit, window: Window) -> Fit:
    """Fit resonance and amplifier together, from their separate estimates."""
    late = {key: lagging.values[key] for key in ("delay_samples", "amplifier_bandwidth_hz")}
    both = richer(simple.structure, "resonance", "amplifier")
    structure = replace(
        both, encoder_at=ringing.structure.encoder_at, amplifier_order=lagging.structure.amplifier_order
    )
    start = {**ringing.values, **late}
    found = roughly(predictor, structure, start, min(simple.observer.rate_per_s, FIRST_RATE_PER_S))
    return closely(predictor, found, window)
