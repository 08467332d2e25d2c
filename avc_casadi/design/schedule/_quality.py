"""How good a schedule is known to be: a lower bound, and the spread over the starts."""

from __future__ import annotations

import numpy as np

from avc_casadi.design._rows import Gains
from avc_casadi.design.schedule._program import Solution
from avc_casadi.design.schedule._task import Task


def slopes(task: Task, gains: Gains) -> np.ndarray:
    """D sigma/d ln(omega) between neighbouring rows, (d, n - 1)."""
    return np.asarray(np.diff(task.states.states(gains), axis=1) / np.diff(task.log_frequency))


def quality_notes(task: Task, gains: Gains, solution: Solution, starts: tuple[float, ...]) -> tuple[str, ...]:
    """Sentences for people: what is known of optimality, slopes and states."""
    if not solution.success:
        return (f"ipopt stopped with {solution.message}: no schedule",)
    notes = [f"cost {solution.cost:.6g}: mean squared {task.problem.realism.objective} error and slope penalty"]
    if starts:
        spread = max(starts) - min(starts)
        notes.append(
            f"best of {len(starts)} starts (lattice programme, best constant gains, separate optima);"
            f" the costs before refinement spread by {spread:.3g}; not proved to be the global optimum"
        )
    else:
        notes.append("refined from the previous schedule; not proved to be the global optimum")
    if len(task.frequency_hz) > 1 and not np.isnan(gains[0]).any():
        steepest = np.abs(slopes(task, gains)).max(axis=1)
        names = ("b", "k", "b_p")[: len(steepest)]
        notes.append(
            "steepest slopes d ln/d ln(omega): "
            + ", ".join(f"{n} {s:.3g}" for n, s in zip(names, steepest, strict=True))
        )
        floors = ", ".join(f"{n} {f:.3g}" for n, f in zip(names, task.states.floors, strict=True))
        notes.append(f"gains count as 0 well below their floors: {floors}")
    return tuple(notes)
