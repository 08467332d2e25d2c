"""Registry of NLP solvers behind `direct`: options that keep them quiet and one map from a tolerance to their own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from avc_casadi._errors import InputError

EDGES = "edges"
"""The package's own solver: root finding along the edges of the gain box."""
DEFAULT_TOLERANCE = 1e-10


@dataclass(frozen=True)
class Backend:
    """One CasADi solver.

    Attributes:
        name: what the user asks for.
        plugin: CasADi's name.
        quiet: options that silence it.
        tolerance_options: requested tolerance, relative to the scaled problem -> its own options.
        citation: where it is described.
    """

    name: str
    plugin: str
    quiet: dict[str, Any]
    tolerance_options: Callable[[float], dict[str, Any]]
    citation: str

    def options(self, tolerance: float) -> dict[str, Any]:
        """Return all options for a requested tolerance."""
        return {
            "print_time": False,
            "error_on_fail": False,
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


def _sqp(tolerance: float) -> dict[str, Any]:
    return {"tol_du": tolerance, "tol_pr": tolerance, "max_iter": 200}


_SQP_QUIET = {"print_header": False, "print_iteration": False, "print_status": False}

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
        Backend(
            "sqpmethod",
            "sqpmethod",
            {
                **_SQP_QUIET,
                "qpsol": "daqp",
                "qpsol_options": {"error_on_fail": False},
                "convexify_strategy": "regularize",
            },
            _sqp,
            "Andersson et al., Mathematical Programming Computation 11 (2019) 1-36; QP: Arnstroem et al. (DAQP), 2022",
        ),
    )
}
SOLVERS = (EDGES, *BACKENDS)


def backend(name: str) -> Backend:
    """Return a backend by name.

    Raises:
        InputError: for an unknown name, with the names that are known.
    """
    if name not in BACKENDS:
        raise InputError.of(f"{name!r} is no solver; allowed: {', '.join(SOLVERS)}", key="--solver")
    return BACKENDS[name]
