"""Preprocessing of a log: outliers, lost rows, clock jitter, rows and stamps that are no ticks.

A force is held from the tick that commands it to the next, or from a later tick to the one after that, so that its
effect on a mass over an even sample is that of its mean there. Positions between ticks are those of a cubic spline;
parameters are known to s^2/6 under steps with a jitter of s.
"""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import make_interp_spline

from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi._util.text import number

if TYPE_CHECKING:
    from avc_casadi.identification.record import Columns


# Share of samples that may be lost; more are another fault.
_FEW = 0.01
_NONE, _ALONE_TOLD = "without a number", "whose position jumps away and back"
# Squares of larger values may overflow.
_LARGEST = 1e100
# An outlier jumps by this share of the range of a position, where samples move by this share of it; by so many of its
# smallest steps at least: an encoder that goes to and fro between a few counts has no larger range.
_MOST, _HARDLY, _COUNTS = 0.5, 0.1, 8.0
# Moves below this share of the range are rounding errors.
_ROUNDED = 1e-6
# A position is an outlier where it lies so many times as far from the line between its neighbours as others do, and so
# many encoder steps; and where the neighbouring deviations, half as large, vanish without it.
_ALONE, _STEPS, _STRAIGHT = 20.0, 5.0, 0.3


def sound(values: FloatArray) -> BoolArray:
    """Return which values are finite and can be squared."""
    return np.asarray(np.abs(values) < _LARGEST)


def left_out(columns: Columns) -> Columns:
    """Remove lost samples, where they are few: they become gaps."""
    none, alone = _lost(columns)
    told = (*_told(columns, none, _NONE, "left out"), *_told(columns, alone, _ALONE_TOLD, "left out"))
    return replace(columns.rows(~(none | alone)), told=(*columns.told, *told)) if told else columns


def filled(columns: Columns) -> Columns:
    """Fill in rows without a number, where they are few: times and positions linearly, forces held.

    An outlier of the position is kept: the controller that computed the force saw it too.
    """
    none, alone = _lost(columns)
    told = (*columns.told, *_told(columns, none, _NONE, "filled in"), *_told(columns, alone, _ALONE_TOLD, "kept"))
    if not none.any():
        return replace(columns, told=told)
    row = np.arange(none.size)
    there = row[~none]
    known = sound(columns.force_n)
    last = np.maximum.accumulate(np.where(known, row, row[known][0]))
    return replace(
        columns,
        time_s=np.where(np.isfinite(columns.time_s), columns.time_s, np.interp(row, there, columns.time_s[there])),
        position_m=np.interp(row, there, columns.position_m[there]),
        force_n=columns.force_n[last],
        told=told,
        filled=none,
    )


def _lost(columns: Columns) -> tuple[BoolArray, BoolArray]:
    """Return the rows without a number, and the outliers of the position; none of a kind that is not rare."""
    none = ~(sound(columns.time_s) & sound(columns.position_m) & sound(columns.force_n))
    alone = _alone(np.where(none, np.nan, columns.position_m))
    most = min(max(1.0, _FEW * none.size), none.size - 1)
    none, alone = (part & (np.count_nonzero(part) <= most) for part in (none, alone))
    return none, alone


def _told(columns: Columns, lost: BoolArray, what: str, done: str) -> list[str]:
    if not lost.any():
        return []
    count, line = int(np.count_nonzero(lost)), columns.at(int(np.argmax(lost)))
    where = "" if line is None else f", the first in line {line}"
    return [f"{columns.file}: {count} sample{'' if count == 1 else 's'} {what} {done}{where}"]


def wrapped(position: FloatArray, time_s: FloatArray) -> IndexArray:
    """Return the rows of a counter overflow: the position jumps over most of its range, and stays there."""
    moves, steps = np.abs(np.diff(position)), np.diff(time_s)
    covers = float(np.ptp(position))
    counted = moves[moves > _ROUNDED * covers]
    if moves.size < 3 or not counted.size:
        return np.zeros(0, dtype=np.intp)
    far = max(_MOST * covers, _COUNTS * float(counted.min()))
    beside = np.maximum(np.append(0.0, moves[:-1]), np.append(moves[1:], 0.0))
    even = steps < 1.5 * float(np.median(steps))
    return np.flatnonzero(even & (moves > far) & (beside < _HARDLY * moves)) + 1


