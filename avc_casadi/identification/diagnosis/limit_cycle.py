"""A position that goes to and fro between a few counts until the log ends, told by its turns and not by a line.

Short pulses of one count, as a limit cycle leaves that sits beside the edge between two, have their power in harmonics:
no line of their spectrum is as high as a count. Their turns come evenly all the same. Noise at the edge turns at
random, and a slow motion passes the counts one way. A few cycles with long contact after them are those of a touch.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi.identification.diagnosis.log import Log

_MOST_STEPS = 8.0
_FEWEST_CYCLES = 8
# From cycle to cycle its length scatters by this share at most; the turns of noise by more than half.
_EVEN = 0.35
# Cycles whose length is this share of the last ones' still belong to them, and those that go no further than this.
_SHORTER, _LONGER, _FURTHER = 0.5, 1.7, 1.5
# What dies away goes less far in the later half of its last cycles.
_GOES_ON = 0.8
# At the end of the log so many cycles may be missing.
_MISSING = 2.0


@dataclass(frozen=True)
class Toggling:
    """A position that goes to and fro.

    Attributes:
        first, last: samples between which it does.
        cycle: mean length of a cycle, samples.
        scatter: standard deviation of that length, as a share.
        steps: counts that it goes, from its lowest to its highest, the middle one of its cycles.
    """

    first: int
    last: int
    cycle: float
    scatter: float
    steps: float


def find_toggling(log: Log) -> Toggling | None:
    """Return how a position goes to and fro in contact until the log ends, or None.

    Args:
        log: on its grid; of one whose positions lie on no lattice nothing is told.
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
    return Toggling(int(turns[begin]), n, float(np.mean(cycles)), scatter, float(np.median(far)))


def _turns(counts: FloatArray) -> IndexArray:
    """Return the samples at which the position rises again after it fell."""
    change = np.flatnonzero(np.diff(counts) != 0)
    up = counts[change + 1] > counts[change]
    return np.asarray(change[1:][up[1:] & ~up[:-1]] + 1)


def _pushed(log: Log, turns: IndexArray) -> BoolArray:
    """Return in which cycles the force changes: without one it is not the loop that goes to and fro."""
    force = log.force_n
    swing = np.maximum.reduceat(force, turns)[:-1] - np.minimum.reduceat(force, turns)[:-1]
    return np.asarray(swing > 1e-9 * float(np.abs(force).max(initial=1e-300)))


# So few cycles are those of a touch, where contact goes on for so long after them, and for as many of their cycles.
_FEW_CYCLES, _AFTER_S = 8.0, 1.0


def passes(log: Log, begins_s: float, ends_s: float, last: int, hertz: float) -> bool:
    """Return whether a few cycles, as of a touch, are followed by long contact.

    Args:
        log: on its grid, without a tick missed.
        begins_s: of the oscillation.
        ends_s: of the oscillation.
        last: sample at which it ends.
        hertz: of the oscillation.
    """
    touching = np.count_nonzero(log.force_n[last:]) * log.ticks.period_s
    few = hertz * (ends_s - begins_s) < _FEW_CYCLES
    return bool(log.ticks.missed_share == 0 and few and touching > _AFTER_S and touching * hertz > _FEW_CYCLES)
