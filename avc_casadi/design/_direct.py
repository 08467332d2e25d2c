"""The method `direct`: per frequency, minimise (|Z_h_ds| - |Z_h_avc|)^2 in the gain box with Re Z_h_avc >= margin."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.design._backends import DEFAULT_TOLERANCE, EDGES
from avc_casadi.design._edge_search import edge_search_gains
from avc_casadi.design._gains import GainSchedule, Status, gain_schedule
from avc_casadi.design._infeasible import row_reasons
from avc_casadi.design._nlp_solver import nlp_gains, nlp_solvers
from avc_casadi.design._optimality import KKT_TOLERANCE, optimality
from avc_casadi.design._rows import row_status
from avc_casadi.impedance import loop_at

if TYPE_CHECKING:
    from avc_casadi.problem import Problem


def solve_direct(problem: Problem, *, solver: str | None = None, tolerance: float | None = None) -> GainSchedule:
    """Solve (11)-(12) at every frequency, ties broken by distance, then b_p, k and b.

    Every row's feasibility and first-order optimality are recomputed from the CasADi NLP; a row that fails is marked
    so, whatever the solver said.

    Args:
        problem: the problem.
        solver: ``edges`` (default, see `_edge_search`) or a backend of CasADi, one NLP a frequency and start.
        tolerance: relative tolerance of the CasADi backends; the edge search always goes to rounding.

    Raises:
        InputError: unknown solver.
    """
    started = time.perf_counter()
    name, accuracy = solver or EDGES, tolerance or DEFAULT_TOLERANCE
    loop = loop_at(problem, problem.frequencies_hz())
    notes = []
    if name == EDGES:
        built = time.perf_counter()
        gains = edge_search_gains(problem, loop)
    else:
        nlp_solvers(name, accuracy)
        built = time.perf_counter()
        gains, false_success = nlp_gains(problem, loop, name, accuracy)
        if false_success:
            notes.append(f"{name} reported success {false_success} times with a point that violates (12)")
    solved = time.perf_counter()
    quality = optimality(problem, loop, gains)
    status = row_status(problem, *gains)
    failed = np.isfinite(gains[0]) & np.logical_not(quality.acceptable())
    status = tuple(Status.FAILED if bad else item for item, bad in zip(status, failed, strict=True))
    reasons = list(row_reasons(problem, status))
    for row in np.flatnonzero(failed):
        reasons[row] = (
            f"{name} stopped at a point with KKT residual {quality.kkt_residual[row]:.2g} (allowed {KKT_TOLERANCE:g})"
            f" and violation {quality.violation_ns_per_m[row]:.2g} N.s/m: use --solver {EDGES} or a smaller --tolerance"
        )
    if not np.isnan(quality.kkt_residual).all():
        notes.append(
            f"recomputed: largest violation of (12) {np.nanmax(quality.violation_ns_per_m):.3g} N.s/m,"
            f" largest KKT residual {np.nanmax(quality.kkt_residual):.3g}"
        )
    return gain_schedule(
        problem,
        "direct",
        gains,
        status,
        solver=name,
        reason=tuple(reasons),
        build_seconds=built - started,
        solve_seconds=solved - built,
        notes=tuple(notes),
    )
