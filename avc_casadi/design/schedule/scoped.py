"""`direct` beyond the pointwise reading of (12): over a band, over all frequencies, or with every hand of a set.

Where the optimum of the pointwise problem meets the wider scope, it is the optimum there too. The other frequencies are
solved in uncoupled blocks, from the best point of a lattice and from the pointwise optimum; frequencies that violate
the scope are added until none is left. At first the goal includes a small share of the complex error, which breaks the
ties of (11); then it is (11) alone, from there.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.design.schedule.coarse_to_fine import Outcome, refined
from avc_casadi.design.schedule.hands_direct import hands_optima
from avc_casadi.design.schedule.infeasible import Missing, missing_rows
from avc_casadi.design.schedule.initial_guess import lattice_nodes
from avc_casadi.design.schedule.nlp import Solution, solve_program
from avc_casadi.design.schedule.scope import Slots, realism_slack, worst_slack
from avc_casadi.design.schedule.states import States
from avc_casadi.design.schedule.task import Task
from avc_casadi.model.problem import Problem
from avc_casadi.model.schedule import GainSchedule, Status
from avc_casadi.paper.backends import DEFAULT_SOLVER
from avc_casadi.paper.cross_check import checked_gains
from avc_casadi.paper.direct import solve_direct
from avc_casadi.paper.loop import Loop, loop_at
from avc_casadi.paper.rendered import gain_schedule
from avc_casadi.paper.rows import GainArrays, row_status

_TIE = 1e-7
"""Magnitude errors closer than this, relative to |Z_h_ds|, are equal: the smaller distance wins."""
_WEIGHT = 1e4
"""Weight of each frequency's goal: errors of 1e-6 then still count against the solver's tolerance."""
_POINTS = {2: (32, 32), 3: (16, 16, 8)}
_JUDGED = 800
"""Number of lattice gains, by least error, judged exactly at a frequency without interior."""
_SWEEPS = 3
"""Rounds in which gains are tried at other frequencies than their own."""
_SAME = 1e-6
"""Solutions whose states differ by less than this are identical."""
_BLOCK = 16
"""Frequencies solved at once: the slowest of them sets the number of iterations of all."""


@dataclass(frozen=True)
class ScopedGains:
    """Result of `direct` in a scope.

    Attributes:
        gains: (b, k, b_p), each (n,); not a number where there are none.
        failed: rows that have admissible gains, but for which the solver found none, (n,).
        reasons: a sentence for each row without gains, else empty.
        separate: rows whose optimum is that of the pointwise problem, (n,), and so the global one.
        tight: feasible rows whose scope leaves no slack, (n,).
    """

    gains: GainArrays
    failed: BoolArray
    reasons: tuple[str, ...]
    separate: BoolArray
    tight: BoolArray


def solve_direct_in_scope(
    problem: Problem, *, solver: str | None = None, tolerance: float | None = None, progress: Progress = SILENT
) -> GainSchedule:
    """Solve `direct`: each frequency on its own, or with the wider scope and the realism of the problem.

    Args:
        problem: the problem.
        solver: as in `solve_direct`; beyond the pointwise scope the default alone.
        tolerance: of CasADi's solver; pointwise alone.
        progress: reports the frequencies.

    Raises:
        InputError: unknown solver.
        UnsupportedError: another solver beyond the pointwise scope.
    """
    if problem.stability.scope == "pointwise" and problem.realism.require == "none":
        return solve_direct(problem, solver=solver, tolerance=tolerance, progress=progress)
    return solve_scoped(problem, solver=solver, progress=progress)


def solve_scoped(problem: Problem, *, solver: str | None = None, progress: Progress = SILENT) -> GainSchedule:
    """Solve `direct` for a scope other than pointwise.

    Args:
        problem: the problem.
        solver: None or the default of `solve_direct`, and IPOPT for the frequencies that it does not solve.
        progress: reports the frequencies.

    Raises:
        UnsupportedError: another solver.
    """
    scope, require = problem.stability.scope, problem.realism.require
    if solver not in {None, DEFAULT_SOLVER}:
        real = "" if require == "none" else f" and realism {require}"
        relax = "" if require == "none" else ', and require = "none" in [realism]'
        raise UnsupportedError(
            f"solver {solver} solves (11)-(12) at single frequencies, not with scope {scope}{real};"
            f' leave out --solver, or set scope = "pointwise" in [stability]{relax}'
        )
    started = time.perf_counter()
    loop = loop_at(problem, problem.frequencies_hz())
    found = scoped_gains(problem, loop, progress)
    seconds = time.perf_counter() - started
    status = row_status(problem, *found.gains)
    status = tuple(Status.FAILED if bad else item for item, bad in zip(status, found.failed, strict=True))
    failed = "ipopt found no gains that meet the constraints, although there are some: try method schedule"
    reasons = tuple(failed if bad else reason for reason, bad in zip(found.reasons, found.failed, strict=True))
    separate = int(found.separate.sum())
    met = f"scope {scope}" if require == "none" else f"scope {scope} and realism {require}"
    note = (
        f"{met} met exactly at every row with gains; at {separate} frequencies the optimum is that of the"
        " pointwise problem, elsewhere the best of several starts, not proved to be the global optimum"
    )
    return gain_schedule(
        problem,
        "direct",
        found.gains,
        status,
        solver=f"{DEFAULT_SOLVER} and ipopt",
        reason=reasons,
        solve_seconds=seconds,
        notes=(note, *_tight_note(found)),
    )


def _tight_note(found: ScopedGains) -> tuple[str, ...]:
    count = int(found.tight.sum())
    if not count:
        return ()
    return (f"no interior: at {count} frequencies nothing is left to spare of the scope by any gains of the box",)


def scoped_gains(problem: Problem, loop: Loop, progress: Progress = SILENT) -> ScopedGains:
    """Minimise (11) at each frequency subject to the problem's scope, met exactly, and to the gain box."""
    problem = _alone(problem)
    frequency = problem.frequencies_hz()
    # Where every hand must be stable, (12) need not hold: only then do these gains include all that meet the scope.
    hands = problem.stability.scope == "hands"
    checked = checked_gains(problem, loop, margin_ns_per_m=-math.inf if hands else None, progress=progress)
    b, k, p = checked.gains
    found = np.isfinite(b) & ~checked.failed
    b0, k0, p0 = (np.where(found, gain, 0.0) for gain in (b, k, p))
    separate = found & worst_slack(problem, frequency, (b0, k0, p0)).met
    separate &= realism_slack(problem, loop, (b0, k0, p0)) >= 0
    rest = np.flatnonzero(~separate)
    failed, reasons = np.zeros(len(frequency), dtype=bool), [""] * len(frequency)
    tight = np.zeros(len(frequency), dtype=bool)
    if rest.size:
        if hands:
            best, lost, why = _with_hands(problem, frequency[rest], progress)
        else:
            task = Task.of(problem, frequency[rest], objective="tied")
            missing = missing_rows(task)
            best = _in_parts(task, missing, (b[rest], k[rest], p[rest]), math.ceil(rest.size / _BLOCK), progress)
            best = _from_others(task, missing, _best_without_room(task, missing, best))
            lost, why, tight[rest] = missing.rows, list(missing.reasons), missing.tight
        for gain, value in zip((b, k, p), best, strict=True):
            gain[rest] = value
        failed[rest] = np.isnan(best[0]) & ~lost
        for row, reason in zip(rest, why, strict=True):
            reasons[row] = reason
    return ScopedGains((b, k, p), failed, tuple(reasons), separate, tight)


