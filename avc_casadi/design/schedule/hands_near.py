"""A schedule for hands, solved again with tables of what lies about it: that of the whole box is coarse.

What a table errs by is kept as a reserve at the rows that it concerns, and costs accuracy there.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from avc_casadi.design.schedule.hands_table import hands_spline
from avc_casadi.design.schedule.nlp import solve_program
from avc_casadi.design.schedule.refine import Outcome, refined
from avc_casadi.design.schedule.task import Task

_BEYOND = (0.15, 0.05)
"""How far beyond the path each table goes, as shares of the box."""
_POINTS = {2: (32, 32), 3: (16, 16, 14)}
_ENOUGH = 1e-3
"""A gain below which the next table is not made."""


def improved_about(task: Task, outcome: Outcome) -> Outcome:
    """Solve again about an outcome, with a finer table, as long as that helps; the same for what is not for hands.

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
    """Bound the states by a box about a path, its ends on a grid: paths near each other share a table."""
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
    solution = solve_program(data, near.objective, start, extra=near.hands, patient=False)
    if not solution.success:
        return None
    found = refined(near, solution, slots, missing, best.costs, solved=True)
    if found is None or found.solution.cost >= best.solution.cost:
        return None
    return replace(found, plain=best.plain)
