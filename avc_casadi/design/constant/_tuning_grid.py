"""A coarse grid of constant gains, refined about its best: what is left where the programme finds nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.coupling import Gains
from avc_casadi.design.joint import worst_slack
from avc_casadi.loop import loop_at, relative_errors
from avc_casadi.support import FloatArray

if TYPE_CHECKING:
    from avc_casadi.problem import Problem

# Gains are tried on a logarithmic scale down to this share of their largest value, and at their lower bound itself.
_DECADES = 6
_POINTS = {2: 25, 3: 11}
_NEAR = 5
_REFINEMENTS = 4
_SHRINK = 0.4
# Impedances held at a time while errors are computed.
_NUMBERS_AT_ONCE = 1_000_000


def gains_on_grid(problem: Problem) -> Gains | None:
    """Return the constant gains with the least error among those of a grid that meet the problem's scope, or None."""
    box = problem.coupling
    ends = [box.damping_ns_per_m, box.stiffness_n_per_m, box.contact_damping_ns_per_m]
    low, high = np.array(ends[: 3 if box.contact_damping_ns_per_m[1] > 0 else 2], dtype=np.float64).T
    size = len(low)
    points = _grid(np.linspace(0, 1, _POINTS[size]), size)
    reach, best, least = 1.0 / (_POINTS[size] - 1), None, np.inf
    for _ in range(1 + _REFINEMENTS):
        gains = _gains(points, low, high)
        met = worst_slack(problem, np.zeros(gains.shape[1]), (gains[0], gains[1], gains[2])).met
        if met.any():
            errors = np.where(met, rms_errors(problem, gains), np.inf)
            if errors.min() < least:
                best, least = points[errors.argmin()], float(errors.min())
        if best is None:
            return None
        points = np.clip(best + reach * _grid(np.linspace(-1, 1, _NEAR), size), 0.0, 1.0)
        reach *= _SHRINK
    return None if best is None else Gains(*(float(gain[0]) for gain in _gains(best[None], low, high)))


def rms_errors(problem: Problem, gains: FloatArray) -> FloatArray:
    """Root of the mean squared relative error of constant gains (3, m) over the problem's frequencies, shape (m,)."""
    loop, realism = loop_at(problem, problem.frequencies_hz()), problem.realism
    target = np.asarray(loop.target)[None]
    at_once = max(1, _NUMBERS_AT_ONCE // target.size)
    parts = []
    for first in range(0, gains.shape[1], at_once):
        b, k, contact = (gain[first : first + at_once, None] for gain in gains)
        errors = relative_errors(loop.perceived(b, k, contact), target, realism.objective, realism.jnd)
        parts.append(np.sqrt(np.mean(errors**2, axis=1)))
    return np.concatenate(parts)


def _gains(points: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Return b, k and b_p of points (m, d), which are shares of the logarithmic ranges, shape (3, m)."""
    scale = high * 10.0**-_DECADES
    ratio = (high + scale) / np.where(high > 0, low + scale, 1.0)
    values = (low + scale) * np.where(high > 0, ratio, 1.0) ** points - scale
    values = np.clip(np.where(points <= 0, low, np.where(points >= 1, high, values)), low, high)
    return np.concatenate([values.T, np.zeros((3 - values.shape[1], len(values)))])


def _grid(values: FloatArray, size: int) -> FloatArray:
    return np.stack(np.meshgrid(*[values] * size, indexing="ij"), axis=-1).reshape(-1, size)