def _with_hands(
    problem: Problem, frequency_hz: FloatArray, progress: Progress
) -> tuple[GainArrays, BoolArray, list[str]]:
    """Return the same with every hand: gains (n,), the rows without, and why."""
    best = hands_optima(problem, States.of(problem, loop_at(problem, frequency_hz)), frequency_hz, progress)
    none = np.flatnonzero(np.isnan(best[0]))
    rows, reasons = np.zeros(len(frequency_hz), dtype=bool), [""] * len(frequency_hz)
    if none.size:
        some = missing_rows(Task.of(problem, frequency_hz[none], objective="tied"))
        rows[none] = some.rows
        for row, reason in zip(none, some.reasons, strict=True):
            reasons[row] = reason
    return best, rows, reasons


def _alone(problem: Problem) -> Problem:
    """Return the problem with uncoupled frequencies and without the credit that `schedule` gives."""
    return problem.changed(
        schedule={
            "slope_penalty": 0.0,
            "slope_limit": None,
            "interaction_hz": None,
            "contact_damping_penalty": 0.0,
            "hand_damping_ns_per_m": 0.0,
        }
    )


def _in_parts(task: Task, missing: Missing, relaxed: GainArrays, parts: int, progress: Progress = SILENT) -> GainArrays:
    """Solve frequencies in blocks, one after the other."""
    b, k, p = relaxed
    found = []
    for rows in np.array_split(np.arange(len(task.frequency_hz)), parts):
        part = replace(task.at(task.frequency_hz[rows]), weight=_WEIGHT * len(rows))
        found.append(_solved(part, missing.at(rows), (b[rows], k[rows], p[rows])))
        progress.advance(int(rows[-1]) + 1, len(task.frequency_hz), "frequencies with a wider scope")
    return tuple(np.concatenate(gain) for gain in zip(*found, strict=True))  # type: ignore[return-value]


