"""Where the NLP starts: the lattice programme, the best constant gains and the separate optima, smoothed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.design.schedule.hands_table import TABLE_POINTS
from avc_casadi.design.schedule.infeasible import Missing
from avc_casadi.design.schedule.lattice import lattice_path
from avc_casadi.design.schedule.program import Solution, solve_program
from avc_casadi.design.schedule.scope import Slots, worst_slack
from avc_casadi.design.schedule.task import Task
from avc_casadi.paper.exact import exact_gains

_SMOOTHING = 0.1
"""Width in ln(omega) over which the separate optima are averaged: they jump, and the NLP would follow each jump."""
_STAGES = 200
"""Stages on which the starts of a schedule of more than twice as many are compared."""


@dataclass(frozen=True)
class Found:
    """What the starts led to.

    Attributes:
        solutions: of the NLP, the cheapest that converged first.
        slots: the frequencies that they bounded.
        costs: of those that converged.
        path: states along the best path of the lattice, (d, n).
        lattice: what that path costs.
    """

    solutions: tuple[Solution, ...]
    slots: Slots
    costs: tuple[float, ...]
    path: FloatArray
    lattice: float


def from_starts(task: Task, missing: Missing, progress: Progress = SILENT) -> Found:
    """Solve from each start, and long schedules on some of their stages first.

    Frequencies at which a start has its worst Re Z_h are bounded from the beginning.
    """
    n = len(task.frequency_hz)
    if n <= 2 * _STAGES:
        return _over_all_stages(task, missing, progress)
    some = np.unique(np.linspace(0, n - 1, _STAGES).round().astype(int))
    few = task.at(task.frequency_hz[some])
    found = _over_all_stages(few, missing.at(some), progress)
    x, y = task.log_frequency, few.log_frequency
    start = np.array([np.interp(x, y, state) for state in found.solutions[0].states])
    slots = _seeded(task, missing, [start])
    data = task.data(slots, task.backoff(missing.rows, missing.tight))
    best = solve_program(data, task.objective, start, extra=task.hands)
    path = np.array([np.interp(x, y, state) for state in found.path])
    return Found((best,), slots, found.costs, path, task.cost_of(data, path))


def _over_all_stages(task: Task, missing: Missing, progress: Progress) -> Found:
    backoff = task.backoff(missing.rows, missing.tight)
    data = task.data(Slots.of(task.problem, task.frequency_hz, spread=True), backoff)
    lattice = lattice_path(
        task.lattice_costs(data),
        (task.states.low, task.states.high),
        task.log_frequency,
        data.slope_penalty,
        data.slope_limit,
        # On the nodes of the table, where it is exact.
        None if task.hands is None else TABLE_POINTS[len(task.states.low)],
    )
    constants = [np.repeat(state[:, None], len(task.frequency_hz), axis=1) for state in lattice.constant.T]
    starts = constants if task.constant else [lattice.path, constants[0], _smoothed_optima(task)]
    slots = _seeded(task, missing, starts[:2])
    data = task.data(slots, backoff)
    solutions: list[Solution] = []
    for start in starts:
        progress.advance(len(solutions), len(starts), "starts")
        solutions.append(solve_program(data, task.objective, start, extra=task.hands, patient=False))
    progress.advance(len(starts), len(starts), "starts")
    if not any(solution.success for solution in solutions):
        solutions = [solve_program(data, task.objective, start, extra=task.hands) for start in starts[:2]]
    ranked = sorted(solutions, key=lambda solution: (not solution.success, solution.cost))
    path = starts[0]
    costs = tuple(solution.cost for solution in ranked if solution.success)
    return Found(tuple(ranked), slots, costs, path, task.cost_of(data, path))


def _seeded(task: Task, missing: Missing, starts: list[FloatArray]) -> Slots:
    slots = Slots.of(task.problem, task.frequency_hz)
    for start in starts:
        gains = task.states.gains(start)
        slots.add(task.problem, gains, worst_slack(task.problem, task.frequency_hz, gains), ~missing.rows)
    return slots


def _smoothed_optima(task: Task) -> FloatArray:
    """States (d, n) of the separate optima, averaged over neighbouring frequencies where anything joins them."""
    gains = exact_gains(task.problem, task.loop)
    known = np.isfinite(gains[0])
    x = task.log_frequency
    if not known.any():
        return np.repeat((task.states.low + task.states.high)[:, None] / 2, len(x), axis=1)
    filled = [np.interp(x, x[known], gain[known]) for gain in gains]
    states = task.states.states((filled[0], filled[1], filled[2]))
    settings = task.problem.schedule
    if len(x) == 1 or (settings.slope_penalty == 0 and settings.slope_limit is None):
        return states
    # Gaussian weights, but only over the rows that are near enough to matter.
    reach = np.searchsorted(x, x + 3 * _SMOOTHING) - np.searchsorted(x, x - 3 * _SMOOTHING)
    half = int(reach.max()) // 2 + 1
    total, weight = np.zeros_like(states), np.zeros(len(x))
    for shift in range(-half, half + 1):
        own = np.arange(max(0, -shift), min(len(x), len(x) - shift))
        share = np.exp(-0.5 * ((x[own + shift] - x[own]) / _SMOOTHING) ** 2)
        total[:, own] += share * states[:, own + shift]
        weight[own] += share
    return np.asarray(total / weight)
