"""CasADi's solvers behind `direct`: options that silence them, and the mapping of a requested tolerance.

Any other plugin of `nlpsol` is taken by its name, with its own tolerance and output; its answers are checked like all.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import casadi as ca

from avc_casadi._errors import InputError

DEFAULT_SOLVER = "sqpmethod-qrqp"
DEFAULT_TOLERANCE = 1e-12

Options = dict[str, Any]
_QUIET: Options = {"print_time": False, "error_on_fail": False, "show_eval_warnings": False}


def _ipopt(tolerance: float) -> tuple[str, Options]:
    # Waechter and Biegler, Mathematical Programming 106 (2006) 25-57. Bounds are not relaxed: a relaxed bound would be
    # "better" than the optimum.
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
            f"{name!r} is no solver; allowed: {known}, or another nlpsol plugin of this CasADi", key="solver"
        )
    if tolerance != DEFAULT_TOLERANCE:
        raise InputError.of(f"goes with {known}; {name} keeps its own: leave it out", key="tolerance")
    return name, dict(_QUIET)
