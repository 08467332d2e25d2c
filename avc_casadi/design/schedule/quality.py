"""How good a schedule is known to be, in sentences for people."""

from __future__ import annotations

import numpy as np

from avc_casadi.design.schedule.refine import Outcome
from avc_casadi.design.schedule.task import Task


def quality_notes(task: Task, outcome: Outcome) -> tuple[str, ...]:
    """Say what is known of optimality, slopes and floors."""
    solution, costs = outcome.solution, outcome.costs
    if not solution.success:
        return (f"ipopt stopped with {solution.message}: no schedule",)
    if outcome.missing.rows.all():
        return ("no row can meet its scope: no schedule",)
    notes = [f"cost {solution.cost:.6g}: mean squared {task.objective} error and slope penalty"]
    starts = "best cells of a lattice" if task.constant else "lattice programme, constant gains, separate optima"
    if outcome.plain:
        notes.append(
            f"{outcome.plain}: from its own starts ipopt found nothing cheaper that meets the scope at every row"
        )
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
    floors = zip(names, task.states.floors, ("N.s/m", "N/m", "N.s/m"), strict=False)
    notes.append("floors, well below which a gain counts as 0: " + ", ".join(f"{n} {f:.3g} {u}" for n, f, u in floors))
    return tuple(notes)
