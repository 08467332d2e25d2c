"""Eigenvalues of many small matrices, on two processors; roots and minima of many functions at once."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np

from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi._util.parallel import processors

# Fewer matrices take less time than starting a thread.
_MANY = 48


def eigenvalues(matrices: FloatArray) -> ComplexArray:
    """Return the eigenvalues of matrices, shape (..., s, s), as shape (..., s)."""
    flat = matrices.reshape(-1, *matrices.shape[-2:])
    if len(flat) < _MANY or processors() == 1:
        return np.asarray(np.linalg.eigvals(matrices), dtype=np.complex128)
    half = len(flat) // 2
    other = _helper().submit(np.linalg.eigvals, flat[half:])
    both = np.concatenate([np.linalg.eigvals(flat[:half]), other.result()])
    return np.asarray(both.reshape(matrices.shape[:-1]), dtype=np.complex128)


def largest_eigenvalue(matrices: FloatArray) -> ComplexArray:
    """Return the eigenvalue of largest modulus of each matrix, shape (...) of (..., s, s)."""
    values = eigenvalues(matrices)
    largest = np.argmax(np.abs(values), axis=-1)[..., None]
    return np.asarray(np.take_along_axis(values, largest, axis=-1)[..., 0])


def largest_radius(loop: FloatArray) -> FloatArray:
    """Return the spectral radius of each loop, shape (...) for loops (..., s, s)."""
    return np.asarray(np.abs(eigenvalues(loop)).max(axis=-1))


@cache
def _helper() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(1)


# Repeated raising to the power 4; loops exceeded by another drop out from the first of these on.
_FIRST, _ROUNDS = 5, 11
# For smaller matrices eigenvalues are as quick.
_LARGE = 10
# Rounding error of the logarithm of the radius by powers; traces smaller than this relative to a power's largest
# element may be rounding.
_LOST, _LEAST_TRACE = 1e-7, 1e-5


def leading_radii(loops: FloatArray) -> FloatArray:
    """Return the spectral radii of those loops (n, s, s) that may have the largest one; of others minus infinity.

    The radius r of an (s, s) matrix M lies between powers: abs(trace(M^N)) / s <= r^N <= s max(abs(M^N)). A product
    takes a fiftieth of the time of eigenvalues.
    """
    s = loops.shape[-1]
    if s < _LARGE:
        return largest_radius(loops)
    left = np.arange(len(loops))
    power, logarithm, times = loops, np.zeros(len(loops)), 1
    for done in range(1, _ROUNDS + 1):
        power = power @ power
        power = power @ power
        times *= 4
        if done >= _FIRST:
            power = _balanced(power)
        largest = np.maximum(np.maximum(power.max(axis=(1, 2)), -power.min(axis=(1, 2))), np.finfo(np.float64).tiny)
        power = power / largest[:, None, None]
        logarithm = 4 * logarithm + np.log(largest)
        if done >= _FIRST:
            trace = np.abs(np.trace(power, axis1=1, axis2=2))
            known = np.where(trace > _LEAST_TRACE, np.log(np.maximum(trace, _LEAST_TRACE) / s), -np.inf)
            may = (logarithm + np.log(s)) / times + _LOST >= ((logarithm + known) / times).max()
            left, power, logarithm = left[may], power[may], logarithm[may]
    radius = np.full(len(loops), -np.inf)
    radius[left] = largest_radius(loops[left])
    return radius


def _balanced(power: FloatArray) -> FloatArray:
    """Return loops with states scaled so that rows and columns are equally large on average."""
    size = np.abs(power).mean(axis=0) + np.finfo(np.float64).tiny
    # Powers of 2 are exact.
    unit = np.exp2(np.round(np.log2(size.sum(axis=1) / size.sum(axis=0)) / 2))
    return np.asarray(power / unit[:, None] * unit)


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
