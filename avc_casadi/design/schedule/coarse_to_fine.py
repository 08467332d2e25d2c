"""The stages of a schedule's solution: few frequencies before many, more of the scope, a finer table of the hands.

`solved_from_guesses` solves the NLP, `refined` adds frequencies of the scope until every row meets it exactly, and
`with_finer_tables` repeats both with finer tables about the solution.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.claims.stability.scope import ScopeSlack
from avc_casadi.design.schedule.hands import hands_spline
from avc_casadi.design.schedule.infeasible import Missing
from avc_casadi.design.schedule.initial_guess import constant_candidates, initial_guesses
from avc_casadi.design.schedule.nlp import Solution, solve_program
from avc_casadi.design.schedule.scope import REALISM_BACKOFF, Slots, realism_slack, worst_slack
from avc_casadi.design.schedule.task import Task
from avc_casadi.paper.rows import GainArrays

_STAGES = 200
"""Number of stages on which guesses are compared, where a schedule has more than twice as many."""
_ROUNDS = 20
_NEARLY = 1e-4
"""Violations below this share of the scale are removed by tightening; larger ones need their frequency added first."""
_BEYOND = (0.15, 0.05)
"""Margin of each table about the path, as shares of the box."""
_POINTS = {2: (32, 32), 3: (16, 16, 14)}
_SLOPE_ROUNDING = 1e-9
_ENOUGH = 1e-3
"""Improvement below which no further table is made."""


@dataclass(frozen=True)
class Outcome:
    """A solution whose every row meets its scope and realism exactly, unless it is listed as missing.

    Attributes:
        solution: of the NLP.
        slots: frequencies that it bounded.
        gains: (b, k, b_p), (n,) each.
        missing: rows that no gains can satisfy.
        costs: costs of the starts before frequencies were added; empty after a warm start.
        guess: the fallback used where the NLP found nothing, or nothing cheaper; empty otherwise.
    """

    solution: Solution
    slots: Slots
    gains: GainArrays
    missing: Missing
    costs: tuple[float, ...]
    guess: str = ""


@dataclass(frozen=True)
class Found:
    """Results of the initial guesses.

    Attributes:
        solutions: of the NLP, the cheapest that converged first.
        slots: the frequencies that they bounded.
        costs: of those that converged.
        path: states along the best path of the lattice, (d, n).
    """

    solutions: tuple[Solution, ...]
    slots: Slots
    costs: tuple[float, ...]
    path: FloatArray


def solved_from_guesses(task: Task, missing: Missing, progress: Progress = SILENT) -> Found:
    """Solve from each guess; long schedules on a subset of their stages first.

    Frequencies at which a guess has its worst Re Z_h are bounded from the start.
    """
    n = len(task.frequency_hz)
    if n <= 2 * _STAGES:
        return _over_all_stages(task, missing, progress)
    some = np.unique(np.linspace(0, n - 1, _STAGES).round().astype(int))
    few = task.at(task.frequency_hz[some])
    found = _over_all_stages(few, missing.at(some), progress)
    start, path = (
        np.array([np.interp(task.log_frequency, few.log_frequency, row) for row in states])
        for states in (found.solutions[0].states, found.path)
    )
    slots = _seeded(task, missing, [start])
    data = task.data(slots, task.backoff(missing.rows, missing.tight))
    return Found((solve_program(data, task.objective, start, extra=task.hands),), slots, found.costs, path)


def _over_all_stages(task: Task, missing: Missing, progress: Progress) -> Found:
    guesses = initial_guesses(task, missing)
    slots = _seeded(task, missing, guesses[:2])
    data = task.data(slots, task.backoff(missing.rows, missing.tight))
    solutions: list[Solution] = []
    for guess in guesses:
        progress.advance(len(solutions), len(guesses), "starts")
        solutions.append(solve_program(data, task.objective, guess, extra=task.hands))
    progress.advance(len(guesses), len(guesses), "starts")
    ranked = sorted(solutions, key=lambda solution: (not solution.success, solution.cost))
    costs = tuple(solution.cost for solution in ranked if solution.success)
    return Found(tuple(ranked), slots, costs, guesses[0])


def _seeded(task: Task, missing: Missing, guesses: list[FloatArray]) -> Slots:
    slots = Slots.of(task.problem, task.frequency_hz)
    for guess in guesses:
        gains = task.states.gains(guess)
        slots.add(task.problem, gains, worst_slack(task.problem, task.frequency_hz, gains), ~missing.rows)
    return slots


def refined(
    task: Task,
    solution: Solution,
    slots: Slots,
    missing: Missing | None = None,
    costs: tuple[float, ...] = (),
    *,
    solved: bool = False,
) -> Outcome | None:
    """Solve warm, adding the worst frequencies, until every row meets its scope exactly.

    Args:
        task: the problem.
        solution: start; its multipliers are used.
        slots: frequencies to begin with; not changed.
        missing: rows to leave out, or None.
        costs: passed on.
        solved: whether ``solution`` solves the problem with ``slots`` already.

    Returns:
        The outcome; None where the NLP is not solved or frequencies keep violating.
    """
    missing = missing or Missing.none(task)
    slots = slots.copy()
    backoff = task.backoff(missing.rows, missing.tight)
    for _ in range(_ROUNDS):
        if not solved:
            warm = solve_program(task.data(slots, backoff), task.objective, solution.states, solution, task.hands)
            solution = (
                warm
                if warm.success
                else solve_program(task.data(slots, backoff), task.objective, solution.states, extra=task.hands)
            )
        if not solution.success:
            return None
        solved = False
        gains = task.states.gains(solution.states)
        worst = worst_slack(task.problem, task.frequency_hz, gains)
        realism = realism_slack(task.problem, task.loop, gains)
        missed, unreal = ~worst.met & ~missing.rows, (realism < 0) & ~missing.rows
        if not (missed | unreal).any():
            return Outcome(solution, slots, gains, missing, costs)
        slots.add(task.problem, gains, worst, missed)
        closer = np.where(unreal, backoff[1] - 2 * realism + REALISM_BACKOFF, backoff[1])
        backoff = np.array([_tightened(task, solution, worst, backoff[0], missed), closer])
    return None


def _tightened(task: Task, solution: Solution, worst: ScopeSlack, backoff: FloatArray, missed: BoolArray) -> FloatArray:
    """Tighten violated rows by their violation, where it is due to the NLP's tolerance or the table of the hands."""
    if task.hands is not None:
        table = task.hands(solution.states).full()[0]
        return np.where(missed, np.maximum(table, backoff) - 1.1 * worst.slack + task.tolerance, backoff)
    short = -worst.slack / task.scale_ns_per_m
    return np.where(missed, backoff + np.where(short < _NEARLY, 2 * short, 0.0) + task.tolerance, backoff)


