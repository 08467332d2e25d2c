"""The method `schedule`: gains over ln(omega) as one optimal-control problem.

States are the logarithms of the gains, controls their slopes; the stage cost is the squared relative error, the slope
penalty its smoothness, both averaged over ln(omega). Every stage meets its scope: Re Z_h >= margin at its frequency, over
its band, over all frequencies, or a loop that is stable with every hand of the set. A dynamic programme over a lattice
gives the start, a sparse NLP the solution; frequencies that violate a scope are added until none is left.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from avc_casadi.design._exact import exact_gains
from avc_casadi.design._gains import BoolArray, FloatArray, GainSchedule, Status, gain_schedule
from avc_casadi.design._rows import Gains, row_status
from avc_casadi.design.schedule._infeasible import Missing, missing_rows
from avc_casadi.design.schedule._lattice import lattice_path
from avc_casadi.design.schedule._program import Solution, solve_program
from avc_casadi.design.schedule._quality import quality_notes
from avc_casadi.design.schedule._scope import Slots, worst_slack
from avc_casadi.design.schedule._task import BACKOFF, HANDS_BACKOFF, Task
from avc_casadi.problem import Problem

_ROUNDS = 15


@dataclass(frozen=True)
class _Outcome:
    """A solution whose every row meets its scope exactly, unless it is listed as missing."""

    solution: Solution
    slots: Slots
    gains: Gains
    missing: Missing
    starts: tuple[float, ...]


class ScheduleSolver:
    """Solves schedules; a second call with a changed environment, device or goal starts from the first one's solution.

    The NLP is built once for each size and objective and shared by all solvers of the process.
    """

    def __init__(self) -> None:
        self._memory: tuple[tuple[object, ...], _Outcome] | None = None

    def solve(self, problem: Problem) -> GainSchedule:
        """Solve for all frequencies of the problem, which increase.

        Returns:
            The schedule; its notes say how good it is known to be. A row whose scope no gains of the box can meet is
            infeasible and says by how much; where the slope limit cannot be met, all rows are.
        """
        started = time.perf_counter()
        task = Task.of(problem)
        built = time.perf_counter()
        shape = (problem.coupling.structure, problem.stability.scope, problem.realism.objective, len(task.frequency_hz))
        outcome = None
        if self._memory is not None and self._memory[0] == shape and problem.stability.scope != "hands":
            outcome = _refined(task, self._memory[1].solution, self._memory[1].slots, Missing.none(task), ())
        if outcome is None:
            outcome = _from_scratch(task)
        self._memory = (shape, outcome) if outcome.solution.success else None
        solved = time.perf_counter()
        missing = outcome.missing.rows
        gains: Gains = tuple(np.where(missing, np.nan, gain) for gain in outcome.gains)  # type: ignore[assignment]
        status = row_status(problem, *gains)
        if not outcome.solution.success:
            status = tuple(Status.FAILED if item.has_gains else item for item in status)
        return replace(
            gain_schedule(
                problem,
                "schedule",
                gains,
                status,
                solver="ipopt",
                reason=outcome.missing.reasons,
                notes=quality_notes(task, gains, outcome.solution, outcome.starts),
            ),
            build_seconds=built - started,
            solve_seconds=solved - built,
        )


def solve_schedule(problem: Problem) -> GainSchedule:
    """Solve the joint schedule of a problem once; see `ScheduleSolver` for repeated solves."""
    return ScheduleSolver().solve(problem)


def _from_scratch(task: Task) -> _Outcome:
    """Solve from several starts, keep the cheapest, then add what violates the scope."""
    slots = Slots.of(task.problem, task.frequency_hz)
    missing = missing_rows(task, slots)
    data = task.data(slots, _backoff(task, missing.rows, 1.0))
    lattice = lattice_path(
        lambda nodes, stage: task.lattice_cost(data, nodes, stage),
        (data.low, data.high),
        task.log_frequency,
        data.slope_penalty,
        data.slope_limit,
    )
    separate = exact_gains(task.problem, task.loop)
    filled = [np.where(np.isnan(gain), np.nanmean(gain) if np.isfinite(gain).any() else 0.0, gain) for gain in separate]
    starts = [lattice.path, lattice.constant, task.states.states((filled[0], filled[1], filled[2]))]
    solutions = [_program(task, data, start, 1.0) for start in starts]
    reached = [solution for solution in solutions if solution.success] or solutions
    best = min(reached, key=lambda solution: solution.cost)
    costs = tuple(solution.cost for solution in solutions if solution.success)
    outcome = _refined(task, best, slots, missing, costs)
    if outcome is None:
        failed = replace(best, success=False)
        return _Outcome(failed, slots, task.states.gains(best.states), missing, costs)
    return outcome


def _program(task: Task, data: object, start: FloatArray, tightness: float, warm: Solution | None = None) -> Solution:
    return solve_program(
        data,  # type: ignore[arg-type]
        task.problem.realism.objective,
        start,
        multipliers=None if warm is None else warm.multipliers,
        extra=task.hands,
        extra_least=HANDS_BACKOFF * tightness,
    )


def _backoff(task: Task, dropped: BoolArray, tightness: float) -> FloatArray:
    return np.where(dropped, -np.inf, BACKOFF * tightness) + np.zeros(len(task.frequency_hz))


def _refined(
    task: Task, solution: Solution, slots: Slots, missing: Missing, costs: tuple[float, ...]
) -> _Outcome | None:
    """Solve warm, adding the worst frequencies, until every row meets its scope exactly; None where that fails."""
    tightness = 1.0
    slots = Slots(slots.frequency_hz.copy(), slots.used.copy())
    for _ in range(_ROUNDS):
        data = task.data(slots, _backoff(task, missing.rows, tightness))
        solution = _program(task, data, solution.states, tightness, solution)
        if not solution.success:
            solution = _program(task, data, solution.states, tightness)
        if not solution.success:
            return None
        gains = task.states.gains(solution.states)
        worst = worst_slack(task.problem, task.frequency_hz, gains)
        missed = ~worst.met & ~missing.rows
        if not missed.any():
            return _Outcome(solution, slots, gains, missing, costs)
        if len(slots.frequency_hz) > 2:
            slots.add(task.problem, worst, missed)
        # Where the frequency stood already, or there is nothing to add, the tolerance of the NLP is what is missing.
        tightness *= 2
    return None
