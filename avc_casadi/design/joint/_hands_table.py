"""Scope `hands` as a smooth constraint: 1 less the largest spectral radius, tabulated over the states."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from avc_casadi.design.joint._scope import deciding_corners
from avc_casadi.design.joint._states import States
from avc_casadi.loop import hand_corners
from avc_casadi.problem import Problem
from avc_casadi.stability import frozen_parts, whole_stability
from avc_casadi.support import FloatArray

_POINTS = {2: (64, 64), 3: (24, 24, 14)}
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


def hands_spline(problem: Problem, states: States) -> Any:
    """Return sigma -> slack as a CasADi function: a cubic spline through a table of exact values.

    The schedule checks its rows exactly afterwards, with more hands than the corners, and asks for what was missing. A
    table is kept for the next problem that differs in nothing it depends on, and with it the solvers built on it.
    """
    parts = problem.device, problem.environment, problem.hands, problem.stability.margin_ns_per_m
    key = "\n".join((*map(repr, parts), *(repr(part.tolist()) for part in (states.floors, states.low, states.high))))
    return _kept(_Table(key, problem, states))


@dataclass(frozen=True)
class _Table:
    """What a table is made from; the key tells two of them apart."""

    key: str
    problem: Problem = field(compare=False)
    states: States = field(compare=False)


@lru_cache(maxsize=8)
def _kept(table: _Table) -> Any:
    states = table.states
    axes = [
        np.linspace(low, high if high > low else low + 1e-3, points)
        for low, high, points in zip(states.low, states.high, _POINTS[len(states.low)], strict=True)
    ]
    nodes = np.array([grid.ravel(order="F") for grid in np.meshgrid(*axes, indexing="ij")])
    values = hands_slack(table.problem, states, nodes)
    return ca.interpolant("hands", "bspline", [list(axis) for axis in axes], list(values))