def with_finer_tables(task: Task, outcome: Outcome) -> Outcome:
    """Solve again about an outcome with a finer table, as long as that helps; unchanged for other scopes than hands.

    Args:
        task: the problem, with the table of the whole box.
        outcome: found with it.
    """
    best = outcome
    solved = outcome.solution.success and not outcome.missing.rows.all()
    for beyond in _BEYOND if task.hands is not None and solved else ():
        better = _better(_about(task, best, beyond), best)
        if better is None:
            continue
        gained = 1 - better.solution.cost / best.solution.cost
        best = better
        if gained < _ENOUGH:
            break
    return best


def _about(task: Task, outcome: Outcome, beyond: float) -> Task:
    """Return the states within a box about a path, its ends on a grid so that nearby paths share a table."""
    states = task.states.states(outcome.gains)
    kept = ~outcome.missing.rows
    step = beyond * (task.states.high - task.states.low)
    with np.errstate(invalid="ignore", divide="ignore"):
        first = np.floor((states[:, kept].min(axis=1) - task.states.low) / step) - 1
        last = np.ceil((states[:, kept].max(axis=1) - task.states.low) / step) + 1
    low, high = (task.states.low + np.where(step > 0, place * step, 0.0) for place in (first, last))
    near = task.states.within(low, high)
    return replace(task, states=near, hands=hands_spline(task.problem, near, _POINTS))


def _better(near: Task, best: Outcome) -> Outcome | None:
    missing, slots = best.missing, best.slots
    data = near.data(slots, near.backoff(missing.rows, missing.tight))
    start = near.states.states(best.gains)
    solution = solve_program(data, near.objective, start, extra=near.hands)
    if not solution.success:
        return None
    found = refined(near, solution, slots, missing, best.costs, solved=True)
    if found is None or found.solution.cost >= best.solution.cost:
        return None
    return replace(found, guess=best.guess)


def as_guessed(task: Task, missing: Missing, found: Found, states: FloatArray, guess: str) -> Outcome | None:
    """Return states (d, n) unchanged as an outcome, if all rows meet scope and realism and the slopes their limit."""
    data = task.data(found.slots, task.backoff(missing.rows, missing.tight))
    gains = task.states.gains(states)
    met = worst_slack(task.problem, task.frequency_hz, gains).met
    met &= realism_slack(task.problem, task.loop, gains) >= 0
    steep = np.abs(np.diff(states, axis=1)) > data.slope_limit * (1 + _SLOPE_ROUNDING) * data.step
    if steep.any() or not (met | missing.rows).all():
        return None
    solution = Solution(states, task.cost_of(data, states), True, guess, (0.0, 0.0))
    return Outcome(solution, found.slots, gains, missing, found.costs, guess)


def constant_gains(task: Task, missing: Missing, found: Found) -> Outcome | None:
    """Return the best constant gains that meet scope and realism at every row: from a lattice, then improved."""
    data = task.data(found.slots, task.backoff(missing.rows, missing.tight))
    for each in constant_candidates(task, missing, data).T:
        states = np.repeat(each[:, None], len(task.frequency_hz), axis=1)
        outcome = as_guessed(task, missing, found, states, "constant gains")
        if outcome is None:
            continue
        better = solve_program(replace(data, constant=True), task.objective, states, extra=task.hands)
        improved = refined(replace(task, constant=True), better, found.slots, missing, found.costs, solved=True)
        if improved is None or improved.solution.cost > outcome.solution.cost:
            return outcome
        return replace(improved, guess=outcome.guess)
    return None
