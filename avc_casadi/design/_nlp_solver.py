"""Solve the CasADi NLP one frequency at a time, from several fixed starts, then break the ties of (11)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from avc_casadi.design._backends import backend
from avc_casadi.design._gains import FloatArray
from avc_casadi.design._nlp import coupling_nlp, nlp_parameters
from avc_casadi.design._rows import Gains, best_candidate
from avc_casadi.design._wanted import guarded_margin
from avc_casadi.impedance import Loop, coupling_impedance

if TYPE_CHECKING:
    from avc_casadi.problem import Problem

_STARTS = ((0.5, 0.5), (0.95, 0.95), (0.05, 0.05), (0.95, 0.05), (0.05, 0.95))
"""Fixed starts as shares c/(1+c) of the natural scales of b and k; contact damping starts at its lower end."""
_ROOT = 1e-4
"""A magnitude error below this share of |Z_h_ds| counts as a curve of minimisers, whose ties are then broken."""


@lru_cache(maxsize=16)
def nlp_solvers(name: str, tolerance: float) -> tuple[Any, Any]:
    """Build the solvers of (11)-(12) and of its tie-break, once for each backend and tolerance.

    The variables are b, k and b_p in units of their natural scales. The tie-break minimises |Z_h_avc - Z_h_ds|^2 on the
    curve |Z_h_avc|^2 = |Z_h_ds|^2. Goals and constraints are divided by their own scales.
    """
    chosen = backend(name)
    nlp = coupling_nlp()
    unit = ca.SX.sym("x", 3)
    scales = nlp.parameters[-3:]
    radius2 = nlp.target.real**2 + nlp.target.imag**2
    environment2 = nlp.parameters[7] ** 2 + nlp.parameters[8] ** 2 + 1e-30
    passivity = nlp.constraint_polynomial / (environment2 * ca.sqrt(radius2))
    on_curve = (nlp.impedance.real**2 + nlp.impedance.imag**2) / radius2 - 1

    def solver(label: str, goal: Any, constraints: Any) -> Any:
        f, g = ca.substitute([goal / radius2, constraints], [nlp.gains], [unit * scales])
        problem = {"x": unit, "f": f, "g": g, "p": nlp.parameters}
        return ca.nlpsol(label, chosen.plugin, problem, chosen.options(tolerance))

    return solver("direct", nlp.objective, passivity), solver(
        "tie_break", nlp.distance, ca.vertcat(passivity, on_curve)
    )


def nlp_gains(problem: Problem, loop: Loop, name: str, tolerance: float) -> tuple[Gains, int]:
    """Solve every frequency by a CasADi solver.

    Returns:
        (b, k, b_p), each (n,), the best strictly feasible result of all starts, and how often the solver reported
        success with a point that violates (12) by more than the tolerance.
    """
    solvers = nlp_solvers(name, tolerance)
    parameters = nlp_parameters(problem, loop)
    box = problem.coupling
    bounds = np.array([box.damping_ns_per_m, box.stiffness_n_per_m, box.contact_damping_ns_per_m])
    found = np.full((2 * len(_STARTS), 3, parameters.shape[1]), np.nan)
    false_success = 0
    for row, values in enumerate(parameters.T):
        scales = values[-3:]
        low, high = bounds.T / scales
        for number, (share_b, share_k) in enumerate(_STARTS):
            start = np.clip([share_b / (1 - share_b), share_k / (1 - share_k), 0.0], low, high)
            point = _call(solvers[0], start, values, (low, high), (0.0,), (np.inf,))
            false_success += point.claimed and point.violation > 10 * tolerance
            found[2 * number, :, row] = point.x * scales
            if point.goal < _ROOT**2:
                point = _call(solvers[1], point.x, values, (low, high), (0.0, 0.0), (np.inf, 0.0))
                found[2 * number + 1, :, row] = point.x * scales
    gains = np.concatenate((found, _pulled_inside(problem, loop, found, parameters[-3:], bounds)))
    return best_candidate(problem, loop, gains[:, 0], gains[:, 1], gains[:, 2]), false_success


@dataclass(frozen=True)
class _Point:
    """What a solver returned: x in scaled units inside the box, goal, violation of (12), and its own claim."""

    x: FloatArray
    goal: float
    violation: float
    claimed: bool


def _call(
    solver: Any,
    start: FloatArray,
    parameters: FloatArray,
    box: tuple[FloatArray, FloatArray],
    low: tuple[float, ...],
    high: tuple[float, ...],
) -> _Point:
    result = solver(x0=start, p=parameters, lbx=box[0], ubx=box[1], lbg=low, ubg=high)
    stats = solver.stats()
    # IPOPT turns Ctrl-C into a return status, which must not look like a failed solve.
    if stats["return_status"] == "NonIpopt_Exception_Thrown":
        raise KeyboardInterrupt
    x = np.asarray(result["x"], dtype=np.float64).ravel()
    x = np.where(np.isfinite(x), np.clip(x, *box), start)
    return _Point(x, float(result["f"]), -float(result["g"][0]), bool(stats["success"]))


def _pulled_inside(
    problem: Problem, loop: Loop, found: FloatArray, scales: FloatArray, bounds: FloatArray
) -> FloatArray:
    """Move points that miss (12) by a solver's tolerance onto it, along its gradient; shape of ``found``."""
    gains = found.copy()
    low, high = bounds[None, :, 0, None], bounds[None, :, 1, None]
    slope_k = coupling_impedance(loop.angle, 0.0, 1.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        for _ in range(4):
            b, k, p = gains[:, 0], gains[:, 1], gains[:, 2]
            rendered = loop.rendered(b, k) + p
            missing = guarded_margin(loop.device, loop.hold, rendered, problem.stability.margin_ns_per_m)
            missing = missing - (loop.device + loop.hold * rendered).real
            dz = loop.sensitivity(b, k)
            gradient = np.stack((dz.real, (dz * slope_k).real, loop.hold.real + 0 * b), axis=1) * scales
            # A gain at its bound cannot move further out.
            blocked = ((gains <= low) & (gradient < 0)) | ((gains >= high) & (gradient > 0))
            gradient = np.where(blocked, 0.0, gradient)
            step = np.maximum(missing, 0)[:, None] * gradient / (gradient**2).sum(axis=1, keepdims=True)
            gains = np.clip(gains + np.where(np.isfinite(step), step, 0.0) * scales, low, high)
    return gains
