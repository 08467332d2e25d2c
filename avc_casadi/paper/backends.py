"""Registry of the solvers behind `direct`: options that silence them, and the mapping of a requested tolerance.

Left out, although CasADi ships them: feasiblesqpmethod stops short of the optimum and calls it solved (0 of 13
frequencies of a stiff wall right), sleqp may stall for seconds at a point that it reports as dead, bonmin solves, but
intercepts Ctrl-C, qrsqp is sqpmethod with fewer safeguards, scpgen needs code generation; blocksqp, worhp, snopt,
knitro and madnlp need libraries that CasADi's wheel does not bring.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from avc_casadi._errors import InputError

DEFAULT_SOLVER = "sqpmethod-qrqp"
DEFAULT_TOLERANCE = 1e-12


@dataclass(frozen=True)
class Backend:
    """One CasADi solver.

    Attributes:
        name: as the user gives it.
        plugin: CasADi's name.
        quiet: options that silence it.
        tolerance_options: requested tolerance, relative to the scaled problem -> its own options.
        citation: its reference.
        prints: whether it writes to the terminal regardless of its options.
    """

    name: str
    plugin: str
    quiet: dict[str, Any]
    tolerance_options: Callable[[float], dict[str, Any]]
    citation: str
    prints: bool = False

    def options(self, tolerance: float) -> dict[str, Any]:
        """Return all options for a requested tolerance."""
        return {
            "print_time": False,
            "error_on_fail": False,
            "show_eval_warnings": False,
            **self.quiet,
            **self.tolerance_options(tolerance),
        }


def _ipopt(tolerance: float) -> dict[str, Any]:
    # Bounds are not relaxed: a relaxed bound would be "better" than the optimum.
    return {
        "ipopt.tol": tolerance,
        "ipopt.constr_viol_tol": tolerance,
        "ipopt.acceptable_iter": 0,
        "ipopt.bound_relax_factor": 0.0,
        "ipopt.max_iter": 500,
    }


_QP_QUIET = {"print_iter": False, "print_header": False, "print_info": False}


def _sqp(tolerance: float) -> dict[str, Any]:
    return {"tol_du": tolerance, "tol_pr": tolerance, "max_iter": 200}


def _sqpmethod(name: str, qp: str, qp_citation: str, qp_quiet: dict[str, Any], *, prints: bool = False) -> Backend:
    quiet = {
        "print_header": False,
        "print_iteration": False,
        "print_status": False,
        "qpsol": qp,
        "qpsol_options": {"error_on_fail": False, **qp_quiet},
        # (11) is not convex: without this the QP may be unbounded. Reflected eigenvalues keep the length of a step,
        # where a shift of them all makes it short: 3 iterations in place of 9.
        "convexify_strategy": "eigen-reflect",
    }
    citation = f"Andersson et al., Mathematical Programming Computation 11 (2019) 1-36; QP: {qp_citation}"
    return Backend(name, "sqpmethod", quiet, _sqp, citation, prints=prints)


BACKENDS = {
    backend.name: backend
    for backend in (
        Backend(
            "ipopt",
            "ipopt",
            {"ipopt.print_level": 0, "ipopt.sb": "yes"},
            _ipopt,
            "Waechter and Biegler, Mathematical Programming 106 (2006) 25-57",
        ),
        _sqpmethod("sqpmethod", "daqp", "Arnstroem, Bemporad and Axehill, IEEE TAC 67 (2022) 4362-4369 (DAQP)", {}),
        _sqpmethod("sqpmethod-ipqp", "ipqp", "CasADi's interior point method", _QP_QUIET, prints=True),
        _sqpmethod(
            "sqpmethod-qrqp",
            "qrqp",
            "CasADi's active-set method on a sparse QR factorisation",
            _QP_QUIET,
        ),
        Backend(
            "fatrop",
            "fatrop",
            {"fatrop.print_level": 0},
            lambda tolerance: {"fatrop.tolerance": tolerance, "fatrop.max_iter": 500},
            "Vanroye et al., IROS 2023, 10036-10043",
        ),
        Backend(
            "uno",
            "uno",
            {"uno.logger": "SILENT"},
            lambda tolerance: {
                "uno.primal_tolerance": tolerance,
                "uno.dual_tolerance": tolerance,
                "uno.max_iterations": 500,
            },
            "Vanaret and Leyffer, Unifying nonlinearly constrained optimization (2024)",
            prints=True,
        ),
        Backend(
            "alpaqa",
            "alpaqa",
            {},
            lambda tolerance: {"alpaqa": {"alm.tolerance": tolerance, "alm.dual_tolerance": tolerance}},
            "Pas, Schuurmans and Patrinos, ECC 2022, 417-422",
            prints=True,
        ),
    )
}


def backend(name: str) -> Backend:
    """Return a backend by name.

    Raises:
        InputError: for an unknown name, with the names that are known.
    """
    if name not in BACKENDS:
        raise InputError.of(f"{name!r} is no solver; allowed: {', '.join(BACKENDS)}", key="solver")
    return BACKENDS[name]
