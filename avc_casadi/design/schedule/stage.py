"""One stage of a schedule as CasADi functions: cost, Re Z_h at its frequencies, realism, and their derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca

from avc_casadi.design.schedule.scope import LOOP_ROWS, realism_values
from avc_casadi.paper.equations import SampleAngle
from avc_casadi.paper.loop import Loop
from avc_casadi.paper.numbers import ComplexExpr, Real, abs2, casadi_numbers

COST_ROWS, GOAL_ROWS, PENALTY_ROW = 19, [9, 10], 15
"""Parameters of a stage's cost: loop (9), goal (2), floors (3), scale of Re Z, penalty of b_p, noticeable share, and
the bounds of |Z_h|^2 over |goal|^2."""
_TINY = 1e-30
"""Keeps the gradient of a root finite at 0."""
_TIE = 1e-3
"""Share of the squared complex error that breaks ties, before the magnitude alone is minimised from there."""


@dataclass(frozen=True)
class StageFunctions:
    """CasADi functions of one stage; sigma holds the states, lam one multiplier for the cost and one for each margin.

    Attributes:
        cost: (sigma, cost parameters) -> cost.
        gradient: the same -> (cost, its gradient (d, 1)).
        margins: (sigma, cost parameters, slot parameters) -> Re Z_h of each slot over its scale, then realism's
            values, (m, 1).
        jacobian: the same -> (margins, their Jacobian (m, d)).
        curvature: (the same, lam) -> upper triangle of the Hessian of lam . (cost, margins), by columns.
    """

    cost: Any
    gradient: Any
    margins: Any
    jacobian: Any
    curvature: Any


@lru_cache(maxsize=16)
def stage_functions(objective: str, states: int, slots: int, require: str = "none") -> StageFunctions:
    """Return the functions of a stage.

    Args:
        objective: magnitude, complex, perceptual, or tied.
        states: 3 with contact damping, otherwise 2.
        slots: number of frequencies at which Re Z_h is kept above the margin; 0 for none.
        require: `realism.require`, kept as further margins.
    """
    sigma, cost_p, slot_p = ca.SX.sym("sigma", states), ca.SX.sym("c", COST_ROWS), ca.SX.sym("s", LOOP_ROWS * slots)
    value = ca.vertsplit(cost_p)
    target = ComplexExpr(value[9], value[10])
    floors, scale, contact_penalty, noticeable = value[11:14], value[14], value[15], value[16]
    gains = [ca.exp(sigma[i]) - floors[i] for i in range(states)]
    b, k, contact = (*gains, ca.SX(0))[:3]
    z = _loop(value[:LOOP_ROWS]).perceived(b, k, contact)
    cost = _error(objective, z, target, noticeable) + contact_penalty * contact * contact / abs2(target)
    slot = ca.vertsplit(slot_p) if slots else []
    bounded = [
        _loop(slot[LOOP_ROWS * i : LOOP_ROWS * (i + 1)]).perceived(b, k, contact).real / scale for i in range(slots)
    ]
    bounded += realism_values(require, z, target, noticeable, (value[17], value[18]))
    margins = ca.densify(ca.vertcat(*bounded)) if bounded else ca.SX(0, 1)
    lam = ca.SX.sym("lam", 1 + len(bounded))
    hessian = ca.hessian(lam[0] * cost + (ca.dot(lam[1:], margins) if bounded else 0), sigma)[0]
    triangle = ca.vertcat(*(hessian[row, column] for column in range(states) for row in range(column + 1)))
    own, given = [sigma, cost_p], [sigma, cost_p, slot_p]
    gradient, jacobian = ca.densify(ca.gradient(cost, sigma)), ca.densify(ca.jacobian(margins, sigma))

    def function(name: str, inputs: list[Any], *outputs: Any) -> Any:
        return ca.Function(name, inputs, list(outputs), {"cse": True})

    return StageFunctions(
        function("cost", own, cost),
        function("gradient", own, cost, gradient),
        function("margins", given, margins),
        function("jacobian", given, margins, jacobian),
        function("curvature", [*given, lam], ca.densify(triangle)),
    )


def _loop(values: list[Any]) -> Loop:
    sample_time, sin, cos = values[:3]
    angle = SampleAngle(casadi_numbers(), 0.0, sample_time, sin, cos)
    device, hold, environment = (ComplexExpr(values[3 + 2 * i], values[4 + 2 * i]) for i in range(3))
    return Loop(angle, device, hold, environment, environment, environment)


def _error(objective: str, z: ComplexExpr, target: ComplexExpr, noticeable: Real) -> Real:
    """Return the squared relative error of Z_h: of its magnitude, complex, or of its noticeable part.

    "tied" is the magnitude with a small share of the rest, which breaks the ties of (11).
    """
    goal2 = abs2(target)
    magnitude2 = (1 - ca.sqrt(abs2(z) / goal2 + _TINY)) ** 2
    error2 = abs2(z - target) / goal2
    if objective == "magnitude":
        return magnitude2
    if objective == "tied":
        return magnitude2 + _TIE * error2
    if objective == "complex":
        return error2
    return (ca.sqrt(ca.fmax(error2 / noticeable**2, 1.0)) - 1) ** 2
