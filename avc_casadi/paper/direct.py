"""The method `direct`: per frequency, minimise (|Z_h_ds| - |Z_h_avc|)^2 in the gain box with Re Z_h_avc >= margin."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.model.gains import GainSchedule, Status
from avc_casadi.model.problem import Problem
from avc_casadi.paper.equations import ImpedanceLoop, loop_at
from avc_casadi.paper.exact import exact_gains, row_reasons
from avc_casadi.paper.nlp import KKT_TOLERANCE, Optimality, optimality
from avc_casadi.paper.nlp_gains import FINE, nlp_gains, solvers_for
from avc_casadi.paper.nlp_solver import DEFAULT_SOLVER, DEFAULT_TOLERANCE
from avc_casadi.paper.rows import GainArrays, SolveRecord, best_candidate, gain_schedule, row_status

EXCESS_TOLERANCE = 1e-6
"""A magnitude error that exceeds the global optimum's by more than this share of |Z_h_ds| is a failed row."""
_AGAIN_ABOVE = 1e-8
"""A row is solved again where its error exceeds that of `exact` by more than this share of |Z_h_ds|."""
_SAME_ERROR = 1e-9
"""Of errors closer than this share of |Z_h_ds| the smaller distance to Z_h_ds decides."""


@dataclass(frozen=True)
class CheckedGains:
    """Gains of CasADi checked by `exact`; arrays of shape (n,).

    Attributes:
        gains: (b, k, b_p); not a number where the solver found none.
        excess: magnitude error less that of `exact`, over |Z_h_ds|.
        local: rows that first stopped at a local minimum.
        failed: rows that are worse than `exact` in the end.
    """

    gains: GainArrays
    excess: FloatArray
    local: BoolArray
    failed: BoolArray


def checked_gains(
    problem: Problem, loop: ImpedanceLoop, name: str, tolerance: float, progress: Progress
) -> CheckedGains:
    """Return the NLP's gains, solved again from more starts where `exact` refutes them, and where they fail.

    No start is an answer of `exact`.
    """
    gains = nlp_gains(problem, loop, name, tolerance, progress=progress)
    optimum = exact_gains(problem, loop)
    local = _short(loop, gains, optimum)
    short = local
    # The default is fast but fails at one frequency in a thousand.
    for solver in (name, "sqpmethod", "ipopt") if name == DEFAULT_SOLVER else (name,):
        again = np.flatnonzero(short)
        if not again.size:
            break
        part = loop.rows(again)
        new_gains = nlp_gains(problem, part, solver, tolerance, lattice=FINE)
        b, k, p = (np.stack((old[again], new)) for old, new in zip(gains, new_gains, strict=True))
        for gain, better in zip(gains, best_candidate(problem, part, b, k, p), strict=True):
            gain[again] = better
        short = _short(loop, gains, optimum)
    excess = excess_error(loop, gains, optimum)
    with np.errstate(invalid="ignore"):
        failed = ~(excess <= EXCESS_TOLERANCE) & np.isfinite(optimum[0])
    return CheckedGains(gains, excess, local, failed)


def excess_error(loop: ImpedanceLoop, gains: GainArrays, optimum: GainArrays) -> FloatArray:
    """Return the excess of the gains' magnitude error over the optimum's, relative to |Z_h_ds|, shape (n,)."""
    radius = np.abs(loop.target)
    error, least = (np.abs(np.abs(loop.perceived(*solution)) - radius) for solution in (gains, optimum))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray((error - least) / np.where(radius == 0, 1.0, radius))


def _short(loop: ImpedanceLoop, gains: GainArrays, optimum: GainArrays) -> BoolArray:
    """Return the rows whose magnitude error, or if equal distance to Z_h_ds, is larger than the optimum's."""
    excess = excess_error(loop, gains, optimum)
    radius = np.abs(loop.target)
    distance, least = (np.abs(loop.perceived(*solution) - loop.target) for solution in (gains, optimum))
    with np.errstate(invalid="ignore"):
        farther = (np.abs(excess) <= _SAME_ERROR) & (distance - least > EXCESS_TOLERANCE * radius)
        return np.asarray((~(excess <= _AGAIN_ABOVE) | farther) & np.isfinite(optimum[0]))


def _cross_check(checked: CheckedGains) -> str:
    """Return a note that compares the gains with the optimum of `exact`; empty where no row has gains."""
    good = np.isfinite(checked.excess) & ~checked.failed
    if not good.any():
        return ""
    excess = checked.excess[good]
    note = f"cross-check with exact: magnitude errors within {np.abs(excess).max():.1e} of |Z_h_ds|"
    if checked.failed.any():
        note += f", but at {checked.failed.sum()} failed frequencies"
    exact_is_worse = int((excess < -EXCESS_TOLERANCE).sum())
    if exact_is_worse:
        note += f"; exact is worse than direct at {exact_is_worse} of them"
    if checked.local.any():
        note += f"; {checked.local.sum()} stopped at a local minimum and were solved again from more starts"
    return note


def solve_direct(
    problem: Problem, *, solver: str | None = None, tolerance: float | None = None, progress: Progress = SILENT
) -> GainSchedule:
    """Solve (11)-(12) at every frequency by CasADi, ties broken; each row is checked by KKT residual and by `exact`."""
    _check_pointwise(problem)
    started = time.perf_counter()
    name = solver or DEFAULT_SOLVER
    accuracy = tolerance or DEFAULT_TOLERANCE
    loop = loop_at(problem, problem.frequencies_hz())
    solvers_for(problem, name, accuracy)
    built = time.perf_counter()
    checked = checked_gains(problem, loop, name, accuracy, progress)
    solved = time.perf_counter()
    gains = checked.gains
    quality = optimality(problem, loop, gains)
    failed = checked.failed | (np.isfinite(gains[0]) & ~quality.acceptable())
    status = row_status(problem, *gains)
    status = tuple(Status.FAILED if bad else item for item, bad in zip(status, failed, strict=True))
    reasons = list(row_reasons(problem, status))
    for row in np.flatnonzero(failed):
        reasons[row] = _why(name, quality, checked, int(row))
    record = SolveRecord(
        solver=name,
        reason=tuple(reasons),
        build_seconds=built - started,
        solve_seconds=solved - built,
        notes=tuple(filter(None, (_recomputed(problem, quality), _cross_check(checked)))),
    )
    return gain_schedule(problem, "direct", gains, status, record)


def _check_pointwise(problem: Problem) -> None:
    """Refuse a scope or a required realism that this method does not keep."""
    scope = problem.stability.scope
    require = problem.realism.require
    if scope != "pointwise" or require != "none":
        realism = "" if require == "none" else f' or realism.require = "{require}"'
        raise UnsupportedError(
            f"method direct solves each frequency by itself and does not support the scope {scope}{realism}: "
            "use --method schedule"
        )


def _recomputed(problem: Problem, quality: Optimality) -> str:
    """Return a note with the largest violation and KKT residual; empty where no row has gains."""
    if np.isnan(quality.kkt_residual).all():
        return ""
    device = ", nominal device" if problem.device.range.model_dump(exclude_none=True) else ""
    return (
        f"recomputed{device}: largest violation of (12) {np.nanmax(quality.violation_ns_per_m):.3g}, "
        f"largest KKT residual {np.nanmax(quality.kkt_residual):.3g}"
    )


def _why(name: str, quality: Optimality, checked: CheckedGains, row: int) -> str:
    """Return why a row has failed, and the next step."""
    help_ = "try another --solver or a smaller --tolerance, or use --method exact"
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
