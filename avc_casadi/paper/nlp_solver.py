"""CasADi's solvers of (11)-(12) and of its ties, over many frequencies and starts in one call.

Each gain t is varied as u in [0, 1], its share x = t/(c + t) between the ends of its box, c its size at the start: Z_h
then changes evenly over a box of any width, and a Newton step is as good at one end of it as at the other.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any, Literal

import casadi as ca
import numpy as np

from avc_casadi._errors import InputError, UnsupportedError
from avc_casadi._util.arrays import ComplexArray, FloatArray, IndexArray
from avc_casadi._util.interrupt import DeferredInterrupt
from avc_casadi.model.problem import Problem
from avc_casadi.model.problem_ranges import margin_over_range
from avc_casadi.paper.equations import ImpedanceLoop
from avc_casadi.paper.nlp import coupling_nlp, nlp_parameters
from avc_casadi.paper.numbers import abs2

DEFAULT_SOLVER = "sqpmethod-qrqp"
DEFAULT_TOLERANCE = 1e-12
"""Relative tolerance of the scaled problem."""

Options = dict[str, Any]
_QUIET: Options = {"print_time": False, "error_on_fail": False, "show_eval_warnings": False}


def _ipopt(tolerance: float) -> tuple[str, Options]:
    # Waechter and Biegler, Mathematical Programming 106 (2006) 25-57. Bounds are not relaxed: a relaxed bound would be
    # "better" than the optimum.
    """Return the interior-point solver IPOPT and its options for a tolerance."""
    return "ipopt", {
        "ipopt.print_level": 0,
        "ipopt.sb": "yes",
        "ipopt.tol": tolerance,
        "ipopt.constr_viol_tol": tolerance,
        "ipopt.acceptable_iter": 0,
        "ipopt.bound_relax_factor": 0.0,
        "ipopt.max_iter": 500,
    }


def _sqpmethod(qp: str, qp_quiet: Options, tolerance: float) -> tuple[str, Options]:
    # Andersson et al., Mathematical Programming Computation 11 (2019) 1-36; DAQP: Arnstroem, Bemporad and Axehill, IEEE
    # TAC 67 (2022) 4362-4369; QRQP: CasADi's active-set method on a sparse QR factorisation.
    """Return sequential quadratic programming with a solver of quadratic programs, and its options."""
    return "sqpmethod", {
        "print_header": False,
        "print_iteration": False,
        "print_status": False,
        "qpsol": qp,
        "qpsol_options": {"error_on_fail": False, **qp_quiet},
        # (11) is not convex: without this the QP may be unbounded. Reflected eigenvalues keep the length of a step,
        # where a shift of them all makes it short: 3 iterations in place of 9.
        "convexify_strategy": "eigen-reflect",
        "tol_du": tolerance,
        "tol_pr": tolerance,
        "max_iter": 200,
    }


SOLVERS: dict[str, Callable[[float], tuple[str, Options]]] = {
    DEFAULT_SOLVER: partial(_sqpmethod, "qrqp", {"print_iter": False, "print_header": False, "print_info": False}),
    "sqpmethod": partial(_sqpmethod, "daqp", {}),
    "ipopt": _ipopt,
}
"""CasADi's plugin and its options for a tolerance, relative to the scaled problem, by the solver's name."""


def plugin_of(name: str, tolerance: float) -> tuple[str, Options]:
    """Return CasADi's plugin of a solver, and all options."""
    if name in SOLVERS:
        plugin, options = SOLVERS[name](tolerance)
        return plugin, _QUIET | options
    known = ", ".join(SOLVERS)
    if not ca.has_nlpsol(name):
        raise InputError.of(
            f"{name!r} is not a solver; allowed: {known}, or another nlpsol plugin of this CasADi", key="solver"
        )
    if tolerance != DEFAULT_TOLERANCE:
        raise InputError.of(f"applies to {known} only, not to {name}; leave it out", key="tolerance")
    return name, dict(_QUIET)


