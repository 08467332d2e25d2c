"""Roots of many Chebyshev series at once, and refinement of minima by the function itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.support import BoolArray, FloatArray, IndexArray

if TYPE_CHECKING:
    from collections.abc import Callable


_EPS = float(np.finfo(np.float64).eps)
_GOLDEN = (5**0.5 - 1) / 2
# Leaves 2e-7 of the bracket, so that the value, flat there, is right to 4e-14 of its change over the bracket.
_STEPS = 32
_MINIMA = 6
# Eigenvalues cost the cube of the degree.
_MOST_ROOTS = 64


def real_parts_of_roots(rows: FloatArray) -> FloatArray:
    """Real parts of the roots of each row of Chebyshev coefficients, by eigenvalues of colleague matrices."""
    roots = np.ones((rows.shape[0], rows.shape[1] - 1))
    significant = np.abs(rows) > _EPS * np.max(np.abs(rows), axis=1, keepdims=True)
    degrees = np.where(significant.any(axis=1), significant.shape[1] - 1 - np.argmax(significant[:, ::-1], axis=1), 0)
    for degree in np.unique(degrees[degrees > 0]):
        of_degree = np.flatnonzero(degrees == degree)
        matrices = _colleague(rows[of_degree, : degree + 1])
        roots[of_degree, :degree] = np.linalg.eigvals(matrices).real
    return roots


def _colleague(rows: FloatArray) -> FloatArray:
    """Symmetrised colleague matrices, shape (n, degree, degree)."""
    degree = rows.shape[1] - 1
    if degree == 1:
        return np.asarray(-rows[:, :1, None] / rows[:, 1:, None])
    base = np.zeros((degree, degree))
    off = np.full(degree - 1, 0.5)
    off[0] = np.sqrt(0.5)
    base[np.arange(degree - 1), np.arange(1, degree)] = off
    base[np.arange(1, degree), np.arange(degree - 1)] = off
    scale = np.full(degree, np.sqrt(0.5))
    scale[0] = 1.0
    matrices = np.broadcast_to(base, (rows.shape[0], degree, degree)).copy()
    matrices[:, :, -1] -= rows[:, :-1] / rows[:, -1:] * (scale / scale[-1]) * 0.5
    return matrices


def seeds_hz(oscillations: int, nyquist_hz: float) -> FloatArray:
    """Frequencies, shape (m,), that resolve so many half-waves up to Nyquist; many more where no roots are computed."""
    return np.linspace(0.0, nyquist_hz, (4 if has_roots(oscillations) else 24) * oscillations + 1)


def has_roots(degree: int) -> bool:
    """Whether stationary points of this degree are computed as roots; beyond, a fine scan takes their place."""
    return degree <= _MOST_ROOTS


def refine_minima(value: Callable[[FloatArray], FloatArray], points: FloatArray, oscillations: int) -> FloatArray:
    """Golden-section search about the lowest local minima of sorted points; about all that a scan may have left open.

    Args:
        value: frequencies of shape (n, k) to values of the same shape.
        points: shape (n, m), ascending in each row.
        oscillations: half-waves of the value up to Nyquist.

    Returns:
        The points and what the search found, shape (n, m + some).
    """
    values = value(points)
    before, after, first = _neighbours(points)
    below = [values <= np.take_along_axis(values, other, axis=1) for other in (before, after)]
    local = np.where(first & below[0] & below[1], values, np.inf)
    count = min(_MINIMA if has_roots(oscillations) else oscillations // 2 + _MINIMA, points.shape[1])
    chosen = np.argsort(local, axis=1)[:, :count]
    left, right = (np.take_along_axis(points, np.take_along_axis(other, chosen, 1), 1) for other in (before, after))
    centre = np.take_along_axis(points, chosen, axis=1)
    for _ in range(_STEPS):
        step = (1 - _GOLDEN) * np.where(right - centre > centre - left, right - centre, left - centre)
        probe = centre + step
        better = value(probe) < value(centre)
        outer = step > 0
        left = np.where(better & outer, centre, np.where(~better & ~outer, probe, left))
        right = np.where(better & ~outer, centre, np.where(~better & outer, probe, right))
        centre = np.where(better, probe, centre)
    return np.concatenate([points, centre], axis=1)


def _neighbours(points: FloatArray) -> tuple[IndexArray, IndexArray, BoolArray]:
    """Positions of the next lower and the next higher point, and whether each point is the first of its equals.

    Points that were clipped at the end of a band are many and equal: taken for neighbours they leave nothing between
    them, and taken for minima they leave no room for the others.
    """
    size = points.shape[1]
    at = np.broadcast_to(np.arange(size), points.shape)
    first = np.diff(points, axis=1, prepend=-np.inf) > 0
    last = np.diff(points, axis=1, append=np.inf) > 0
    begin = np.maximum.accumulate(np.where(first, at, 0), axis=1)
    end = np.minimum.accumulate(np.where(last, at, size - 1)[:, ::-1], axis=1)[:, ::-1]
    return np.maximum(begin - 1, 0), np.minimum(end + 1, size - 1), first