def _solved(task: Task, missing: Missing, relaxed: GainArrays) -> GainArrays:
    """Solve all frequencies at once; where that fails, in halves, so that one failure does not affect the others."""
    best = _best_outcome(task, missing, relaxed)
    if np.isfinite(best[0]).any() or missing.rows.all() or len(task.frequency_hz) == 1:
        return best
    return _in_parts(task, missing, relaxed, 2)


def _best_outcome(task: Task, missing: Missing, relaxed: GainArrays) -> GainArrays:
    """Return gains (n,) from the lattice and from the relaxed optimum, the better at each frequency."""
    lattice = _lattice_optima(task, missing)
    known = np.isfinite(relaxed[0])
    b, k, p = (np.where(known, gain, 0.0) for gain in relaxed)
    return _from_starts(task, missing, [lattice, np.where(known, task.states.states((b, k, p)), lattice)])


def _from_others(task: Task, missing: Missing, best: GainArrays) -> GainArrays:
    """Restart from gains of another frequency where these are better and meet the scope."""
    at_all, radius = loop_at(task.problem, task.frequency_hz[:, None]), np.abs(task.loop.target)
    for _ in range(_SWEEPS):
        error = np.abs(np.abs(at_all.perceived(*(gain[None] for gain in best))) / radius[:, None] - 1)
        error = np.where(np.isfinite(error), error, np.inf)
        lowest, other = error.min(axis=1), error.argmin(axis=1)
        gains = tuple(np.where(np.isfinite(gain), gain, 0.0)[other] for gain in best)
        taken = (gains[0], gains[1], gains[2])
        better = ~missing.rows & (lowest < error.diagonal() - _TIE)
        better &= worst_slack(task.problem, task.frequency_hz, taken).met
        better &= realism_slack(task.problem, task.loop, taken) >= 0
        rows = np.flatnonzero(better)
        if not rows.size:
            break
        part = replace(task.at(task.frequency_hz[rows]), weight=_WEIGHT * len(rows))
        start = task.states.states((taken[0][rows], taken[1][rows], taken[2][rows]))
        found = _from_starts(part, missing.at(rows), [start])
        gained = np.abs(np.abs(part.loop.perceived(*found)) / radius[rows] - 1) < lowest[rows] - _TIE
        for gain, given, new in zip(best, taken, found, strict=True):
            gain[rows] = np.where(gained, new, given[rows])
    return best


