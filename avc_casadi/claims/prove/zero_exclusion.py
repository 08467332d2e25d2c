"""Branch and bound: prove that a complex function has no zero in a box, cell by cell.

In a cell, F(p) = F(centre) + sum of slope times distance (mean value form, slopes enclosed over the cell). To first
order the values fill a zonotope; it misses 0 where a half plane through 0 does, and then one whose edge runs along a
generator. That half plane is chosen in plain floating point and checked in intervals.

A stored proof over hands consists of cells without a zero, and one loop whose eigenvalues are counted.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol

import numpy as np

from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray, IndexArray
from avc_casadi.claims.prove.frozen_loop import FrozenGains, FrozenLoop
from avc_casadi.claims.prove.interval import ComplexInterval, Interval, Jet

_LEAF = "."


class Cover(NamedTuple):
    """Partition of a box into cells.

    Attributes:
        cuts: the tree, each box before its halves, lower half first: the index of the bisected side, or a dot for a
            cell.
        order: the cells in the order of the dots, shape (n,).
    """

    cuts: str
    order: IndexArray


def cover_of(low: FloatArray, high: FloatArray, cell_low: FloatArray, cell_high: FloatArray) -> Cover | None:
    """Return how cells fill a box by bisection, along any side that cuts no cell; None where they do not.

    Args:
        low: lower corner of the box, shape (v,).
        high: upper corner.
        cell_low: lower corners of the cells, shape (v, n).
        cell_high: upper corners.
    """
    waiting = [(low, high, np.arange(cell_low.shape[1]))]
    cuts, order = [], []
    while waiting:
        first, last, some = waiting.pop()
        if not len(some):
            return None
        if len(some) == 1:
            one = int(some[0])
            if (cell_low[:, one] > first).any() or (cell_high[:, one] < last).any():
                return None
            cuts.append(_LEAF)
            order.append(one)
            continue
        middle = _middle(first, last)
        below, above = cell_high[:, some] <= middle[:, None], cell_low[:, some] >= middle[:, None]
        clean = np.flatnonzero((below | above).all(axis=1) & (last > first))
        if not clean.size:
            return None
        side = int(clean[0])
        cuts.append(str(side))
        for lower in (False, True):
            half = (below if lower else above)[side]
            waiting.append((*_half(first, last, side, lower=lower), some[half]))
    return Cover("".join(cuts), np.array(order, dtype=np.intp))


def cells_of(low: FloatArray, high: FloatArray, cuts: str) -> tuple[FloatArray, FloatArray]:
    """Return the corners of the cells of a partition, (v, n) each, in the order of the dots.

    Raises:
        ValueError: no tree of cuts.
    """
    waiting, cells = [(low, high)], []
    for letter in cuts:
        if not waiting or not (letter == _LEAF or (letter.isdecimal() and int(letter) < len(low))):
            raise ValueError(f"{letter!r} is no cut of a box with {len(low)} sides")
        first, last = waiting.pop()
        if letter == _LEAF:
            cells.append((first, last))
            continue
        waiting += [_half(first, last, int(letter), lower=lower) for lower in (False, True)]
    if waiting or not cells:
        raise ValueError("the tree of cuts does not end")
    lows, highs = zip(*cells, strict=True)
    return np.stack(lows, axis=1), np.stack(highs, axis=1)


def _half(low: FloatArray, high: FloatArray, side: int, *, lower: bool) -> tuple[FloatArray, FloatArray]:
    ends = low.copy(), high.copy()
    ends[1 if lower else 0][side] = _middle(low, high)[side]
    return ends


def _middle(low: FloatArray, high: FloatArray) -> FloatArray:
    return np.asarray(0.5 * low + 0.5 * high)


_AT_ONCE = 8192
# Few cells are split more than once at a time: each round costs some milliseconds whatever its size.
_FEW = 512
_MOST_SPLITS = 5


class Enclosed(Protocol):
    """Interface of functions of v variables, one a row, that can be enclosed."""

    def over(self, cells: Interval, rows: IndexArray) -> Jet[ComplexInterval]:
        """Enclose values and slopes over cells, shape (v, n), of the rows (n,) that they belong to."""

    def at(self, points: FloatArray, rows: IndexArray) -> ComplexInterval:
        """Enclose values at points, shape (v, n), of the rows (n,) that they belong to."""


@dataclass(frozen=True)
class Cells:
    """Cells, each with a half plane Re(F conj(direction)) > 0 that contains all its values.

    Attributes:
        low: lower ends, shape (v, n).
        high: upper ends, shape (v, n).
        direction: shape (n,); not a number where none was found.
        row: the function of each cell, shape (n,).
    """

    low: FloatArray
    high: FloatArray
    direction: ComplexArray
    row: IndexArray

    def __len__(self) -> int:
        return len(self.row)

    @classmethod
    def joined(cls, parts: list[Cells]) -> Cells:
        """Concatenate lists of cells."""
        return cls(
            np.concatenate([part.low for part in parts], axis=1),
            np.concatenate([part.high for part in parts], axis=1),
            np.concatenate([part.direction for part in parts]),
            np.concatenate([part.row for part in parts]),
        )

    def pick(self, some: BoolArray | slice) -> Cells:
        """Return some of the cells."""
        return Cells(self.low[:, some], self.high[:, some], self.direction[some], self.row[some])

    def of_row(self, row: int) -> Cells:
        """Return those of one row, which becomes row 0."""
        mine = self.pick(self.row == row)
        return replace(mine, row=np.zeros(len(mine), dtype=np.intp))

    @classmethod
    def boxes(cls, low: FloatArray, high: FloatArray, row: IndexArray) -> Cells:
        """Return boxes as cells without half planes."""
        return cls(low, high, np.full(len(row), np.nan, dtype=np.complex128), row)


@dataclass(frozen=True)
class Exclusion:
    """Result of a search.

    Attributes:
        excluded: cells without a zero.
        open: undecided cells; the proof is complete where there are none.
        looked_at: number of evaluated cells.
    """

    excluded: Cells
    open: Cells
    looked_at: int


def excludes(function: Enclosed, cells: Cells) -> BoolArray:
    """Return whether the half plane of each cell provably contains all values of the function there, shape (n,)."""
    return _held(*_first_order(function, cells), cells.direction)


def exclude_zeros(
    function: Enclosed,
    boxes: Cells,
    budget: int,
    on_round: Callable[[Cells], BoolArray] = lambda left: np.ones(len(left), dtype=bool),
) -> Exclusion:
    """Split boxes until no cell can contain a zero.

    Args:
        function: the functions.
        boxes: one or more boxes of each row.
        budget: largest number of evaluated cells, of all rows together.
        on_round: called with undecided cells; returns which to continue with.
    """
    waiting, done, given_up = boxes, [boxes.pick(slice(0, 0))], [boxes.pick(slice(0, 0))]
    looked_at = 0
    while len(waiting) and looked_at < budget:
        now, waiting = waiting.pick(slice(-_AT_ONCE, None)), waiting.pick(slice(None, -_AT_ONCE))
        looked_at += len(now)
        centre, slopes, reach = _first_order(function, now)
        direction = _directions(centre, slopes, reach)
        held = _held(centre, slopes, reach, direction)
        done.append(replace(now, direction=direction).pick(held))
        left, weight = now.pick(~held), _weights(slopes, reach)[:, ~held]
        if len(left):
            wanted = on_round(left)
            given_up.append(left.pick(~wanted))
            times = 1 + sum(len(left) << more <= _FEW for more in range(1, _MOST_SPLITS))
            waiting = Cells.joined([waiting, _split(left.pick(wanted), weight[:, wanted], times)])
    return Exclusion(Cells.joined(done), Cells.joined([*given_up, waiting]), looked_at)


def _first_order(function: Enclosed, cells: Cells) -> tuple[ComplexInterval, ComplexInterval, FloatArray]:
    """Return F at the centres (n,), the slopes over the cells (v, n) and the half widths, rounded up (v, n)."""
    box = Interval.of(cells.low, cells.high)
    centre = box.middle
    reach = np.maximum((box - centre).high, -(box - centre).low)
    return function.at(centre, cells.row), function.over(box, cells.row).slope, reach


def _held(centre: ComplexInterval, slopes: ComplexInterval, reach: FloatArray, direction: ComplexArray) -> BoolArray:
    """Return whether Re(F conj(direction)) > 0 provably in each cell."""
    real, imag = np.real(direction), np.imag(direction)
    near = centre.real * real + centre.imag * imag
    spread = (abs(slopes.real * real + slopes.imag * imag) * reach).sum(axis=0)
    return np.asarray((near - spread).low > 0)


def _directions(centre: ComplexInterval, slopes: ComplexInterval, reach: FloatArray) -> ComplexArray:
    """Return the half planes with the largest margin, shape (n,)."""
    c = centre.real.middle + 1j * centre.imag.middle
    generators = slopes.real.middle + 1j * slopes.imag.middle
    with np.errstate(invalid="ignore", divide="ignore"):
        candidates = np.concatenate([c[None], 1j * generators])
        candidates = candidates / np.abs(candidates)
        candidates = np.where(np.isfinite(candidates), candidates, 1.0)
        along = np.real(c * np.conj(candidates))
        candidates = candidates * np.where(along < 0, -1.0, 1.0)
        real, imag = np.abs(candidates.real)[:, None], np.abs(candidates.imag)[:, None]
        turned = np.abs(np.real(generators * np.conj(candidates)[:, None]))
        loose = 0.5 * (real * slopes.real.width + imag * slopes.imag.width)
        room = np.abs(along) - ((turned + loose) * reach).sum(axis=1)
    best = np.argmax(np.where(np.isnan(room), -np.inf, room), axis=0)
    return np.asarray(np.take_along_axis(candidates, best[None], axis=0)[0])


def _weights(slopes: ComplexInterval, reach: FloatArray) -> FloatArray:
    """Return the spread of the values by each side of a cell, shape (v, n)."""
    with np.errstate(invalid="ignore"):
        spread = np.hypot(slopes.real.magnitude, slopes.imag.magnitude) * reach
    return np.asarray(np.where(np.isnan(spread), np.where(reach > 0, np.inf, 0.0), spread))


def _split(cells: Cells, weight: FloatArray, times: int) -> Cells:
    """Bisect the side with the most weight, repeatedly."""
    low, high, row_of = cells.low, cells.high, cells.row
    for _ in range(times):
        side = np.argmax(weight, axis=0)
        row = (side, np.arange(len(side)))
        middle = 0.5 * low[row] + 0.5 * high[row]
        first_high, second_low = high.copy(), low.copy()
        first_high[row], second_low[row] = middle, middle
        low, high = np.concatenate([low, second_low], axis=1), np.concatenate([first_high, high], axis=1)
        weight = weight.copy()
        weight[row] *= 0.5
        weight, row_of = np.concatenate([weight, weight], axis=1), np.concatenate([row_of, row_of])
    return Cells.boxes(low, high, row_of)


_CLEAR_TURN = 3.0
_TURN_TOLERANCE = 1e-3
# Digits of a stored half plane's angle; the few cells close to the limit keep all.
_ANGLE_DIGITS = 3
TOP = float(np.nextafter(np.pi, 4.0))
"""End of the upper half of the unit circle, rad: the function is symmetric beyond."""


@dataclass(frozen=True)
class Piece:
    """Proof for delays between two whole numbers of samples; rows of cells as in `Enclosed` functions.

    Attributes:
        whole_delay: samples of delay, less the fraction.
        fraction: of the delay; None where it is a row of the cells.
        low: lower corner of the box, shape (v,): angle, rad; total moving mass, kg; damping; stiffness; fraction.
        high: upper corner.
        cells: cells that fill the box, none of which contains a zero.
        member: cells along the unit circle at one point of the box.
    """

    whole_delay: int
    fraction: float | None
    low: FloatArray
    high: FloatArray
    cells: Cells
    member: Cells

    def replays(self, gains: FrozenGains) -> bool:
        """Return whether the stored cells prove it."""
        loop = FrozenLoop(gains, self.whole_delay, self.fraction)
        cells, member = (replace(one, row=np.zeros(len(one), dtype=np.intp)) for one in (self.cells, self.member))
        inside = (member.low[1:] >= self.low[1:, None]) & (member.high[1:] <= self.high[1:, None])
        thin = member.low[1:] == member.high[1:]
        whole = self.low[0] == 0.0 and self.high[0] == TOP
        return bool(
            whole
            and inside.all()
            and thin.all()
            and (member.low[1:] == member.low[1:, :1]).all()
            and cover_of(self.low, self.high, cells.low, cells.high) is not None
            and excludes(loop, cells).all()
            and excludes(loop, member).all()
            and all_inside(loop, member)
        )

    def document(self, gains: FrozenGains) -> dict[str, Any]:
        """Return JSON values; `from_document` reads them. Cells are stored as a tree of cuts."""
        loop = FrozenLoop(gains, self.whole_delay, self.fraction)
        point = self.member.low[1:, 0]
        ends = np.array([0.0, *point]), np.array([TOP, *point])
        return {
            "whole_delay": self.whole_delay,
            "fraction": self.fraction,
            "low": self.low.tolist(),
            "high": self.high.tolist(),
            "cells": _cells_document(loop, self.low, self.high, self.cells),
            "point": point.tolist(),
            "member": _cells_document(loop, *ends, self.member),
        }

    @classmethod
    def from_document(cls, found: Mapping[str, Any]) -> Piece:
        """Read the output of `document`.

        Raises:
            ValueError: the document is no valid cover.
        """
        low, high, point = (np.array(found[name], dtype=np.float64) for name in ("low", "high", "point"))
        fraction = found["fraction"]
        return cls(
            int(found["whole_delay"]),
            None if fraction is None else float(fraction),
            low,
            high,
            _cells_from(low, high, found["cells"]),
            _cells_from(np.array([0.0, *point]), np.array([TOP, *point]), found["member"]),
        )


def all_inside(loop: FrozenLoop, line: Cells) -> bool:
    """Return whether the argument of F grows by 2 pi along the cells: all eigenvalues lie inside the unit circle."""
    order = np.argsort(line.low[0], kind="stable")
    low, high = line.low[:, order], line.high[:, order]
    if not len(line) or low[0, 0] != 0.0 or high[0, -1] != TOP or (low[0, 1:] != high[0, :-1]).any():
        return False
    points = np.concatenate([low, high[:, -1:]], axis=1)
    value = loop.at(points, np.zeros(points.shape[1], dtype=np.intp))
    number = value.real.middle + 1j * value.imag.middle
    # Both ends of a cell lie in one half plane: the argument between them is the principal one.
    turn = np.angle(number[1:] * np.conj(number[:-1]))
    whole = abs(float(turn.sum()) - 2 * np.pi) < _TURN_TOLERANCE
    return bool(np.isfinite(turn).all() and (np.abs(turn) < _CLEAR_TURN).all() and whole)


def _cells_document(loop: FrozenLoop, low: FloatArray, high: FloatArray, cells: Cells) -> dict[str, Any]:
    cover = cover_of(low, high, cells.low, cells.high)
    if cover is None:
        raise ValueError("the cells do not fill their box")
    first = replace(cells, row=np.zeros(len(cells), dtype=np.intp))
    angle = np.angle(cells.direction)
    short = np.round(angle, _ANGLE_DIGITS)
    angle = np.where(excludes(loop, replace(first, direction=_turned(short))), short, angle)
    return {"cuts": cover.cuts, "half_plane_rad": angle[cover.order].tolist()}


def _cells_from(low: FloatArray, high: FloatArray, found: Mapping[str, Any]) -> Cells:
    lows, highs = cells_of(low, high, found["cuts"])
    angle = np.array(found["half_plane_rad"], dtype=np.float64)
    if angle.shape != lows.shape[1:]:
        raise ValueError(f"{lows.shape[1]} cells with {len(angle)} half planes")
    return Cells(lows, highs, _turned(angle), np.zeros(len(angle), dtype=np.intp))


def _turned(angle: FloatArray) -> ComplexArray:
    return np.asarray(np.exp(1j * angle))