Stage = Literal["error", "turn", "contact"]
_UPPER = {"error": (np.inf,), "turn": (np.inf, np.inf, 0.0), "contact": (0.0, 0.0)}
"""Upper bounds of each stage's constraints; the lower ones are 0."""
_LAST_SHARE = 1.0 - 2.0**-52
"""Largest share x = t/(c + t) of an infinite gain t: just below 1."""
_SCALE_REACH = 10.0
"""The scale c of a share is the gain of the start, but within this factor of the gain's natural scale."""
_SMALLEST_MAGNITUDE = 1e-12
"""Smallest |Z_h| of a start, as a share of |Z_h_ds|, for the size of the goal."""
_NLPS_AT_ONCE = 64
"""NLPs in one call, during which Ctrl-C waits."""


@dataclass(frozen=True)
class NlpSolvers:
    """CasADi functions of one solver, in the lexicographic order of the goals.

    Attributes:
        error: least magnitude error (11) subject to (12).
        turn: of equal errors, the least angle between Z_h and Z_h_ds.
        contact: of equal Z_h, the least contact damping; None where b_p is no variable.
    """

    error: Any
    turn: Any
    contact: Any | None


@lru_cache(maxsize=16)
def nlp_solvers(name: str, tolerance: float, *, contact: bool = False) -> NlpSolvers:
    """Return the solvers, built once for each solver and tolerance."""
    plugin, options = plugin_of(name, tolerance)
    nlp = coupling_nlp()
    u = ca.SX.sym("u", 3 if contact else 2)
    low = ca.SX.sym("low", 3)
    span = ca.SX.sym("span", 3)
    scale = ca.SX.sym("scale", 3)
    sizes = ca.SX.sym("sizes", 3)
    point = ca.SX.sym("point", 2)
    share = low + span * (u if contact else ca.vertcat(u, 0))
    gains = scale * share / (1 - share)
    goal_size, term_size, side = ca.vertsplit(sizes)

    target2 = abs2(nlp.target)
    turned = nlp.impedance * nlp.target.conjugate()
    expressions = [
        nlp.objective / goal_size**2,
        nlp.constraint / term_size,
        side * turned.imag / (target2 + turned.real),
        abs2(nlp.impedance) / target2 - 1,
        (nlp.impedance.real - point[0]) / term_size,
        (nlp.impedance.imag - point[1]) / term_size,
    ]
    error, passive, turn, on_circle, *at_point = ca.substitute(expressions, [nlp.gains], [gains])
    parameters = ca.vertcat(nlp.parameters, low, span, scale, sizes, point)

    def solver(label: str, goal: Any, constraints: list[Any]) -> Any:
        problem = {"x": u, "f": goal, "g": ca.vertcat(*constraints), "p": parameters}
        try:
            return ca.nlpsol(label, plugin, problem, options)
        except RuntimeError as failure:
            why = str(failure).strip().splitlines()[-1]
            raise UnsupportedError(f"solver {name} cannot be used: {why}; leave --solver out") from failure

    return NlpSolvers(
        solver("error", error, [passive]),
        solver("turn", turn, [passive, turn, on_circle]),
        solver("contact", u[2], at_point) if contact else None,
    )


