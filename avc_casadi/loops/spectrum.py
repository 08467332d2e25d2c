"""Poles of many closed loops, on two processors, but for those of rest; roots and minima of many functions at once."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi._util.parallel import processors

_OTHER = ThreadPoolExecutor(1)
# What maps lose to rounding, relative to their terms.
_ROUNDING = 1e-11
# A speed that changes by less than this in a period stays.
_STEADY = 1e-9
# Products of maps beyond this overflow, or soon do: their loops count as unstable.
_OVERFLOWING = 1e60
# Loops of fewer states, and so few loops: their eigenvalues are as quick as powers.
_FEW_STATES = 10
_FEW_LOOPS = 8
# Rounds in which loops are raised to the power 4, and the first one from which on loops drop out that another exceeds.
_ROUNDS = 11
_FIRST_ROUND = 5
# Rounding of the logarithm of a radius by powers; traces smaller than this relative to a power's largest term may be
# rounding.
_LOGARITHM_ROUNDING = 1e-7
_LEAST_TRACE = 1e-5


def eigenvalues(matrices: FloatArray) -> ComplexArray:
    """Return the eigenvalues of matrices, shape (..., s, s), as shape (..., s); of many by two threads."""
    flat = matrices.reshape(-1, *matrices.shape[-2:])
    # Fewer matrices take less time than starting a thread.
    if len(flat) < 48 or processors() == 1:
        return np.asarray(np.linalg.eigvals(matrices), dtype=np.complex128)
    half = len(flat) // 2
    second_half = _OTHER.submit(np.linalg.eigvals, flat[half:])
    values = np.concatenate([np.linalg.eigvals(flat[:half]), second_half.result()])
    return np.asarray(values.reshape(matrices.shape[:-1]), dtype=np.complex128)


@dataclass(frozen=True, eq=False)
class ClosedLoops:
    """Closed loops: maps of the state over a period (..., s, s), and states of rest (k, ..., s).

    The rests are those of each body, then of all. A body that no spring drives back rests anywhere; without a damper
    it keeps its speed: these are no poles here.
    """

    maps: FloatArray
    rests: FloatArray

    @cached_property
    def relative(self) -> FloatArray:
        """The maps without the eigenvalue 1 of each state at which a loop rests, (..., s, s); the others are kept.

        Wielandt's deflation: M - v w', v the state of rest and w the row of a position over its entry of v. A map that
        overflows is replaced by one that is unstable.
        """
        maps = self.maps
        for rest in self.rests:
            column = rest[..., None]
            stays = np.abs(maps @ column - column) <= _ROUNDING * (np.abs(maps) @ np.abs(column))
            # A state that differs from 0 at every rest: a position.
            place = int(np.argmax(rest.reshape(-1, rest.shape[-1]).all(axis=0)))
            deflated = maps - column * (maps[..., place : place + 1, :] / column[..., place : place + 1, :])
            maps = np.where(stays.all(axis=-2)[..., None], deflated, maps)
        finite = np.abs(maps).max(axis=(-2, -1)) < _OVERFLOWING
        return np.where(finite[..., None, None], maps, _OVERFLOWING * np.eye(maps.shape[-1]))

    @cached_property
    def poles(self) -> ComplexArray:
        """The poles of each loop, shape (..., s), 0 in place of those of rest."""
        return moving_poles(self.relative)

    @property
    def leading(self) -> ComplexArray:
        """The pole of largest modulus of each loop, shape (...)."""
        largest = np.argmax(np.abs(self.poles), axis=-1)[..., None]
        return np.asarray(np.take_along_axis(self.poles, largest, axis=-1)[..., 0])

    @property
    def radius(self) -> FloatArray:
        """The spectral radius of each loop, shape (...)."""
        return np.asarray(np.abs(self.leading))


def moving_poles(relative: FloatArray) -> ComplexArray:
    """Return the eigenvalues of loops relative to their rests, 0 in place of those of speeds that stay."""
    values = eigenvalues(relative)
    return np.where(np.abs(values - 1) < _STEADY, 0, values)


def leading_radii(loops: FloatArray) -> FloatArray:
    """Return spectral radii r of relative loops (n, s, s), -inf where another's is larger: abs(trace(M^N))/s <= r^N."""
    s = loops.shape[-1]
    if s < _FEW_STATES or len(loops) <= _FEW_LOOPS:
        return np.asarray(np.abs(moving_poles(loops)).max(axis=-1))
    rows = np.arange(len(loops))
    power = loops
    logarithm = np.zeros(len(loops))
    for number in range(1, _ROUNDS + 1):
        power = power @ power
        power = power @ power
        times = 4**number
        if number >= _FIRST_ROUND:
            # States scaled by powers of 2, which are exact, so that rows and columns are equally large on average.
            size = np.abs(power).mean(axis=0) + np.finfo(np.float64).tiny
            unit = np.exp2(np.round(np.log2(size.sum(axis=1) / size.sum(axis=0)) / 2))
            power = power / unit[:, None] * unit
        largest = np.maximum(np.maximum(power.max(axis=(1, 2)), -power.min(axis=(1, 2))), np.finfo(np.float64).tiny)
        power = power / largest[:, None, None]
        logarithm = 4 * logarithm + np.log(largest)
        if number >= _FIRST_ROUND:
            trace = np.abs(np.trace(power, axis1=1, axis2=2))
            lower = np.where(trace > _LEAST_TRACE, np.log(np.maximum(trace, _LEAST_TRACE) / s), -np.inf)
            may_lead = (logarithm + np.log(s)) / times + _LOGARITHM_ROUNDING >= ((logarithm + lower) / times).max()
            rows = rows[may_lead]
            power = power[may_lead]
            logarithm = logarithm[may_lead]
    radius = np.full(len(loops), -np.inf)
    radius[rows] = np.abs(moving_poles(loops[rows])).max(axis=-1)
    return radius


def root(value: Callable[[FloatArray], FloatArray], left: FloatArray, right: FloatArray) -> FloatArray:
    """Return a root in each bracket: false position that halves the weight of a retained end (Illinois)."""
    at_left = value(left)
    at_right = value(right)
    middle = right
    for _ in range(60):
        span = at_right - at_left
        share = np.where(span == 0, 0.5, at_right / np.where(span == 0, 1.0, span))
        middle = right - (right - left) * np.where(np.isfinite(share), share, 0.5)
        at_middle = value(middle)
        crossed = np.sign(at_middle) != np.sign(at_right)
        step = np.abs(middle - right)
        left = np.where(crossed, right, left)
        at_left = np.where(crossed, at_right, at_left / 2)
        right = middle
        at_right = at_middle
        if (step <= 1e-13 * np.abs(middle)).all() or not at_middle.any():
            break
    return middle


def lowest(
    value: Callable[[FloatArray], FloatArray], left: FloatArray, centre: FloatArray, right: FloatArray
) -> FloatArray:
    """Return the place of a minimum about each centre, which is no higher than its neighbours: golden section."""
    golden = (5**0.5 - 1) / 2
    # Reduces the bracket to 2e-7, so that the value, flat there, is right to 4e-14 of its change over the bracket.
    for _ in range(32):
        step = (1 - golden) * np.where(right - centre > centre - left, right - centre, left - centre)
        probe = centre + step
        better = value(probe) < value(centre)
        outer = step > 0
        left = np.where(better & outer, centre, np.where(~better & ~outer, probe, left))
        right = np.where(better & ~outer, centre, np.where(~better & outer, probe, right))
        centre = np.where(better, probe, centre)
    return centre
