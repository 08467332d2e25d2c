"""One stage of the schedule as CasADi expressions: its cost and Re Z_h at the frequencies that its scope names."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from avc_casadi.design._gains import FloatArray
from avc_casadi.impedance import ComplexExpr, Loop, Real, SampleAngle, abs2, casadi_numbers

COST_ROWS = 17
"""Parameters of a stage's cost: 9 of the loop, goal (2), floors (3), scale of Re Z, penalty of b_p, noticeable share."""
LOOP_ROWS = 9


def _loop(values: list[Any]) -> Loop:
    sample_time, sin, cos, *rest = values
    angle = SampleAngle(casadi_numbers(), 0.0, sample_time, sin, cos)
    device, hold, environment = (ComplexExpr(rest[2 * i], rest[2 * i + 1]) for i in range(3))
    return Loop(angle, device, hold, environment, environment, environment)


def loop_parameters(loop: Loop, damping_credit_ns_per_m: float = 0.0) -> FloatArray:
    """Parameters of a numeric loop, shape (9, ...); the credit is added to the damping of the device."""
    device = loop.device + damping_credit_ns_per_m
    columns = (loop.angle.sample_time_s, loop.angle.sin, loop.angle.cos, device.real, device.imag)
    columns += (loop.hold.real, loop.hold.imag, loop.environment.real, loop.environment.imag)
    return np.array(np.broadcast_arrays(*columns), dtype=np.float64)


@lru_cache(maxsize=16)
def stage_function(objective: str, states: int, slots: int) -> Any:
    """Build (sigma, cost parameters, slot parameters) -> (cost, Re Z_h at each slot over its scale).

    Args:
        objective: magnitude, complex or perceptual.
        states: 2 for the series structure, 3 for the damped one.
        slots: number of frequencies at which Re Z_h is kept above the margin.
    """
    sigma, cost_p, slot_p = ca.SX.sym("sigma", states), ca.SX.sym("c", COST_ROWS), ca.SX.sym("s", LOOP_ROWS * slots)
    value = ca.vertsplit(cost_p)
    target = ComplexExpr(value[9], value[10])
    floors, scale, contact_penalty, noticeable = value[11:14], value[14], value[15], value[16]
    gains = [ca.exp(sigma[i]) - floors[i] for i in range(states)]
    b, k, contact = (*gains, 0.0)[:3]
    z = _loop(value[:LOOP_ROWS]).perceived(b, k, contact)
    cost = _error(objective, z, target, noticeable) + contact_penalty * contact**2 / abs2(target)
    slot = ca.vertsplit(slot_p)
    margins = [
        _loop(slot[LOOP_ROWS * i : LOOP_ROWS * (i + 1)]).perceived(b, k, contact).real / scale for i in range(slots)
    ]
    return ca.Function("stage", [sigma, cost_p, slot_p], [cost, ca.vertcat(*margins)])


def _error(objective: str, z: ComplexExpr, target: ComplexExpr, noticeable: Real) -> Real:
    """Squared relative error; the tiny term keeps the root's gradient finite at |Z| = 0."""
    goal2 = abs2(target)
    if objective == "magnitude":
        return (1 - ca.sqrt(abs2(z) / goal2 + 1e-30)) ** 2
    error2 = abs2(z - target) / goal2
    if objective == "complex":
        return error2
    return (ca.sqrt(ca.fmax(error2 / noticeable**2, 1.0)) - 1) ** 2
