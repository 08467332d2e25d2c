"""Samples of a log that are none: rows without a number, and positions that jump away for one sample."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi._util.text import number
from avc_casadi._util.units import units_for

if TYPE_CHECKING:
    from avc_casadi.identification.record import Columns

# Share of samples that may be lost; more of them are something else.
_FEW = 0.01
_NONE = "without a number"
# A jump of this share of all that a position covers, beside samples that move by this share of it; of so many of its
# smallest steps at least: an encoder that goes to and fro between a few counts covers no more than those.
_MOST, _HARDLY, _COUNTS = 0.5, 0.1, 8.0
# Moves below this share of all that is covered are what arithmetic leaves.
_ROUNDED = 1e-6
# A position stands alone where it lies so many times as far from the line between its neighbours as others do, and so
# many encoder steps; and where the lines beside it, which it bends by half as much, are straight otherwise.
_ALONE, _STEPS, _STRAIGHT = 20.0, 5.0, 0.3


def left_out(columns: Columns) -> tuple[Columns, list[str]]:
    """Leave out samples that were lost, where they are few: they become gaps.

    Returns:
        The log, and what the user should know.
    """
    none, alone = _lost(columns)
    told = [*_told(columns, none, _NONE, "left out"), *_told(columns, alone, _jumps(columns, alone), "left out")]
    if not told:
        return columns, told
    kept, lines = ~(none | alone), columns.line
    whole = replace(
        columns,
        time_s=columns.time_s[kept],
        position_m=columns.position_m[kept],
        force_n=columns.force_n[kept],
        line=None if lines is None else [line for line, there in zip(lines, kept, strict=True) if there],
    )
    return whole, told


def filled(columns: Columns) -> tuple[Columns, list[str]]:
    """Fill in rows without a number, where they are few: times and positions on a line, forces held.

    A position that jumps away and back stays: the computer that made a force of it saw it too.

    Returns:
        The log, and what the user should know.
    """
    none, alone = _lost(columns)
    told = [*_told(columns, none, _NONE, "filled in"), *_told(columns, alone, _jumps(columns, alone), "kept")]
    if not none.any():
        return columns, told
    row = np.arange(none.size)
    there = row[~none]
    last = np.maximum.accumulate(np.where(none, there[0], row))
    whole = replace(
        columns,
        time_s=np.where(np.isfinite(columns.time_s), columns.time_s, np.interp(row, there, columns.time_s[there])),
        position_m=np.interp(row, there, columns.position_m[there]),
        force_n=columns.force_n[last],
    )
    return whole, told


def _lost(columns: Columns) -> tuple[BoolArray, BoolArray]:
    """Return which rows hold no number, and which positions stand alone; none of a kind that is not few."""
    none = ~(np.isfinite(columns.time_s) & np.isfinite(columns.position_m) & np.isfinite(columns.force_n))
    alone = _alone(np.where(none, np.nan, columns.position_m))
    most = max(1.0, _FEW * none.size)
    none, alone = (part & (np.count_nonzero(part) <= most) for part in (none, alone))
    return none, alone


def _told(columns: Columns, lost: BoolArray, what: str, done: str) -> list[str]:
    if not lost.any():
        return []
    count, line = int(np.count_nonzero(lost)), columns.at(int(np.argmax(lost)))
    where = "" if line is None else f", the first in line {line}"
    return [f"{columns.file}: {count} sample{'' if count == 1 else 's'} {what} {done}{where}"]


def _jumps(columns: Columns, alone: BoolArray) -> str:
    if not alone.any():
        return ""
    size = float(np.abs(_bend(columns.position_m)[alone]).max())
    unit = units_for(columns.motion).text("m")
    return f"whose position jumps away and back by up to {number(size, 3)} {unit}"


def wrapped(position: FloatArray, time_s: FloatArray) -> IndexArray:
    """Return the rows at which a position has jumped over most of what it covers, and stays there: a counter wraps.

    Args:
        position: measured, shape (rows,).
        time_s: shape (rows,).
    """
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
    """Return how far each position lies from the line between its neighbours; 0 at the ends."""
    bend = np.zeros(position.size)
    bend[1:-1] = position[1:-1] - (position[:-2] + position[2:]) / 2
    return bend


def _alone(position: FloatArray) -> BoolArray:
    """Return where a position stands alone: nothing that has a mass jumps away and back within two samples."""
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
