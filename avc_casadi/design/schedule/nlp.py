"""The sparse NLP of a whole schedule with its derivatives, assembled from those of one stage, and its solvers.

CasADi's derivatives of the whole NLP cost ten times as much to evaluate.
"""

from __future__ import annotations

import contextlib
import io
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from avc_casadi._util.arrays import FloatArray
from avc_casadi.design.schedule.scope import LOOP_ROWS, REALISM_ROWS
from avc_casadi.design.schedule.stage import COST_ROWS, stage_functions

_COLD: dict[str, Any] = {
    "print_time": False,
    "error_on_fail": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.tol": 1e-8,
    "ipopt.constr_viol_tol": 1e-9,
    "ipopt.bound_relax_factor": 0.0,
    "ipopt.max_iter": 400,
    # The starts are good: a larger barrier pushes them out of their basin, often into a worse one.
    "ipopt.mu_init": 1e-6,
    "ipopt.bound_push": 1e-6,
    "ipopt.bound_frac": 1e-6,
}
_PUSH = 1e-9
_OPTIONS: dict[str, dict[str, Any]] = {
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
class Size:
    """Structure of the NLP.

    Attributes:
        objective: magnitude, complex or perceptual.
        states: d, 2 or 3.
        slots: m, frequencies at which Re Z_h is bounded in each stage.
        stages: n.
        limited: whether the slopes are bounded.
        constant: whether all stages share one state.
        require: realism bounded in each stage: none, jnd or bounds.
    """

    objective: str
    states: int
    slots: int
    stages: int
    limited: bool
    constant: bool = False
    require: str = "none"


@lru_cache(maxsize=16)
def schedule_nlp(size: Size, extra: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the NLP and the options that pass its derivatives to a solver.

    Args:
        size: structure.
        extra: a CasADi function sigma -> value that is bounded below in every stage, or None.

    Returns:
        x = vec(sigma (d, n)), or sigma (d,) where it is constant; g = the slots, realism and extra of each stage, then
        vec(slopes) if they are limited;
        p = vec(cost parameters), vec(slot parameters), weight, step, slope penalty.
    """
    d, n = size.states, size.stages
    functions = stage_functions(size.objective, d, size.slots, size.require)
    m = size.slots + REALISM_ROWS[size.require]
    bounded = m + (extra is not None)
    x = ca.MX.sym("x", d if size.constant else d * n)
    lengths = [COST_ROWS * n, LOOP_ROWS * size.slots * n, n, max(n - 1, 1), 1]
    p = ca.MX.sym("p", sum(lengths))
    cost_p, slot_p, weight, step, penalty = ca.vertsplit(p, np.cumsum([0, *lengths]).tolist())
    sigma = ca.repmat(x, 1, n) if size.constant else ca.reshape(x, d, n)
    weight, step = weight.T, step.T
    own = (sigma, ca.reshape(cost_p, COST_ROWS, n))
    given = (*own, ca.reshape(slot_p, LOOP_ROWS * size.slots, n))
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", bounded * n + (d * (n - 1) if size.limited else 0))
    lam = ca.reshape(lam_g[: bounded * n], bounded, n)

    cost, gradient = functions.gradient.map(n)(*own)
    goal, gradient = ca.sum2(functions.cost.map(n)(*own) * weight), gradient * ca.repmat(weight, d, 1)
    goal_too = ca.sum2(cost * weight)
    diagonal = functions.curvature.map(n)(*given, ca.vertcat(lam_f * weight, lam[:m, :]))
    values, margins, blocks = [], [], []
    if m:
        margin, block = functions.jacobian.map(n)(*given)
        values, margins, blocks = [functions.margins.map(n)(*given)], [margin], [ca.reshape(block, m, d * n)]
    if extra is not None:
        slope, bend = _extra_derivatives(extra, d)
        value = extra.map(n)(sigma)
        values, margins = [*values, value], [*margins, value]
        blocks.append(ca.reshape(slope.map(n)(sigma), 1, d * n))
        diagonal += bend.map(n)(sigma) * ca.repmat(lam[m, :], d * (d + 1) // 2, 1)
    coupling = ca.MX(1, 0)
    slopes = []
    if n > 1 and not size.constant:
        move = sigma[:, 1:] - sigma[:, :-1]
        curve = penalty / ca.sum2(step) / step
        steep = ca.repmat(curve, d, 1) * move
        roughness = ca.dot(steep, move)
        goal, goal_too = goal + roughness, goal_too + roughness
        zero = ca.MX.zeros(d, 1)
        gradient += 2 * (ca.horzcat(zero, steep) - ca.horzcat(steep, zero))
        coupling = 2 * lam_f * curve
        if size.limited:
            slopes.append(ca.vec(move / ca.repmat(step, d, 1)))
    jacobian = _jacobian(size, ca.vertcat(*blocks), step)
    if size.constant:
        gradient, diagonal = ca.sum2(gradient), ca.sum2(diagonal)
    hessian = _hessian(d, 1 if size.constant else n, diagonal, coupling)

    def constraints(rows: list[Any]) -> Any:
        return ca.vertcat(ca.vec(ca.vertcat(*rows)), *slopes)

    nlp = {"x": x, "f": goal, "g": constraints(values), "p": p}
    return nlp, {
        "grad_f": ca.Function("grad_f", [x, p], [goal_too, ca.vec(gradient)], ["x", "p"], ["f", "grad_f_x"]),
        "jac_g": ca.Function("jac_g", [x, p], [constraints(margins), jacobian], ["x", "p"], ["g", "jac_g_x"]),
        "hess_lag": ca.Function(
            "hess_lag", [x, p, lam_f, lam_g], [hessian], ["x", "p", "lam_f", "lam_g"], ["triu_hess_gamma_x_x"]
        ),
    }


def _extra_derivatives(extra: Any, states: int) -> tuple[Any, Any]:
    """Return gradient (1, d) and upper triangle of the Hessian, by columns, of a function of one stage."""
    sigma = ca.MX.sym("sigma", states)
    hessian, gradient = ca.hessian(extra(sigma), sigma)
    triangle = [hessian[row, column] for column in range(states) for row in range(column + 1)]
    return (
        ca.Function("extra_slope", [sigma], [ca.densify(gradient.T)]),
        ca.Function("extra_curvature", [sigma], [ca.densify(ca.vertcat(*triangle))]),
    )


def _jacobian(size: Size, blocks: Any, step: Any) -> Any:
    """Return the sparse Jacobian of the constraints: one dense block (r, d) a stage, then the slopes.

    Args:
        size: structure.
        blocks: all blocks side by side, (r, d n).
        step: differences of ln(omega), (1, n - 1).
    """
    d, n = size.states, size.stages
    r = blocks.shape[0]
    stage, row, column = (v.ravel() for v in np.meshgrid(np.arange(n), np.arange(r), np.arange(d), indexing="ij"))
    rows, columns, source = stage * r + row, stage * d + column, (stage * d + column) * r + row
    values, total = ca.vec(blocks), r * n
    if size.constant:
        return _sparse((total, d), rows, column, source, values)
    if size.limited and n > 1:
        stage, state = (v.ravel() for v in np.meshgrid(np.arange(n - 1), np.arange(d), indexing="ij"))
        below, own = stage * d + state, (stage + 1) * d + state
        rows = np.concatenate((rows, total + below, total + below))
        columns = np.concatenate((columns, own, below))
        source = np.concatenate((source, values.numel() + stage, values.numel() + n - 1 + stage))
        values = ca.vertcat(values, 1 / step.T, -1 / step.T)
        total += d * (n - 1)
    return _sparse((total, d * n), rows, columns, source, values)


def _hessian(d: int, n: int, diagonal: Any, coupling: Any) -> Any:
    """Return the upper triangle of a block-tridiagonal matrix.

    Args:
        d: states.
        n: stages.
        diagonal: upper triangles of the blocks on the diagonal, by columns, (d (d + 1)/2, n).
        coupling: added by each slope to the diagonal of both its stages and subtracted between them, (1, n - 1).
    """
    upper = [(row, column) for column in range(d) for row in range(column + 1)]
    t, stage, between = len(upper), np.arange(n), np.arange(n - 1)
    rows = np.concatenate([stage * d + r for r, _ in upper] + [between * d + state for state in range(d)])
    columns = np.concatenate([stage * d + c for _, c in upper] + [(between + 1) * d + state for state in range(d)])
    source = np.concatenate([stage * t + at for at in range(t)] + [t * n + between] * d)
    spread = ca.DM([float(r == c) for r, c in upper])
    both = ca.horzcat(0, coupling) + ca.horzcat(coupling, 0)
    values = ca.vertcat(ca.vec(diagonal + ca.mtimes(spread, both)), -coupling.T)
    return _sparse((d * n, d * n), rows, columns, source, values)


def _sparse(
    shape: tuple[int, int], rows: NDArray[np.intp], columns: NDArray[np.intp], source: NDArray[np.intp], values: Any
) -> Any:
    """Return the sparse matrix whose entry (rows[i], columns[i]) is values[source[i]]."""
    order = np.lexsort((rows, columns))
    sparsity = ca.Sparsity.triplet(*shape, rows[order].tolist(), columns[order].tolist())
    return ca.MX(sparsity, values[source[order].tolist()])


@dataclass(frozen=True)
class Data:
    """Numbers of one schedule problem with n stages, d states and r bounded values in each stage.

    The bounded values are Re Z_h at the m slots, each over its scale, then those of realism, then the slack of the
    hands if required.

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
        require: required realism: none, jnd or bounds.
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
        """Return the structure of the NLP."""
        limited = bool(np.isfinite(self.slope_limit)) and not self.constant
        slots = len(self.slots) // LOOP_ROWS
        return Size(objective, len(self.low), slots, len(self.weight), limited, self.constant, self.require)


@dataclass(frozen=True)
class Solution:
    """Result of the solver.

    Attributes:
        states: sigma, (d, n).
        cost: value of the objective.
        success: whether the solver claims a local optimum.
        message: the solver's own.
        multipliers: of states and constraints, for the next start.
    """

    states: FloatArray
    cost: float
    success: bool
    message: str
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
) -> Solution:
    """Solve from given states (d, n).

    Args:
        data: numerical data.
        objective: magnitude, complex or perceptual.
        start: states, (d, n).
        warm: a solution of a problem of the same size whose multipliers are a good start, or None.
        extra: sigma -> one more bounded value, a CasADi function, or None.

    Raises:
        KeyboardInterrupt: Ctrl-C, which IPOPT hides in its return status.
    """
    d, n = start.shape
    kind = "cold" if warm is None else "warm"
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
    # CasADi warns of the evaluation interrupted by Ctrl-C; other faults show in the exact checks.
    with contextlib.redirect_stderr(io.StringIO()):
        result = solver(**arguments)
    stats = solver.stats()
    if stats["return_status"] == "NonIpopt_Exception_Thrown":  # which Ctrl-C is to IPOPT
        raise KeyboardInterrupt
    states = result["x"].full().reshape((d, free), order="F")
    return Solution(
        states=np.repeat(states, n, axis=1) if data.constant else states,
        cost=float(result["f"]),
        success=bool(stats["success"]),
        message=str(stats["return_status"]),
        multipliers=(result["lam_x"], result["lam_g"]),
    )
