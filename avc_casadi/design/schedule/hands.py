"""Scope `hands`: a table of the spectral radius of the worst hand, and a spline through it as a constraint."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.design.schedule.scope import deciding_corners
from avc_casadi.design.schedule.states import States
from avc_casadi.loops.wall import frozen_parts, linear_stability
from avc_casadi.model.hands import hand_corners
from avc_casadi.model.problem import Problem

_POINTS = {2: (64, 64), 3: (20, 20, 28)}
"""Nodes along each state; b_p, which the radius depends on most sharply, has more of them."""
_CLIP = 0.1
"""Slack at which table values are clipped as unstable: a spline would ring at the step behind it."""


def hands_slack(problem: Problem, states: States, at: FloatArray) -> FloatArray:
    """Return 1 - spectral radius of the frozen loop, the least over the hands' corners and the device's, (m,)."""
    b, k, contact = states.gains(at)
    hands, margin = hand_corners(problem.hands), problem.stability.margin_ns_per_m
    slack = []
    for corner in deciding_corners(problem):
        lean = corner.device.model_copy(update={"damping_ns_per_m": corner.device.damping_ns_per_m - margin})
        slack.append(1 - linear_stability(lean, frozen_parts(corner, b, k), contact, hands).radius.max(axis=1))
    return np.asarray(np.clip(np.min(slack, axis=0), -_CLIP, _CLIP))


@dataclass(frozen=True)
class HandsTable:
    """Slack of the worst hand on the lattice of the dynamic programme."""

    axes: list[FloatArray]
    nodes: FloatArray
    values: FloatArray
    spline: Any

    @classmethod
    def of(cls, problem: Problem, states: States, points: Mapping[int, tuple[int, ...]] = _POINTS) -> HandsTable:
        """Return the table over the box of the states."""
        axes = [
            np.linspace(low, high if high > low else low + 1e-3, count)
            for low, high, count in zip(states.low, states.high, points[len(states.low)], strict=True)
        ]
        nodes = np.array([grid.ravel() for grid in np.meshgrid(*axes, indexing="ij")])
        values = hands_slack(problem, states, nodes)
        return cls(axes, nodes, values, _spline(axes, values.reshape([len(axis) for axis in axes])))


def _spline(axes: list[FloatArray], values: FloatArray) -> Any:
    """Return CasADi's interpolating cubic spline; its coefficients come one axis after another, 300 times as fast."""
    from scipy.interpolate import make_interp_spline  # noqa: PLC0415 - half a second that few designs need

    knots, coefficients = [], values
    for place, axis in enumerate(axes):
        along = make_interp_spline(axis, np.moveaxis(coefficients, place, 0), k=3)
        knots.append(along.t.tolist())
        coefficients = np.moveaxis(along.c, 0, place)
    return ca.Function.bspline("hands", knots, coefficients.ravel(order="F").tolist(), [3] * len(axes), 1, {})
