"""Detection of a limit cycle over a few encoder counts until the end of a log, by its reversals.

Short pulses of one count, as of a limit cycle beside the edge between two, have their power in harmonics: no line of
their spectrum is as high as a count. Their reversals are evenly spaced all the same. Those of noise at the edge are
random, and a slow motion passes the counts in one direction. A few cycles with long contact after them are those of a
touch.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi.identification.diagnosis.log import Log

_MOST_STEPS = 8.0
_FEWEST_CYCLES = 8
# The cycle length scatters by this share at most; that of noise by more than half.
_EVEN = 0.35
# Cycles within this ratio of the length of the last ones still belong to them, and those that go no further than this.
_SHORTER, _LONGER, _FURTHER = 0.5, 1.7, 1.5
# A decaying oscillation has a smaller amplitude in the later half of its last cycles.
_GOES_ON = 0.8
# So many cycles may be missing at the end of the log.
_MISSING = 2.0


@dataclass(frozen=True)
class CountLimitCycle:
    """A limit cycle of the position over a few counts.

    Attributes:
        first, last: its first and last sample.
        cycle: mean length of a cycle, samples.
        scatter: relative standard deviation of that length.
        steps: counts peak to peak, the median of its cycles.
    """

    first: int
    last: int
    cycle: float
    scatter: float
    steps: float


def find_count_limit_cycle(log: Log) -> CountLimitCycle | None:
    """Return the limit cycle in contact that lasts until the log ends, or None.

    Args:
        log: on its tick grid; None without a lattice of positions.
    """
    n = log.position_m.size
    if not log.encoder_m:
        return None
    counts = np.round(log.position_m / log.encoder_m)
    turns = _turns(counts)
    if turns.size <= _FEWEST_CYCLES:
        return None
    cycles = np.diff(turns)
    far = np.maximum.reduceat(counts, turns)[:-1] - np.minimum.reduceat(counts, turns)[:-1]
    usual, reach = (float(np.median(values[-_FEWEST_CYCLES:])) for values in (cycles, far))
    like = (
        (cycles > _SHORTER * usual)
        & (cycles < _LONGER * usual)
        & (far <= max(_FURTHER * reach, reach + 1))
        & _pushed(log, turns)
    )
    unlike = np.flatnonzero(~like)
    begin = int(unlike[-1]) + 1 if unlike.size else 0
    cycles, far = cycles[begin:], far[begin:]
    if cycles.size < _FEWEST_CYCLES or n - turns[-1] > _MISSING * usual or reach > _MOST_STEPS:
        return None
    scatter = float(np.std(cycles) / np.mean(cycles))
    early, late = np.array_split(far[-2 * _FEWEST_CYCLES :], 2)
    if scatter > _EVEN or late.mean() < _GOES_ON * early.mean():
        return None
    return CountLimitCycle(int(turns[begin]), n, float(np.mean(cycles)), scatter, float(np.median(far)))


def _turns(counts: FloatArray) -> IndexArray:
    """Return the samples at which the position rises again after it fell."""
    change = np.flatnonzero(np.diff(counts) != 0)
    up = counts[change + 1] > counts[change]
    return np.asarray(change[1:][up[1:] & ~up[:-1]] + 1)


def _pushed(log: Log, turns: IndexArray) -> BoolArray:
    """Return the cycles in which the force changes: otherwise the loop does not drive the motion."""
    force = log.force_n
    swing = np.maximum.reduceat(force, turns)[:-1] - np.minimum.reduceat(force, turns)[:-1]
    return np.asarray(swing > 1e-9 * float(np.abs(force).max(initial=1e-300)))


# So few cycles are those of a touch, where contact continues for so long after them, and for as many of their cycles.
_FEW_CYCLES, _AFTER_S = 8.0, 1.0
# Least travel of an oscillation against its drift in a cycle, encoder steps.
_BACK_STEPS = 0.5


def passes(log: Log, first: int, last: int, hertz: float) -> bool:
    """Return whether a few cycles, as of a touch, are followed by long contact.

    Args:
        log: on its tick grid, without a tick missed.
        first: sample at which the oscillation begins.
        last: sample at which it ends.
        hertz: of the oscillation.
    """
    touching = np.count_nonzero(log.touching[last:]) * log.ticks.period_s
    few = hertz * (last - first) * log.ticks.period_s < _FEW_CYCLES
    return bool(log.ticks.missed_share == 0 and few and touching > _AFTER_S and touching * hertz > _FEW_CYCLES)


def goes_back(log: Log, first: int, last: int, hertz: float) -> bool:
    """Return whether a position goes back in every cycle, as that of an oscillation does.

    A hand that moves a device on over friction and encoder steps brings it from one to the next, and never back.

    Args:
        log: on its tick grid.
        first: sample at which the oscillation begins.
        last: sample at which it ends.
        hertz: of the oscillation.
    """
    moved = np.diff(log.position_m[first:last])
    back_m = min(float(moved[moved > 0].sum()), -float(moved[moved < 0].sum()))
    cycles = hertz * (last - first) * log.ticks.period_s
    return not log.encoder_m or back_m > _BACK_STEPS * log.encoder_m * cycles
