"""The method `schedule`: gains over ln(omega) as one optimal-control problem.

States are the logarithms of the gains, controls their slopes; the stage cost is the squared relative error, the slope
penalty its smoothness, both averaged over ln(omega). Every stage meets its scope: Re Z_h >= margin at its frequency,
over its band, over all frequencies, or a loop that is stable with every hand of the set. A dynamic programme over a
lattice gives the start, a sparse NLP the solution; frequencies that violate a scope are added until none is left.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from avc_casadi._util.progress import SILENT, Progress
from avc_casadi._util.units import N_PER_M, NS_PER_M
from avc_casadi.design.schedule.coarse_to_fine import (
    Outcome,
    as_guessed,
    constant_gains,
    refined,
    solved_from_guesses,
    with_finer_tables,
)
from avc_casadi.design.schedule.infeasible import missing_rows, steep_reason
from avc_casadi.design.schedule.scope import Slots
from avc_casadi.design.schedule.task import Task
from avc_casadi.model.problem import Problem
from avc_casadi.model.schedule import GainSchedule, Status
from avc_casadi.paper.rendered import gain_schedule
from avc_casadi.paper.rows import row_status


class ScheduleSolver:
    """Solver of schedules, with a warm start from the previous call after a change of environment, device or goal.

    The NLP is built once for each size and objective and shared by all solvers of the process.

    Args:
        constant: find the best gains that do not vary with frequency.
    """

    def __init__(self, *, constant: bool = False) -> None:
        self._constant = constant
        self._memory: tuple[tuple[object, ...], Outcome] | None = None

    def solve(self, problem: Problem, progress: Progress = SILENT) -> GainSchedule:
        """Solve for all frequencies of the problem, which increase.

        Args:
            problem: the problem.
            progress: reports the starts.

        Returns:
            The schedule; its notes state what is known of its optimality. A row whose scope no gains of the box can
            meet is infeasible and states by how much; where no schedule meets the slope limit, all rows have failed
            and state which limit would suffice.

        Raises:
            KeyboardInterrupt: Ctrl-C.
        """
        started = time.perf_counter()
        task = Task.of(problem, constant=self._constant)
        built = time.perf_counter()
        kind = _kind(problem, task)
        outcome = None
        if self._memory is not None and self._memory[0] == kind:
            outcome = _from_before(task, self._memory[1])
        if outcome is None:
            outcome = _from_scratch(task, progress)
        outcome = with_finer_tables(task, outcome)
        self._memory = (kind, outcome) if _may_be_warm(outcome) else None
        solved = time.perf_counter()
        return replace(_schedule(task, outcome), build_seconds=built - started, solve_seconds=solved - built)


def solve_schedule(problem: Problem, *, constant: bool = False, progress: Progress = SILENT) -> GainSchedule:
    """Solve the joint schedule of a problem once; see `ScheduleSolver` for repeated solves.

    Args:
        problem: the problem.
        constant: find the best gains that do not vary with frequency: same goal, scope and box.
        progress: reports the starts.
    """
    return ScheduleSolver(constant=constant).solve(problem, progress)


def _may_be_warm(outcome: Outcome) -> bool:
    """Return whether an outcome has multipliers for a warm start."""
    return outcome.solution.success and not outcome.missing.rows.any() and not outcome.guess


def _kind(problem: Problem, task: Task) -> tuple[object, ...]:
    """Return the properties that two problems share if the solution of one can start the other."""
    limited = problem.schedule.slope_limit is not None
    slots = Slots.of(problem, task.frequency_hz)
    sizes = len(task.states.floors), *slots.frequency_hz.shape
    stability, require = problem.stability, problem.realism.require
    return stability.scope, stability.model, task.objective, require, limited, sizes


def _from_before(task: Task, before: Outcome) -> Outcome | None:
    """Refine an earlier solution; None where that fails."""
    states = task.states.states(before.gains)
    return refined(task, replace(before.solution, states=states), before.slots.moved(task.problem, task.frequency_hz))


def _from_scratch(task: Task, progress: Progress) -> Outcome:
    """Solve from several guesses and refine the cheapest solution, or else the next.

    The lattice's path replaces a solution of higher cost; constant gains are the fallback without one.
    """
    missing = missing_rows(task)
    found = solved_from_guesses(task, missing, progress)
    data, outcome = task.data(found.slots, task.backoff(missing.rows, missing.tight)), None
    for solution in found.solutions:
        outcome = outcome or refined(task, solution, found.slots, missing, found.costs, solved=solution.success)
    if outcome is None or outcome.solution.cost > task.cost_of(data, found.path):
        outcome = as_guessed(task, missing, found, found.path, "the best path of a lattice") or outcome
    if outcome is None and not missing.rows.all():
        outcome = constant_gains(task, missing, found)
    if outcome is not None:
        return outcome
    best = found.solutions[0]
    message = "rows that keep violating their scope" if best.success else best.message
    failed = replace(best, success=False, message=message)
    return Outcome(failed, found.slots, task.states.gains(failed.states), missing, found.costs)


def _schedule(task: Task, outcome: Outcome) -> GainSchedule:
    missing, problem = outcome.missing, task.problem
    b, k, contact = (np.where(missing.rows, np.nan, gain) for gain in outcome.gains)
    status, reasons = row_status(problem, b, k, contact), missing.reasons
    if not outcome.solution.success:
        why = steep_reason(task, missing, outcome.solution.message)
        reasons = tuple(reason or why for reason in reasons)
        status = tuple(Status.FAILED if item.has_gains else item for item in status)
    return gain_schedule(
        problem,
        "schedule",
        (b, k, contact),
        status,
        solver="ipopt",
        reason=reasons,
        notes=_quality_notes(task, outcome),
    )


def _quality_notes(task: Task, outcome: Outcome) -> tuple[str, ...]:
    """Return notes on optimality, slopes and floors."""
    solution, costs = outcome.solution, outcome.costs
    if not solution.success:
        return (f"ipopt stopped with {solution.message}: no schedule",)
    if outcome.missing.rows.all():
        return ("no row can meet its scope: no schedule",)
    notes = [f"cost {solution.cost:.6g}: mean squared {task.objective} error and slope penalty"]
    starts = "best cells of a lattice" if task.constant else "lattice programme, constant gains, separate optima"
    if outcome.guess:
        notes.append(f"{outcome.guess}: ipopt found nothing cheaper that meets the scope at every row")
    elif costs:
        notes.append(
            f"best of {len(costs)} starts that converged ({starts});"
            f" their costs spread by {max(costs) - min(costs):.3g}; not proved to be the global optimum"
        )
    else:
        notes.append("refined from the previous schedule; not proved to be the global optimum")
    tight = int(outcome.missing.tight.sum())
    if tight:
        notes.append(f"no interior: at {tight} rows nothing is left to spare of the scope by any gains of the box")
    names = ("b", "k", "b_p")[: len(task.states.floors)]
    if len(task.frequency_hz) > 1 and not outcome.missing.rows.any():
        steepest = np.abs(np.diff(solution.states, axis=1) / np.diff(task.log_frequency)).max(axis=1)
        found = ", ".join(f"{name} {slope:.3g}" for name, slope in zip(names, steepest, strict=True))
        notes.append(f"steepest slopes d ln(gain + floor)/d ln(omega): {found}")
    require = task.problem.realism.require
    if require != "none":
        notes.append(f'realism.require = "{require}" met at every row with gains')
    floors = zip(names, task.states.floors, (NS_PER_M, N_PER_M, NS_PER_M), strict=False)
    notes.append("floors, well below which a gain counts as 0: " + ", ".join(f"{n} {f:.3g} {u}" for n, f, u in floors))
    return tuple(notes)
