"""The sparse NLP of the whole schedule with its derivatives, assembled from those of one stage.

Derivatives that CasADi finds for the whole NLP cost ten times as much to evaluate as those assembled here.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from avc_casadi.design.schedule.realism import REALISM_ROWS
from avc_casadi.design.schedule.stage import COST_ROWS, LOOP_ROWS, stage_functions


@dataclass(frozen=True)
class Size:
    """What decides the structure of the NLP.

    Attributes:
        objective: magnitude, complex or perceptual.
        states: d, 2 or 3.
        slots: m, frequencies at which Re Z_h is bounded in each stage.
        stages: n.
        limited: whether the slopes are bounded.
        constant: whether all stages share one state.
        require: what of realism is bounded in each stage: none, jnd or bounds.
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
    """Build the NLP and the options that hand its derivatives to a solver.

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
    """Gradient (1, d) and upper triangle of the Hessian, by columns, of a function of one stage."""
    sigma = ca.MX.sym("sigma", states)
    hessian, gradient = ca.hessian(extra(sigma), sigma)
    triangle = [hessian[row, column] for column in range(states) for row in range(column + 1)]
    return (
        ca.Function("extra_slope", [sigma], [ca.densify(gradient.T)]),
        ca.Function("extra_curvature", [sigma], [ca.densify(ca.vertcat(*triangle))]),
    )


def _jacobian(size: Size, blocks: Any, step: Any) -> Any:
    """Sparse Jacobian of the constraints: one dense block (r, d) a stage, then the slopes.

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
    """Upper triangle of a block-tridiagonal matrix.

    Args:
        d: states.
        n: stages.
        diagonal: upper triangles of the blocks on the diagonal, by columns, (d (d + 1)/2, n).
        coupling: what each slope adds to the diagonal of both its stages and takes away between them, (1, n - 1).
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
    """Sparse matrix whose entry (rows[i], columns[i]) is values[source[i]]."""
    order = np.lexsort((rows, columns))
    sparsity = ca.Sparsity.triplet(*shape, rows[order].tolist(), columns[order].tolist())
    return ca.MX(sparsity, values[source[order].tolist()])
