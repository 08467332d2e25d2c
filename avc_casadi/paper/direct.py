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
from avc_casadi.paper.closed_form import solve_closed_form
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
    optimum: GainArrays
    excess: FloatArray
    local: BoolArray
    failed: BoolArray


def checked_gains(
    problem: Problem,
    loop: Loop,
    name: str = DEFAULT_SOLVER,
    tolerance: float = DEFAULT_TOLERANCE,
    *,
    progress: Progress = SILENT,
) -> CheckedGains:
    """Solve the NLP, and again from more starts, none of them an answer of `exact`, where that refutes it."""
    gains = nlp_gains(problem, loop, name, tolerance, progress=progress)
    optimum = exact_gains(problem, loop)
    # A row is solved again where its error exceeds that of `exact` by more than this share of |Z_h_ds|.
    again_above = 1e-8
    short = local = _short(loop, gains, optimum, again_above, distance=True)
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
        short = _short(loop, gains, optimum, again_above, distance=True)
    failed = _short(loop, gains, optimum, EXCESS_TOLERANCE, distance=False)
    return CheckedGains(gains, optimum, excess_error(loop, gains, optimum), local, failed)


def excess_error(loop: Loop, gains: GainArrays, optimum: GainArrays) -> FloatArray:
    """Return the excess of the gains' magnitude error over the optimum's, relative to |Z_h_ds|, shape (n,)."""
    radius = np.abs(loop.target)
    own, best = (np.abs(np.abs(loop.perceived(*each)) - radius) for each in (gains, optimum))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray((own - best) / np.where(radius == 0, 1.0, radius))


def _short(loop: Loop, gains: GainArrays, optimum: GainArrays, tolerance: float, *, distance: bool) -> BoolArray:
    """Return the rows whose magnitude error (or, if equal, distance to Z_h_ds) is larger than the optimum's."""
    excess, radius = excess_error(loop, gains, optimum), np.abs(loop.target)
    own, best = (np.abs(loop.perceived(*each) - loop.target) for each in (gains, optimum))
    with np.errstate(invalid="ignore"):
        short: BoolArray = ~(excess <= tolerance)
        if distance:
            # Of errors closer than this share of |Z_h_ds| the smaller distance decides.
            short |= (np.abs(excess) <= 1e-9) & (own - best > EXCESS_TOLERANCE * radius)
    short &= np.isfinite(optimum[0])
    return short


def cross_check_notes(problem: Problem, loop: Loop, checked: CheckedGains) -> tuple[str, ...]:
    """Return notes that compare `direct`, `exact` and the closed form; empty where no row has gains."""
    good = np.isfinite(checked.excess) & ~checked.failed
    if not good.any():
        return ()
    excess = checked.excess[good]
    exact = f"cross-check with exact: magnitude errors within {np.abs(excess).max():.1e} of |Z_h_ds|"
    if checked.failed.any():
        exact += f", but at {checked.failed.sum()} failed frequencies"
    worse = int((excess < -EXCESS_TOLERANCE).sum())
    if worse:
        exact += f"; exact is the worse at {worse} of them"
    if checked.local.any():
        exact += (
            f"; {checked.local.sum()} frequencies stopped at a local minimum and were solved again from a finer lattice"
            " of starts"
        )
    closed = solve_closed_form(problem)
    both = closed.usable & good
    if not both.any():
        return (exact, "cross-check with the closed form: it can be built at no frequency with gains")
    error = np.abs(np.abs(loop.perceived(*checked.gains)) - np.abs(loop.target))
    terms = np.abs(loop.device) + np.abs(loop.hold * loop.desired)
    more = (closed.magnitude_error - error)[both] > 1e-8 * terms[both]
    return (
        exact,
        (
            f"cross-check with the closed form: it can be built at {both.sum()} of {len(both)} frequencies, with the"
            f" same magnitude error at {both.sum() - more.sum()}, a larger one at {more.sum()}"
        ),
    )


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