def _best_without_room(task: Task, missing: Missing, best: GainArrays) -> GainArrays:
    """Return the best gains of a lattice where a scope has no interior for a solver, unless better ones are known.

    The lattice is judged exactly, the gains of least error first, then those known to meet the scope.
    """
    rows = np.flatnonzero(missing.tight)
    if not rows.size:
        return best
    nodes = lattice_nodes(task.states.low, task.states.high)[1]
    if task.problem.stability.scope == "all":
        # The same gains meet it at every frequency.
        somewhere = np.full(nodes.shape[1], task.frequency_hz[0])
        nodes = nodes[:, worst_slack(task.problem, somewhere, task.states.gains(nodes)).met]
    for row in rows:
        part = task.at(task.frequency_hz[row : row + 1])
        nearest = np.argsort(_magnitude_error(part, task.states.gains(nodes)), kind="stable")[:_JUDGED]
        gains = task.states.gains(np.concatenate((nodes[:, nearest], missing.states[:, [row]]), axis=1))
        met = worst_slack(task.problem, np.repeat(part.frequency_hz, len(gains[0])), gains).met
        b, k, p = (gain[:, None] for gain in gains)
        met &= realism_slack(task.problem, part.loop, (b, k, p))[:, 0] >= 0
        if met.any():
            error = np.where(met, _magnitude_error(part, gains), np.inf)
            known = _magnitude_error(part, tuple(gain[row : row + 1] for gain in best))[0]
            if not known <= error.min():
                for gain, new in zip(best, gains, strict=True):
                    gain[row] = new[error.argmin()]
    return best


def _magnitude_error(task: Task, gains: tuple[FloatArray, ...]) -> FloatArray:
    """Return the magnitude errors of gains (m,) at the only frequency of a task, (m,)."""
    radius = np.abs(task.loop.target)
    return np.asarray(np.abs(np.abs(task.loop.perceived(*gains)) / radius - 1))


def _from_starts(task: Task, missing: Missing, starts: list[FloatArray]) -> GainArrays:
    """Return gains (n,) of the best start at each frequency, in the order of `direct`; not a number if unsolved."""
    slots = Slots.of(task.problem, task.frequency_hz)
    best = tuple(np.full(len(task.frequency_hz), np.nan) for _ in range(3))
    error, distance = (np.full(len(task.frequency_hz), np.inf) for _ in range(2))
    for start in starts:
        gains = task.states.gains(start)
        slots.add(task.problem, gains, worst_slack(task.problem, task.frequency_hz, gains), ~missing.rows)
    light = replace(task, weight=float(len(task.frequency_hz)))
    data = light.data(slots, light.backoff(missing.rows, missing.tight))
    before = None
    for start in starts:
        solution = solve_program(data, light.objective, start, extra=light.hands)
        if before is not None and np.abs(solution.states - before).max() < _SAME:
            continue
        before = solution.states if solution.success else None
        for outcome in _outcomes(light, task, solution, slots, missing):
            z = task.loop.perceived(*outcome.gains)
            radius = np.abs(task.loop.target)
            new_error, new_distance = np.abs(np.abs(z) / radius - 1), np.abs(z - task.loop.target) / radius
            closer = (np.abs(new_error - error) <= _TIE) & (new_distance < distance)
            better = ~missing.rows & ((new_error < error - _TIE) | closer)
            error, distance = np.where(better, new_error, error), np.where(better, new_distance, distance)
            best = tuple(np.where(better, new, old) for new, old in zip(outcome.gains, best, strict=True))
    return best[0], best[1], best[2]


def _outcomes(light: Task, task: Task, solution: Solution, slots: Slots, missing: Missing) -> Iterator[Outcome]:
    """Refine a solution: lightly weighted, fully, and with (11) alone, each from the one before.

    Twice with (11) alone: the tightening for a missed frequency is more than is needed once it is added.
    """
    alone = replace(task, objective="magnitude")
    outcome = refined(light, solution, slots, missing, solved=True)
    weight = light.weight
    for stage in (task, alone, alone):
        if outcome is None:
            return
        yield outcome
        share = stage.weight / weight
        on_states, on_constraints = outcome.solution.multipliers
        solution = replace(outcome.solution, multipliers=(share * on_states, share * on_constraints))
        weight = stage.weight
        outcome = refined(stage, solution, outcome.slots, missing)
    if outcome is not None:
        yield outcome


def _lattice_optima(task: Task, missing: Missing) -> FloatArray:
    """Return the cheapest states (d, n) of a lattice, each frequency separately."""
    data = task.data(Slots.of(task.problem, task.frequency_hz, spread=True), task.backoff(missing.rows, missing.tight))
    nodes = lattice_nodes(task.states.low, task.states.high, _POINTS[len(data.low)])[1]
    cost = task.lattice_costs(data)(nodes)
    chosen = [int(cost(stage).argmin()) for stage in range(len(task.frequency_hz))]
    return np.asarray(nodes[:, chosen])
