"""Scope `hands` as a smooth constraint: 1 less the largest spectral radius, tabulated over the states."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from scipy.interpolate import make_interp_spline

from avc_casadi._util.arrays import FloatArray
from avc_casadi.claims.stability.declared_device import whole_stability
from avc_casadi.claims.stability.frozen_loop import frozen_parts
from avc_casadi.design.schedule.scope import deciding_corners
from avc_casadi.design.schedule.states import States
from avc_casadi.model.hands import hand_corners
from avc_casadi.model.problem import Problem

TABLE_POINTS = {2: (64, 64), 3: (20, 20, 28)}
"""Nodes along each state; b_p, which the radius depends on most sharply, has more of them."""
_DEGREE = 3
_CLIP = 0.1
"""Slack below which a table value says no more than "unstable": a spline would ring at the cliff behind it."""


def hands_slack(problem: Problem, states: States, at: FloatArray) -> FloatArray:
    """1 - spectral radius of the frozen loop, the least over the hands' corners and the device's, (m,).

    Args:
        problem: device, environment, hands and margin.
        states: map from states to gains.
        at: states, (d, m).
    """
    b, k, contact = states.gains(at)
    hands, margin = hand_corners(problem.hands), problem.stability.margin_ns_per_m
    slack = [
        1 - whole_stability(corner.device, frozen_parts(corner, b, k), contact, hands, -margin).radius.max(axis=1)
        for corner in deciding_corners(problem)
    ]
    return np.asarray(np.clip(np.min(slack, axis=0), -_CLIP, _CLIP))


def hands_spline(problem: Problem, states: States, points: Mapping[int, tuple[int, ...]] = TABLE_POINTS) -> Any:
    """Return sigma -> slack as a CasADi function: a cubic spline through a table of exact values.

    The schedule checks its rows exactly afterwards, with more hands than the corners, and asks for what was missing. A
    table is kept for the next problem that differs in nothing it depends on, and with it the solvers built on it.
    """
    parts = problem.device, problem.environment, problem.hands, problem.stability.margin_ns_per_m
    key = "\n".join((*map(repr, parts), *(repr(part.tolist()) for part in (states.floors, states.low, states.high))))
    return _kept(_Table(key, points[len(states.low)], problem, states))


@dataclass(frozen=True)
class _Table:
    """What a table is made from; key and points tell two of them apart."""

    key: str
    points: tuple[int, ...]
    problem: Problem = field(compare=False)
    states: States = field(compare=False)


@lru_cache(maxsize=8)
def _kept(table: _Table) -> Any:
    states = table.states
    axes = [
        np.linspace(low, high if high > low else low + 1e-3, points)
        for low, high, points in zip(states.low, states.high, table.points, strict=True)
    ]
    nodes = np.array([grid.ravel(order="F") for grid in np.meshgrid(*axes, indexing="ij")])
    values = hands_slack(table.problem, states, nodes).reshape([len(axis) for axis in axes], order="F")
    return _spline(axes, values)


def _spline(axes: list[FloatArray], values: FloatArray) -> Any:
    """Return CasADi's interpolating cubic spline; its coefficients come one axis after another, 300 times as fast."""
    knots, coefficients = [], values
    for place, axis in enumerate(axes):
        along = make_interp_spline(axis, np.moveaxis(coefficients, place, 0), k=_DEGREE)
        knots.append(along.t.tolist())
        coefficients = np.moveaxis(along.c, 0, place)
    degrees = [_DEGREE] * len(axes)
    return ca.Function.bspline("hands", knots, coefficients.ravel(order="F").tolist(), degrees, 1, {})
