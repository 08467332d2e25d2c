"""The method `direct`: per frequency, minimise (|Z_h_ds| - |Z_h_avc|)^2 in the gain box with Re Z_h_avc >= margin."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.model.schedule import GainSchedule, Status
from avc_casadi.paper.backends import DEFAULT_TOLERANCE, EDGES
from avc_casadi.paper.edge_search import edge_search_gains
from avc_casadi.paper.infeasible import row_reasons
from avc_casadi.paper.loop import Loop, loop_at
from avc_casadi.paper.nlp import KKT_TOLERANCE, Optimality, optimality
from avc_casadi.paper.nlp_solver import nlp_gains, nlp_solvers
from avc_casadi.paper.rendered import gain_schedule
from avc_casadi.paper.rows import GainArrays, row_status

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem

EXCESS_TOLERANCE = 1e-6
"""A magnitude error that exceeds the global optimum's by more than this share of |Z_h_ds| is a failed row."""


def solve_direct(
    problem: Problem, *, solver: str | None = None, tolerance: float | None = None, progress: Progress = SILENT
) -> GainSchedule:
    """Solve (11)-(12) at every frequency, ties broken by distance, then b_p, k and b.

    Every row's feasibility and first-order optimality are recomputed from the CasADi NLP, and what a CasADi backend
    returns is compared with the global optimum; a row that fails is marked so, whatever the solver said.

    Args:
        problem: the problem.
        solver: ``edges`` (default, see `_edge_search`) or a backend of CasADi, one NLP a frequency and start.
        tolerance: relative tolerance of the CasADi backends; the edge search always goes to rounding.
        progress: told of the frequencies.

    Raises:
        InputError: unknown solver.
        UnsupportedError: a solver that this CasADi was built without.
        KeyboardInterrupt: Ctrl-C, also from within a solver.
    """
    started = time.perf_counter()
    name, accuracy = solver or EDGES, tolerance or DEFAULT_TOLERANCE
    loop = loop_at(problem, problem.frequencies_hz())
    notes = []
    if name == EDGES:
        built = time.perf_counter()
        gains = optimum = edge_search_gains(problem, loop, progress=progress)
        solved = time.perf_counter()
    else:
        nlp_solvers(name, accuracy)
        built = time.perf_counter()
        found = nlp_gains(problem, loop, name, accuracy, progress=progress)
        solved = time.perf_counter()
        gains = found.gains
        searched = edge_search_gains(problem, loop)
        b, k, p = (np.where(np.isnan(searched[0]), own, best) for own, best in zip(gains, searched, strict=True))
        optimum = b, k, p
        if found.false_success:
            notes.append(f"{name} reported success, but violates (12), in {found.false_success} of {found.calls} calls")
    quality, excess = optimality(problem, loop, gains), excess_error(loop, gains, optimum)
    failed = _failed(quality, excess, gains, optimum)
    status = row_status(problem, *gains)
    status = tuple(Status.FAILED if bad else item for item, bad in zip(status, failed, strict=True))
    reasons = list(row_reasons(problem, status))
    for row in np.flatnonzero(failed):
        reasons[row] = _why(name, quality, excess, int(row))
    if not np.isnan(quality.kkt_residual).all():
        of = ", nominal device" if problem.device.range.model_dump(exclude_none=True) else ""
        notes.append(
            f"recomputed{of}: largest violation of (12) {np.nanmax(quality.violation_ns_per_m):.3g} N.s/m,"
            f" largest KKT residual {np.nanmax(quality.kkt_residual):.3g}"
        )
    if name != EDGES and not np.isnan(excess).all():
        notes.append(f"distance to the global optimum: at most {np.nanmax(excess):.3g} of |Z_h_ds|")
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


def excess_error(loop: Loop, gains: GainArrays, optimum: GainArrays) -> FloatArray:
    """By how much the magnitude error of gains exceeds the optimum's, relative to |Z_h_ds|, shape (n,)."""
    radius = np.abs(loop.target)
    own, best = (np.abs(np.abs(loop.perceived(*each)) - radius) for each in (gains, optimum))
    with np.errstate(invalid="ignore", divide="ignore"):
        excess: FloatArray = (own - best) / np.where(radius == 0, 1.0, radius)
    return excess


def _failed(quality: Optimality, excess: FloatArray, gains: GainArrays, optimum: GainArrays) -> BoolArray:
    """Rows whose gains are not the optimum, or that have none although there are some."""
    none, feasible = np.isnan(gains[0]), np.isfinite(optimum[0])
    with np.errstate(invalid="ignore"):
        bad: BoolArray = np.logical_not(quality.acceptable()) | np.logical_not(excess <= EXCESS_TOLERANCE)
    return np.where(none, feasible, bad)


def _why(name: str, quality: Optimality, excess: FloatArray, row: int) -> str:
    """Say why a row has failed, and what to do."""
    help_ = "use --solver edges or a smaller --tolerance"
    if np.isnan(excess[row]):
        return f"{name} found no admissible gains, although there are some: {help_}"
    if not excess[row] <= EXCESS_TOLERANCE:
        return (
            f"{name} stopped short of the global optimum: its error is larger by {excess[row]:.2g} of |Z_h_ds| (allowed"
            f" {EXCESS_TOLERANCE:g}): {help_}"
        )
    return (
        f"{name} stopped at a point with KKT residual {quality.kkt_residual[row]:.2g} (allowed {KKT_TOLERANCE:g})"
        f" and violation {quality.violation_ns_per_m[row]:.2g} N.s/m: {help_}"
    )
