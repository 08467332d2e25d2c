"""Cells that fill a box by halving, written as the cuts that made them: a letter or two for a cell, not its corners."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from avc_casadi.support import FloatArray, IndexArray

_LEAF = "."


class Cover(NamedTuple):
    """How cells fill a box.

    Attributes:
        cuts: the tree, each box before its halves, lower half first: the number of the side that is halved, or a dot
            for a cell.
        order: the cells in the order of the dots, shape (n,).
    """

    cuts: str
    order: IndexArray


def cover_of(low: FloatArray, high: FloatArray, cell_low: FloatArray, cell_high: FloatArray) -> Cover | None:
    """Tell how cells fill a box: by halving it, along any side that cuts no cell; None where they do not.

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
    """Return the corners of the cells that cuts make of a box, (v, n) each, in the order of the dots.

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
