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
from avc_casadi.paper.equations import Loop, loop_at
from avc_casadi.paper.exact import exact_gains, row_reasons
from avc_casadi.paper.nlp import KKT_TOLERANCE, Optimality, optimality
from avc_casadi.paper.nlp_gains import FINE, nlp_gains, solvers_for
from avc_casadi.paper.nlp_solver import DEFAULT_SOLVER, DEFAULT_TOLERANCE
from avc_casadi.paper.rows import GainArrays, best_candidate, gain_schedule, row_status

EXCESS_TOLERANCE = 1e-6
"""A magnitude error that exceeds the global optimum's by more than this share of |Z_h_ds| is a failed row."""


@dataclass(frozen=True)
class CheckedGains:
    """Gains of CasADi checked by `exact`; arrays of shape (n,)."""

    gains: GainArrays
    excess: FloatArray
    local: BoolArray
    failed: BoolArray


def checked_gains(problem: Problem, loop: Loop, name: str, tolerance: float, progress: Progress) -> CheckedGains:
    """Solve the NLP, and again from more starts, none of them an answer of `exact`, where that refutes it."""
    gains = nlp_gains(problem, loop, name, tolerance, progress=progress)
    optimum = exact_gains(problem, loop)
    # A row is solved again where its error exceeds that of `exact` by more than this share of |Z_h_ds|.
    again_above = 1e-8
    short = local = _short(loop, gains, optimum, again_above)
    # The default is fast but fails at one frequency in a thousand.
    for other in (name, "sqpmethod", "ipopt") if name == DEFAULT_SOLVER else (name,):
        again = np.flatnonzero(short)
        if not again.size:
            break
        part = loop.rows(again)
        new = nlp_gains(problem, part, other, tolerance, lattice=FINE)
        b, k, p = (np.stack((own[again], found)) for own, found in zip(gains, new, strict=True))
        for gain, better in zip(gains, best_candidate(problem, part, b, k, p), strict=True):
            gain[again] = better
        short = _short(loop, gains, optimum, again_above)
    excess = excess_error(loop, gains, optimum)
    with np.errstate(invalid="ignore"):
        failed = ~(excess <= EXCESS_TOLERANCE) & np.isfinite(optimum[0])
    return CheckedGains(gains, excess, local, failed)


def excess_error(loop: Loop, gains: GainArrays, optimum: GainArrays) -> FloatArray:
    """Return the excess of the gains' magnitude error over the optimum's, relative to |Z_h_ds|, shape (n,)."""
    radius = np.abs(loop.target)
    own, best = (np.abs(np.abs(loop.perceived(*each)) - radius) for each in (gains, optimum))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray((own - best) / np.where(radius == 0, 1.0, radius))


def _short(loop: Loop, gains: GainArrays, optimum: GainArrays, tolerance: float) -> BoolArray:
    """Return the rows whose magnitude error, or if equal distance to Z_h_ds, is larger than the optimum's."""
    excess, radius = excess_error(loop, gains, optimum), np.abs(loop.target)
    own, best = (np.abs(loop.perceived(*each) - loop.target) for each in (gains, optimum))
    with np.errstate(invalid="ignore"):
        # Of errors closer than this share of |Z_h_ds| the smaller distance decides.
        farther = (np.abs(excess) <= 1e-9) & (own - best > EXCESS_TOLERANCE * radius)
        return np.asarray((~(excess <= tolerance) | farther) & np.isfinite(optimum[0]))


def _cross_check(checked: CheckedGains) -> str:
    """Return a note that compares the gains with the optimum of `exact`; empty where no row has gains."""
    good = np.isfinite(checked.excess) & ~checked.failed
    if not good.any():
        return ""
    excess = checked.excess[good]
    note = f"cross-check with exact: magnitude errors within {np.abs(excess).max():.1e} of |Z_h_ds|"
    if checked.failed.any():
        note += f", but at {checked.failed.sum()} failed frequencies"
    if worse := int((excess < -EXCESS_TOLERANCE).sum()):
        note += f"; exact is the worse at {worse} of them"
    if checked.local.any():
        note += f"; {checked.local.sum()} stopped at a local minimum and were solved again from more starts"
    return note


def solve_direct(
    problem: Problem, *, solver: str | None = None, tolerance: float | None = None, progress: Progress = SILENT
) -> GainSchedule:
    """Solve (11)-(12) at every frequency by CasADi, ties broken; each row is checked by KKT residual and by `exact`."""
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
    checked = checked_gains(problem, loop, name, accuracy, progress)
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
        notes=tuple(filter(None, [*notes, _cross_check(checked)])),
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
