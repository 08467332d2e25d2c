"""The method `direct`: per frequency, minimise (|Z_h_ds| - |Z_h_avc|)^2 in the gain box with Re Z_h_avc >= margin."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.model.gains import GainSchedule, Status
from avc_casadi.paper.backends import DEFAULT_SOLVER, DEFAULT_TOLERANCE
from avc_casadi.paper.cross_check import EXCESS_TOLERANCE, CheckedGains, checked_gains, cross_check_notes
from avc_casadi.paper.infeasible import row_reasons
from avc_casadi.paper.loop import loop_at
from avc_casadi.paper.nlp import KKT_TOLERANCE, Optimality, optimality
from avc_casadi.paper.nlp_gains import solvers_for
from avc_casadi.paper.rendered import gain_schedule
from avc_casadi.paper.rows import row_status

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem


def solve_direct(
    problem: Problem, *, solver: str | None = None, tolerance: float | None = None, progress: Progress = SILENT
) -> GainSchedule:
    """Solve (11)-(12) at every frequency by CasADi, ties broken by distance, then b_p, k and b.

    Every row's feasibility and first-order optimality are recomputed from the NLP, and CasADi's result is compared with
    the global optimum of `exact`; a row that fails is marked so, whatever the solver's status.
    """
    scope, require = problem.stability.scope, problem.realism.require
    if scope != "pointwise" or require != "none":
        real = "" if require == "none" else f' or realism.require = "{require}"'
        raise UnsupportedError(
            f"direct solves (11)-(12) at each frequency alone and knows no scope {scope}{real}: use --method schedule"
        )
    started = time.perf_counter()
    name, accuracy = solver or DEFAULT_SOLVER, tolerance or DEFAULT_TOLERANCE
    loop = loop_at(problem, problem.frequencies_hz())
    solvers_for(problem, name, accuracy)
    built = time.perf_counter()
    checked = checked_gains(problem, loop, name, accuracy, progress=progress)
    solved = time.perf_counter()
    gains, quality = checked.gains, optimality(problem, loop, checked.gains)
    failed = checked.failed | (np.isfinite(gains[0]) & ~quality.acceptable())
    status = row_status(problem, *gains)
    status = tuple(Status.FAILED if bad else item for item, bad in zip(status, failed, strict=True))
    reasons = list(row_reasons(problem, status))
    for row in np.flatnonzero(failed):
        reasons[row] = _why(name, quality, checked, int(row))
    notes = []
    if not np.isnan(quality.kkt_residual).all():
        of = ", nominal device" if problem.device.range.model_dump(exclude_none=True) else ""
        notes.append(
            f"recomputed{of}: largest violation of (12) {np.nanmax(quality.violation_ns_per_m):.3g}, "
            f"largest KKT residual {np.nanmax(quality.kkt_residual):.3g}"
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
        notes=(*notes, *cross_check_notes(problem, loop, checked)),
    )


def _why(name: str, quality: Optimality, checked: CheckedGains, row: int) -> str:
    """Return why a row has failed, and the next step."""
    help_ = "try another --solver or a smaller --tolerance; --method exact has its gains"
    excess = checked.excess[row]
    if np.isnan(excess):
        return f"{name} found no admissible gains, although there are some: {help_}"
    if not excess <= EXCESS_TOLERANCE:
        return (
            f"{name} stopped at a local minimum or short of the global optimum: its error is larger by {excess:.2g} of"
            f" |Z_h_ds| (allowed {EXCESS_TOLERANCE:g}): {help_}"
        )
    return (
        f"{name} stopped at a point with KKT residual {quality.kkt_residual[row]:.2g} (allowed {KKT_TOLERANCE:g}) and "
        f"violation {quality.violation_ns_per_m[row]:.2g}: {help_}"
    )
