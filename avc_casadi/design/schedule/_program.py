"""The sparse NLP of the whole schedule: built once a size, reused with parameters."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from avc_casadi.design._gains import FloatArray
from avc_casadi.design.schedule._stage import COST_ROWS, LOOP_ROWS, stage_function

_QUIET = {"print_time": False, "error_on_fail": False, "ipopt.print_level": 0, "ipopt.sb": "yes"}
_COLD = {
    **_QUIET,
    "ipopt.tol": 1e-8,
    "ipopt.constr_viol_tol": 1e-9,
    "ipopt.bound_relax_factor": 0.0,
    "ipopt.max_iter": 400,
    # The starts are good: a larger barrier would push them out of their valley before the descent begins.
    "ipopt.mu_init": 1e-5,
    "ipopt.bound_push": 1e-6,
    "ipopt.bound_frac": 1e-6,
}
_PUSH = 1e-9
# A warm start is lost unless the barrier parameter and the distances to the bounds start small.
_WARM = {
    **_COLD,
    "ipopt.mu_init": 1e-7,
    "ipopt.warm_start_init_point": "yes",
    "ipopt.warm_start_bound_push": _PUSH,
    "ipopt.warm_start_bound_frac": _PUSH,
    "ipopt.warm_start_slack_bound_push": _PUSH,
    "ipopt.warm_start_slack_bound_frac": _PUSH,
    "ipopt.warm_start_mult_bound_push": _PUSH,
}


@dataclass(frozen=True)
class Data:
    """Numbers of one schedule problem with n stages, d states and m slots.

    Attributes:
        cost: parameters of the stage costs, (17, n).
        slots: parameters of the slots, (9 m, n).
        weight: share of each stage in the mean over ln(omega), (n,).
        step: differences of ln(omega), (n - 1,).
        slope_penalty: weight of the mean squared slope.
        slope_limit: largest |d sigma/d ln(omega)|; infinite for none.
        least: lower bounds of the slot constraints, (m, n); -inf drops one.
        low: lower ends of the states, (d,).
        high: upper ends, (d,).
    """

    cost: FloatArray
    slots: FloatArray
    weight: FloatArray
    step: FloatArray
    slope_penalty: float
    slope_limit: float
    least: FloatArray
    low: FloatArray
    high: FloatArray


@dataclass(frozen=True)
class Solution:
    """What the solver returned: states (d, n), cost, whether it claims success, multipliers for the next start."""

    states: FloatArray
    cost: float
    success: bool
    message: str
    iterations: int
    multipliers: tuple[Any, Any]


@lru_cache(maxsize=12)
def _solvers(objective: str, states: int, slots: int, stages: int, extra: Any) -> tuple[Any, Any]:
    """Build the cold and the warm solver; ``extra`` is a CasADi function sigma -> value that must stay >= 0."""
    x = ca.MX.sym("x", states, stages)
    cost_p, slot_p = ca.MX.sym("cost", COST_ROWS, stages), ca.MX.sym("slots", LOOP_ROWS * slots, stages)
    weight, step = ca.MX.sym("weight", 1, stages), ca.MX.sym("step", 1, max(stages - 1, 1))
    penalty = ca.MX.sym("penalty")
    cost, margins = stage_function(objective, states, slots).map(stages)(x, cost_p, slot_p)
    goal = ca.sum2(cost * weight)
    constraints = [ca.vec(margins)]
    if extra is not None:
        constraints.append(ca.vec(extra.map(stages)(x)))
    if stages > 1:
        slope = (x[:, 1:] - x[:, :-1]) / ca.repmat(step, states, 1)
        goal += penalty * ca.sum2(ca.sum1(slope**2) * step) / ca.sum2(step)
        constraints.append(ca.vec(slope))
    parameters = ca.vertcat(ca.vec(cost_p), ca.vec(slot_p), ca.vec(weight), ca.vec(step), penalty)
    nlp = {"x": ca.vec(x), "f": goal, "g": ca.vertcat(*constraints), "p": parameters}
    return ca.nlpsol("schedule", "ipopt", nlp, _COLD), ca.nlpsol("schedule_warm", "ipopt", nlp, _WARM)


def solve_program(
    data: Data,
    objective: str,
    start: FloatArray,
    *,
    multipliers: tuple[Any, Any] | None = None,
    extra: Any = None,
    extra_least: float = 0.0,
) -> Solution:
    """Solve from given states (d, n); warm where multipliers are given.

    Raises:
        KeyboardInterrupt: Ctrl-C, which IPOPT hides in its return status.
    """
    d, n = start.shape
    m = len(data.least)
    cold, warm = _solvers(objective, d, m, n, extra)
    solver = cold if multipliers is None else warm
    step = data.step if n > 1 else np.ones(1)
    parameters = np.concatenate((data.cost.ravel("F"), data.slots.ravel("F"), data.weight, step, [data.slope_penalty]))
    least = [data.least.ravel("F")]
    most = [np.full(m * n, np.inf)]
    if extra is not None:
        least.append(np.full(n, extra_least))
        most.append(np.full(n, np.inf))
    if n > 1:
        least.append(np.full(d * (n - 1), -data.slope_limit))
        most.append(np.full(d * (n - 1), data.slope_limit))
    arguments = {
        "x0": np.clip(start, data.low[:, None], data.high[:, None]).ravel("F"),
        "p": parameters,
        "lbx": np.tile(data.low, n),
        "ubx": np.tile(data.high, n),
        "lbg": np.concatenate(least),
        "ubg": np.concatenate(most),
    }
    if multipliers is not None:
        arguments |= {"lam_x0": multipliers[0], "lam_g0": multipliers[1]}
    result = solver(**arguments)
    stats = solver.stats()
    if stats["return_status"] == "NonIpopt_Exception_Thrown":
        raise KeyboardInterrupt
    states = np.asarray(result["x"], dtype=np.float64).reshape((d, n), order="F")
    return Solution(
        states=states,
        cost=float(result["f"]),
        success=bool(stats["success"]),
        message=str(stats["return_status"]),
        iterations=int(stats["iter_count"]),
        multipliers=(result["lam_x"], result["lam_g"]),
    )
