"""Schedules that need no NLP: the best path of the lattice and constant gains, each row checked exactly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi.design.schedule.coarse_to_fine import Outcome, refined
from avc_casadi.design.schedule.hands import HandsRadii, admissible_states
from avc_casadi.design.schedule.infeasible import Missing
from avc_casadi.design.schedule.initial_guess import Found, lattice_nodes
from avc_casadi.design.schedule.nlp import Data, Solution, solve_program
from avc_casadi.design.schedule.scope import realism_slack, worst_slack
from avc_casadi.design.schedule.task import Task

_MISSED = 1e6
_TRIED = 40
"""Constant gains that are checked exactly, the cheapest first."""
_SLOPE_ROUNDING = 1e-9
_FROM_LATTICE = "the best path of a lattice"
_REACH = 0.05
"""How far from a path it is improved at a time, as a share of the box."""
_ROUNDS, _ENOUGH = 12, 1e-3


def from_lattice(task: Task, missing: Missing, found: Found) -> Outcome | None:
    """Take the best path of the lattice, if every row meets scope and realism and its slopes keep their limit."""
    data = task.data(found.slots, task.backoff(missing.rows, missing.tight))
    path = found.path
    if len(data.step) and path.shape[1] > 1:
        steepest = np.abs(np.diff(path, axis=1) / data.step).max()
        if steepest > data.slope_limit * (1 + _SLOPE_ROUNDING):
            return None
    best = _outcome(task, missing, found, path, _FROM_LATTICE)
    return best and _improved_nearby(task, best)


def _improved_nearby(task: Task, best: Outcome) -> Outcome:
    reach = (task.states.high - task.states.low) * _REACH
    for _ in range(_ROUNDS):
        better = _better_nearby(task, best, reach)
        if better is None:
            reach = reach / 4
        elif better.solution.cost < best.solution.cost * (1 - _ENOUGH):
            best = better
        else:
            return better
    return best


def _better_nearby(task: Task, best: Outcome, reach: FloatArray) -> Outcome | None:
    """Solve the NLP with states no farther than ``reach`` (d,) from the best, from where it cannot lose its way."""
    states, ends = best.solution.states, (task.states.low[:, None], task.states.high[:, None])
    low, high = (np.clip(states + side * reach[:, None], *ends) for side in (-1, 1))
    near = replace(task, near=(low, high))
    data = near.data(best.slots, near.backoff(best.missing.rows, best.missing.tight))
    solution = solve_program(data, near.objective, states, extra=near.hands, patient=False)
    if not solution.success:
        return None
    outcome = refined(near, solution, best.slots, best.missing, best.costs, solved=True)
    if outcome is None or outcome.solution.cost >= best.solution.cost:
        return None
    return replace(outcome, plain=f"{_FROM_LATTICE}, improved about it")


def from_constants(task: Task, missing: Missing, found: Found) -> Outcome | None:
    """Take the best constant gains that meet scope and realism at every row: of a lattice, then improved from there."""
    data = task.data(found.slots, task.backoff(missing.rows, missing.tight))
    nodes = _candidates(task)
    cost = np.zeros(nodes.shape[1])
    at_stage = task.lattice_costs(data, _MISSED)(nodes)
    for stage in np.flatnonzero(~missing.rows):
        cost += data.weight[stage] * at_stage(int(stage))
    cheapest = nodes[:, np.argsort(cost, kind="stable")[:_TRIED]]
    for each in np.concatenate((cheapest, missing.states[:, missing.tight]), axis=1).T:
        states = np.repeat(each[:, None], len(task.frequency_hz), axis=1)
        plain = _outcome(task, missing, found, states, "constant gains")
        if plain is not None:
            better = _improved(replace(task, constant=True), missing, plain, data)
            return plain if better is None or better.solution.cost > plain.solution.cost else better
    return None


def _candidates(task: Task) -> FloatArray:
    """States (d, m) among which constant gains are looked for."""
    if task.hands is not None:
        return admissible_states(HandsRadii(task.problem, task.states))
    return lattice_nodes(task.states.low, task.states.high)[1]


def _improved(task: Task, missing: Missing, plain: Outcome, data: Data) -> Outcome | None:
    start = replace(data, constant=True)
    solution = solve_program(start, task.objective, plain.solution.states, extra=task.hands)
    outcome = refined(task, solution, plain.slots, missing, plain.costs, solved=True) if solution.success else None
    return None if outcome is None else replace(outcome, plain=plain.plain)


def _outcome(task: Task, missing: Missing, found: Found, states: FloatArray, plain: str) -> Outcome | None:
    gains = task.states.gains(states)
    if not (_met(task, states) | missing.rows).all():
        return None
    data = task.data(found.slots, task.backoff(missing.rows, missing.tight))
    solution = Solution(states, task.cost_of(data, states), True, plain, 0, (0.0, 0.0))
    return Outcome(solution, found.slots, gains, missing, found.costs, plain)


def _met(task: Task, states: FloatArray) -> BoolArray:
    gains = task.states.gains(states)
    real = realism_slack(task.problem, task.loop, gains) >= 0
    return np.asarray(worst_slack(task.problem, task.frequency_hz, gains).met & real)
