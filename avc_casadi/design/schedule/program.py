"""Solving the NLP of the whole schedule: solvers built once a size, reused with parameters."""

from __future__ import annotations

import contextlib
import io
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.interrupt import reraise_interrupt
from avc_casadi.design.schedule.assembly import Size, schedule_nlp
from avc_casadi.design.schedule.stage import LOOP_ROWS

_COLD: dict[str, Any] = {
    "print_time": False,
    "error_on_fail": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.tol": 1e-8,
    "ipopt.constr_viol_tol": 1e-9,
    "ipopt.bound_relax_factor": 0.0,
    "ipopt.max_iter": 400,
    # The starts are good: a larger barrier pushes them out of their valley, often into a worse one.
    "ipopt.mu_init": 1e-6,
    "ipopt.bound_push": 1e-6,
    "ipopt.bound_frac": 1e-6,
}
_PUSH = 1e-9
_OPTIONS: dict[str, dict[str, Any]] = {
    "start": {**_COLD, "ipopt.max_iter": 120},
    "cold": _COLD,
    # A warm start is lost unless the barrier parameter and the distances to the bounds start small.
    "warm": {
        **_COLD,
        "ipopt.mu_init": 1e-7,
        "ipopt.mu_strategy": "adaptive",
        "ipopt.mu_max": 1e-5,
        "ipopt.warm_start_init_point": "yes",
        "ipopt.warm_start_bound_push": _PUSH,
        "ipopt.warm_start_bound_frac": _PUSH,
        "ipopt.warm_start_slack_bound_push": _PUSH,
        "ipopt.warm_start_slack_bound_frac": _PUSH,
        "ipopt.warm_start_mult_bound_push": _PUSH,
    },
}


@dataclass(frozen=True)
class Data:
    """Numbers of one schedule problem with n stages, d states and r bounded values in each stage.

    The bounded values are Re Z_h at the m slots, each over its scale, then what realism requires, then the slack of the
    hands if asked for.

    Attributes:
        cost: parameters of the stage costs, (19, n).
        slots: parameters of the slots, (9 m, n).
        weight: share of each stage in the mean over ln(omega), (n,).
        step: differences of ln(omega), (n - 1,).
        slope_penalty: weight of the mean squared slope.
        slope_limit: largest |d sigma/d ln(omega)|; infinite for none.
        least: lower bounds of the bounded values, (r, n); -inf drops one.
        low: lower ends of the states, (d, n).
        high: upper ends, (d, n).
        constant: whether all stages share one state; slopes then cost and limit nothing.
        require: what of realism is required: none, jnd or bounds.
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
    constant: bool = False
    require: str = "none"

    def size(self, objective: str) -> Size:
        """Return what decides the structure of the NLP."""
        limited = bool(np.isfinite(self.slope_limit)) and not self.constant
        slots = len(self.slots) // LOOP_ROWS
        return Size(objective, len(self.low), slots, len(self.weight), limited, self.constant, self.require)


@dataclass(frozen=True)
class Solution:
    """What the solver returned.

    Attributes:
        states: sigma, (d, n).
        cost: value of the goal.
        success: whether the solver claims a local optimum.
        message: its own word.
        iterations: how many it took.
        multipliers: of states and constraints, for the next start.
    """

    states: FloatArray
    cost: float
    success: bool
    message: str
    iterations: int
    multipliers: tuple[Any, Any]


@lru_cache(maxsize=32)
def _solver(size: Size, extra: Any, kind: str) -> Any:
    nlp, derivatives = schedule_nlp(size, extra)
    return ca.nlpsol("schedule", "ipopt", nlp, {**_OPTIONS[kind], **derivatives})


def solve_program(
    data: Data,
    objective: str,
    start: FloatArray,
    warm: Solution | None = None,
    extra: Any = None,
    *,
    patient: bool = True,
) -> Solution:
    """Solve from given states (d, n).

    Args:
        data: the numbers.
        objective: magnitude, complex or perceptual.
        start: states, (d, n).
        warm: a solution of a problem of the same size whose multipliers are a good start, or None.
        extra: sigma -> one more bounded value, a CasADi function, or None.
        patient: whether a cold start may take many iterations.

    Raises:
        KeyboardInterrupt: Ctrl-C, which IPOPT hides in its return status.
    """
    d, n = start.shape
    kind = "warm" if warm is not None else "cold" if patient else "start"
    size = data.size(objective)
    solver = _solver(size, extra, kind)
    step = data.step if n > 1 else np.ones(1)
    steepest = np.full(d * (n - 1) if size.limited else 0, data.slope_limit)
    free = 1 if data.constant else n
    arguments = {
        "x0": np.clip(start, data.low, data.high)[:, :free].ravel("F"),
        "p": np.concatenate((data.cost.ravel("F"), data.slots.ravel("F"), data.weight, step, [data.slope_penalty])),
        "lbx": data.low[:, :free].ravel("F"),
        "ubx": data.high[:, :free].ravel("F"),
        "lbg": np.concatenate((data.least.ravel("F"), -steepest)),
        "ubg": np.concatenate((np.full(data.least.size, np.inf), steepest)),
    }
    if warm is not None:
        arguments |= {"lam_x0": warm.multipliers[0], "lam_g0": warm.multipliers[1]}
    # CasADi warns of the evaluation that Ctrl-C cut short; what else it says the exact checks find out.
    with contextlib.redirect_stderr(io.StringIO()):
        result = solver(**arguments)
    stats = solver.stats()
    reraise_interrupt(stats["return_status"])
    states = result["x"].full().reshape((d, free), order="F")
    return Solution(
        states=np.repeat(states, n, axis=1) if data.constant else states,
        cost=float(result["f"]),
        success=bool(stats["success"]),
        message=str(stats["return_status"]),
        iterations=int(stats["iter_count"]),
        multipliers=(result["lam_x"], result["lam_g"]),
    )
