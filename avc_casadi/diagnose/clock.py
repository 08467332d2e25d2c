"""The clocks of a log: the steps of its time stamps, and the ticks at which its force is new."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import signal

from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray

_USUAL_STEP_QUANTILE = 0.1
"""Quantile of the steps of time that is a step without a missed tick."""

_USUAL_STEP_SCATTER = 0.3
"""Steps that differ from that quantile by less than this share count for the usual step."""

_BETWEEN_TICKS = (1.3, 1.7)
"""Steps, in periods, that are neither one tick nor two: only a clock that scatters has them."""

_TWO_TICKS = (1.7, 2.5)
"""Steps, in periods, that are of two ticks."""

_CLEAN_CLOCK_SHARE = 0.1
"""Steps between one tick and two, per step of two ticks, up to which the clock does not scatter."""

_FEWEST_FORCES = 4
"""Different forces below which a force is that of a relay and not held."""

_FEWEST_CHANGES = 12
"""Changes of the force below which a log does not tell whether it is held."""

_MOVES_PER_NEW_FORCE = 1.3
"""Changes of the position per change of the force up to which the force is not held."""

_MOVES_PER_UNEVEN_FORCE = 1.1
"""The same for a clock whose ticks are no samples, which is told by every change."""

_SHORTEST_CLOCK = 1.2
"""Shortest period of such a clock, samples."""

_LONGEST_CLOCK = 120.0
"""Longest period of such a clock, samples."""

_FINE_SPECTRUM = 8
"""Frequencies that are looked at, per frequency that a log resolves."""

_SPECTRAL_LINES = 8
"""Strongest lines in the spectrum of the changes of a force that may be its clock or a multiple of it."""

_FEWEST_TICKS = 4
"""Fewest ticks of a clock in a log."""

_REFINEMENTS = 5
"""Times that the period of a clock is searched more finely."""

_TRIALS = 41
"""Periods that are tried in each of them."""

_LEAST_SURE = 12.0
"""ln of the odds against changes at random from which on a clock is one."""

_ROUNDING = 1e-9
"""Share of a sample that is rounding."""

_LONGEST_HOLD = 8
"""Samples up to which a hold is always searched; beyond it, up to the median time between two changes."""

_ONE_PHASE_SHARE = 0.95
"""Share of events that have one phase where they come every so many ticks."""


def usual_step(steps: FloatArray) -> float:
    """Return the step of time from one row to the next where none is missed, s."""
    short = float(np.quantile(steps, _USUAL_STEP_QUANTILE))
    return float(np.mean(steps[np.abs(steps - short) < _USUAL_STEP_SCATTER * short]))


def ticks_between(steps: FloatArray, usual: float) -> IndexArray:
    """Return the number of ticks from row to row of a log, from the steps of its time and a usual one, s.

    Rows that are missing count as ticks. A clock that scatters has steps of 1.5 periods too, which count as one.
    """

    def share_of(limits: tuple[float, float], period: float) -> float:
        low, high = limits
        return float(np.mean((steps > low * period) & (steps < high * period)))

    median = float(np.median(steps))
    for period in (usual, median):
        if share_of(_BETWEEN_TICKS, period) <= _CLEAN_CLOCK_SHARE * share_of(_TWO_TICKS, period):
            return np.maximum(np.round(steps / period), 1).astype(np.intp)
    missed_from = _TWO_TICKS[1]
    return np.where(steps < missed_from * median, 1, np.round(steps / median)).astype(np.intp)


@dataclass(frozen=True)
class Clock:
    """The ticks of a law in samples of a log: tick m is at first + m period, and its force is new a part later."""

    period: float = 1.0
    """Samples from tick to tick."""
    first: float = 0.0
    """Time of the first tick, samples from the first one of the log."""

    @property
    def even(self) -> bool:
        """Whether each tick is at a sample."""
        return self.period.is_integer()

    def times(self, samples: int) -> FloatArray:
        """Return the times of the ticks in a log of so many samples, shape (n,), samples."""
        count = math.floor((samples - 1 - self.first) / self.period + _ROUNDING) + 1
        return np.asarray(self.first + self.period * np.arange(count), dtype=np.float64)

    def rows(self, samples: int) -> IndexArray:
        """Return the first sample that has the force of each tick, shape (n,)."""
        return np.ceil(self.times(samples) - _ROUNDING).astype(np.intp)


def clock_of(position: FloatArray, force: FloatArray) -> Clock:
    """Return the clock of a force that is held while the position changes (no relay), else that of the samples.

    `position` and `force` are those at the samples; the clock has its period and first tick in samples.
    """
    moves = np.diff(position) != 0
    changes = np.flatnonzero(np.diff(force) != 0) + 1
    if np.unique(force).size < _FEWEST_FORCES or changes.size < _FEWEST_CHANGES:
        return Clock()
    moves_a_change = np.count_nonzero(moves) / changes.size
    if moves_a_change > _MOVES_PER_NEW_FORCE:
        longest = max(_LONGEST_HOLD, round(float(np.median(np.diff(changes)))))
        even = even_phase(changes, longest)
        if even is not None:
            return Clock(float(even[0]), float(even[1]))
    return (_uneven_clock(changes) if _holds(force, moves) else None) or Clock()


def _holds(force: FloatArray, moves: BoolArray) -> bool:
    """Return whether a force holds while the position moves, where it is neither none nor at its limits.

    At its limits, and in a dead zone, a force that is new at every sample holds too, from one swing to the next.
    """
    inside = (force != 0) & (force < force.max()) & (force > force.min())
    pairs = inside[1:] & inside[:-1]
    changes = np.count_nonzero(np.diff(force)[pairs]) or 1
    return bool(np.count_nonzero(moves & pairs) > _MOVES_PER_UNEVEN_FORCE * changes)


def _uneven_clock(changes: IndexArray) -> Clock | None:
    """Return the slowest clock whose ticks are no samples and of which all changes are, or None.

    Tick m is seen at ceil(first + m period), so that the samples of all changes, less m period, differ by less than 1.
    Changes at random do so with a probability of period^-changes.
    """
    span = int(changes[-1] - changes[0]) + 1
    train = np.zeros(span)
    train[changes - changes[0]] = 1.0
    size = 1 << (_FINE_SPECTRUM * span - 1).bit_length()
    spectrum = np.abs(np.fft.rfft(train - train.mean(), size))
    lowest = max(int(size / _LONGEST_CLOCK), _FEWEST_TICKS * size // span)
    peaks = lowest + signal.find_peaks(spectrum[lowest:])[0]
    strongest = peaks[np.argsort(spectrum[peaks])[::-1][:_SPECTRAL_LINES]] / size
    # Samples show a clock above half of their rate by its mirror.
    lines = [*(strongest[:, None] / [1, 2, 3]).ravel().tolist(), *(1 - strongest).tolist()]
    clocks = [_clock_near(changes, line) for line in lines]
    return max((clock for clock in clocks if clock is not None), key=lambda clock: clock.period, default=None)


def _clock_near(changes: IndexArray, frequency: float) -> Clock | None:
    """Return the clock of changes of the force near a frequency, ticks a sample; None where too many are none of it.

    `changes` are the samples at which the force changes. A line through them gives period and phase.
    """
    turn = float(np.angle(np.sum(np.exp(2j * np.pi * frequency * changes)))) / (2 * np.pi)
    ticks = np.round(changes * frequency - turn)
    if not np.ptp(ticks):
        return None
    period = _period_near(float(np.polyfit(ticks, changes, 1)[0]), changes, ticks)
    late = np.sort(changes - period * ticks)
    inside = np.searchsorted(late, late + 1 - _ROUNDING) - np.arange(late.size)
    start = int(np.argmax(inside))
    sure = changes.size * math.log(max(period, 1.0)) > _LEAST_SURE
    if not sure or period < _SHORTEST_CLOCK or inside[start] < _ONE_PHASE_SHARE * late.size:
        return None
    # The first tick lies in the middle of the times that all changes allow.
    first = (late[start] + late[start + int(inside[start]) - 1] - 1) / 2
    if abs(period - round(period)) * float(np.ptp(ticks)) < 1:
        return None
    # The tick before the first sample is the one whose force the log begins with.
    return Clock(period, float(first % period))


def _period_near(period: float, changes: IndexArray, ticks: FloatArray) -> float:
    """Return the period near one with which the changes of a force, less their ticks, differ the least.

    Where all differ by less than a sample it is the middle of all periods that do so; else a few changes are left out.
    """
    reach = 2.0 / float(np.ptp(ticks))
    for share in (1.0, _ONE_PHASE_SHARE):
        ends = [(1 - share) / 2, (1 + share) / 2]
        width = reach
        for _ in range(_REFINEMENTS):
            trials = period + width * np.linspace(-1.0, 1.0, _TRIALS)
            low, high = np.quantile(changes - np.outer(trials, ticks), ends, axis=1)
            period, width = float(trials[np.argmin(high - low)]), width / 8
        trials = period + reach * np.linspace(-1.0, 1.0, 10 * _TRIALS + 1)
        low, high = np.quantile(changes - np.outer(trials, ticks), ends, axis=1)
        possible = trials[high - low < 1]
        if possible.size:
            return float(possible.mean())
    return period


def even_phase(events: IndexArray, most: int) -> tuple[int, int] | None:
    """Return the ticks from one event to the next, where nearly all have one phase, and the phase.

    `events` are the ticks of the events; `most` is the longest time between two, ticks.
    """
    for ticks in range(most, 1, -1):
        phases = np.bincount(events % ticks, minlength=ticks)
        if phases.max() >= _ONE_PHASE_SHARE * events.size:
            return ticks, int(np.argmax(phases))
    return None