def _bend(position: FloatArray) -> FloatArray:
    """Return the distance of each position from the line between its neighbours; 0 at the ends."""
    bend = np.zeros(position.size)
    bend[1:-1] = position[1:-1] - (position[:-2] + position[2:]) / 2
    return bend


def _alone(position: FloatArray) -> BoolArray:
    """Return the outliers of the position: no mass jumps away and back within two samples."""
    if position.size < 5:
        return np.zeros(position.size, dtype=bool)
    bend = np.nan_to_num(_bend(position))
    apart = np.abs(np.diff(position))
    moved = apart[apart > 0]
    step = float(moved.min()) if moved.size else 0.0
    large = np.abs(bend) > max(_ALONE * float(np.quantile(np.abs(bend), 0.99)), _STEPS * step)
    found = np.zeros(position.size, dtype=bool)
    for row in np.flatnonzero(large[2:-2]) + 2:
        sides, beyond = bend[[row - 1, row + 1]] + bend[row] / 2, bend[[row - 2, row + 2]]
        found[row] = np.abs(np.concatenate([sides, beyond])).max() <= _STRAIGHT * abs(bend[row])
    return found


# A delay that is counted in ticks is tried up to so many.
_MOST_TICKS = 4
# Longer steps are a gap: a host that is late by more has not run its loop.
LONGEST_STEP = 6.0


def laid_evenly(columns: Columns, period_s: float) -> tuple[Columns, float, FloatArray]:
    """Resample a log with clock jitter to even samples, with its gaps as they are.

    Returned are the log, the standard deviation of the steps as a share of the period, and the mean forces if they act
    0, 1, 2, ... ticks after they are logged, brought forward by as many even samples, shape (ticks, samples).
    """
    time = columns.time_s
    steps = np.diff(time)
    edges = [0, *(np.flatnonzero(steps > LONGEST_STEP * period_s) + 1), time.size]
    evenly, positions, later = [], [], []
    for one in (slice(a, b) for a, b in itertools.pairwise(edges) if b - a > 4):
        at = np.arange(time[one][0], time[one][-1] - 0.5 * period_s, period_s)
        evenly.append(at)
        positions.append(make_interp_spline(time[one], columns.position_m[one], k=3)(at))
        later.append(_mean_held(time[one], columns.force_n[one], at, period_s))
    scatter = float(np.std(steps[steps <= LONGEST_STEP * period_s]))
    told = (
        f"{columns.file}: its steps of time scatter by {number(1e3 * scatter, 2)} ms about "
        f"{number(1e3 * period_s, 3)} ms; where only the stamps scatter, --sample-time says so"
    )
    laid = replace(
        columns,
        time_s=np.concatenate(evenly),
        position_m=np.concatenate(positions),
        force_n=np.concatenate(later, axis=1)[0],
        line=None,
        told=(*columns.told, told),
    )
    return laid, scatter / period_s, np.concatenate(later, axis=1)


def _mean_held(time_s: FloatArray, force_n: FloatArray, at_s: FloatArray, period_s: float) -> FloatArray:
    """Return the mean force over each even sample, held from tick to tick and some late, shape (ticks, samples)."""
    found = []
    for late in range(_MOST_TICKS + 1):
        begun = time_s[late:]
        impulse = np.concatenate([[0.0], np.cumsum(force_n[: begun.size - 1] * np.diff(begun))])
        # Before the first force has arrived it is that force, and after the last tick the last.
        edges = np.append(at_s, at_s[-1] + period_s) + late * period_s
        until = np.interp(edges, begun, impulse)
        until += np.minimum(edges - begun[0], 0.0) * force_n[0]
        until += np.maximum(edges - begun[-1], 0.0) * force_n[begun.size - 1]
        found.append(np.diff(until) / period_s)
    return np.array(found)
