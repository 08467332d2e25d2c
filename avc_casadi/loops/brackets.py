"""Roots and minima of many functions at once, each in a bracket of its own; all arrays have one row a function."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from avc_casadi._util.arrays import FloatArray

_STEPS, _ROUNDING = 60, 1e-13
_NINE = np.linspace(0.0, 1.0, 9)


def root(value: Callable[[FloatArray], FloatArray], left: FloatArray, right: FloatArray) -> FloatArray:
    """Return a root in each bracket: false position that halves the weight of a retained end (Illinois)."""
    at_left, at_right = value(left), value(right)
    middle = right
    for _ in range(_STEPS):
        span = at_right - at_left
        share = np.where(span == 0, 0.5, at_right / np.where(span == 0, 1.0, span))
        middle = right - (right - left) * np.where(np.isfinite(share), share, 0.5)
        at_middle = value(middle)
        crossed = np.sign(at_middle) != np.sign(at_right)
        moved = np.abs(middle - right)
        left, at_left = np.where(crossed, right, left), np.where(crossed, at_right, at_left / 2)
        right, at_right = middle, at_middle
        if (moved <= _ROUNDING * np.abs(middle)).all() or not at_middle.any():
            break
    return middle


def lowest(
    value: Callable[[FloatArray], FloatArray],
    left: FloatArray,
    right: FloatArray,
    zooms: int,
    known: FloatArray | None = None,
) -> FloatArray:
    """Return the place of the lowest value in each bracket, that of a known point at least."""
    rows = np.arange(len(left))
    for _ in range(zooms):
        points = left[:, None] + (right - left)[:, None] * _NINE
        if known is not None:
            points = np.sort(np.concatenate([points, known[:, None]], axis=1))
        found = np.argmin(value(points), axis=1)
        best: FloatArray = points[rows, found]
        left, right = points[rows, np.maximum(found - 1, 0)], points[rows, np.minimum(found + 1, points.shape[1] - 1)]
        known = None if known is None else best
    return best