class NlpRows:
    """The NLPs of n frequencies in scales that suit absolute tolerances; a rotary device in units of its handle.

    Attributes:
        problem: the problem.
        loop: its loop at the n frequencies.
        solvers: CasADi's functions.
        size: unit of impedance of this class, N.s/m of the problem: 1 of a linear device.
        margin: least Re Z_h.
        low: lower ends of b, k and b_p, shape (3, 1).
        high: their upper ends, shape (3, 1).
        radius: |Z_h_ds|, 1 where it is 0, shape (n,).
        natural: natural scale of each gain, shape (3, n).
    """

    def __init__(self, problem: Problem, loop: ImpedanceLoop, solvers: NlpSolvers) -> None:
        """Set up the NLP of each frequency of a loop: bounds of gains, margin and target, in units of the handle."""
        self.problem = problem
        self.loop = loop
        self.solvers = solvers
        self.size = problem.device.metres_per_unit**2
        self.margin = margin_over_range(problem) / self.size
        box = problem.coupling
        bounds = np.array([box.damping_ns_per_m, box.stiffness_n_per_m, box.contact_damping_ns_per_m]) / self.size
        self.low = bounds[:, :1]
        self.high = bounds[:, 1:]
        self._parameters = nlp_parameters(problem, loop, self.size)
        target = np.abs(loop.target) / self.size
        self.radius = np.where(target > 0, target, 1.0)
        contact = np.maximum(self.radius, self.margin) / np.abs(loop.hold)
        self.natural = np.array([*self._parameters[-3:-1], contact])

    def perceived(self, gains: FloatArray, rows: IndexArray | slice = slice(None)) -> ComplexArray:
        """Return Z_h of gains (3, ..., m) at the frequencies ``rows``."""
        loop = self.loop if isinstance(rows, slice) else self.loop.rows(rows)
        return np.asarray(loop.perceived(*(gains * self.size)) / self.size)

    def solve(self, stage: Stage, start: FloatArray, rows: IndexArray) -> FloatArray:
        """Solve a stage for m frequencies from gains (3, m); return the result in the box at any solver status.

        Where the solver throws or returns non-finite values, the start is returned.
        """
        natural = self.natural[:, rows]
        target = self.loop.target[rows] / self.size
        scale = np.clip(start, natural / _SCALE_REACH, natural * _SCALE_REACH)
        low, high = (np.minimum(end / (scale + end), _LAST_SHARE) for end in (self.low, self.high))
        span = high - low
        u = np.clip((start / (scale + start) - low) / np.where(span > 0, span, 1.0), 0, 1)
        z = self.perceived(start, rows)
        radius = self.radius[rows]
        magnitude = np.maximum(np.abs(z), _SMALLEST_MAGNITUDE * radius)
        device = self.loop.device[rows] / self.size
        hold = self.loop.hold[rows]
        terms = np.abs(device) + np.abs(z - device) + np.abs(hold.real * start[2])
        side = np.where((z * np.conj(target)).imag < 0, -1.0, 1.0)
        # With |Z_h| far below |Z_h_ds| the goal is nearly linear in |Z_h|, far above it quadratic.
        goal_size = np.sqrt(np.maximum(radius, magnitude) * magnitude)
        sizes = (goal_size, np.where(terms > 0, terms, 1.0), side)
        data = np.concatenate((self._parameters[:, rows], low, span, scale, sizes, (z.real, z.imag)))
        solution = self._called(stage, u, data)
        share = np.minimum(low + span * solution, _LAST_SHARE)
        gains = scale * share / (1 - share)
        gains = np.where(solution <= 0, self.low, np.where(solution >= 1, self.high, gains))
        return np.asarray(np.clip(gains, self.low, self.high))

    def _called(self, stage: Stage, u: FloatArray, data: FloatArray) -> FloatArray:
        """Return the solutions u (3, m) of a stage, of parameters ``data``; the start where the solver has none."""
        solver = getattr(self.solvers, stage)
        varied = solver.size1_in("x0")
        solution = u.copy()
        highest = np.array(_UPPER[stage])
        lowest = np.zeros(len(highest))
        for first in range(0, u.shape[1], _NLPS_AT_ONCE):
            part = slice(first, first + _NLPS_AT_ONCE)
            # Where a foreign handler intercepts Ctrl-C without ending anything, the next calls follow.
            with DeferredInterrupt():
                x = _solved(solver, u[:varied, part], data[:, part], lowest, highest)
            solution[:varied, part] = np.where(np.isfinite(x), np.clip(x, 0, 1), u[:varied, part])
        return solution


def _solved(solver: Any, u: FloatArray, data: FloatArray, lowest: FloatArray, highest: FloatArray) -> FloatArray:
    """Call a solver for all columns of ``u`` at once; return the starts where it throws."""
    count = u.shape[1]
    try:
        mapped = solver if count == 1 else solver.map(count)
        return np.array(mapped(x0=u, p=data, lbx=0, ubx=1, lbg=lowest, ubg=highest)["x"])
    except RuntimeError:
        # Some solvers throw instead of returning a status: then one by one.
        if count == 1:
            return u
        columns = [_solved(solver, u[:, [i]], data[:, [i]], lowest, highest) for i in range(count)]
        return np.concatenate(columns, axis=1)
