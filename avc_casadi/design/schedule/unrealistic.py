"""Stages at which no gains of the box meet both the scope and what realism requires: which, and by how much."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from avc_casadi._util.arrays import FloatArray
from avc_casadi.design.schedule.program import solve_program
from avc_casadi.design.schedule.realism import REALISM_BACKOFF, realism_slack
from avc_casadi.design.schedule.scope import Slots, worst_slack
from avc_casadi.design.schedule.stage import GOAL_ROWS, PENALTY_ROW
from avc_casadi.design.schedule.task import Task
from avc_casadi.paper.realism import bound_magnitudes

_POINTS = {2: (40, 40), 3: (18, 18, 8)}
"""Nodes of the first lattice; its halves along each state are searched on their own."""
_ZOOM_POINTS = {2: (9, 9), 3: (7, 7, 5)}
_STEPS = 60
_WEIGHT = 1e4
"""Weight of each stage's goal: errors of 1e-6 then still count against the solver's tolerance."""
_NARROWEST = 1e-10
"""Width of the window, as a share of the box, at which a search ends."""
_ROUNDS = 6
_FIRST = 1e6
"""What a missed scope weighs where realism is compared among gains that meet it."""

Slack = tuple[FloatArray, FloatArray]
Value = Callable[[FloatArray, FloatArray], FloatArray]


def unrealistic_rows(task: Task, rows: NDArray[np.intp]) -> dict[int, str]:
    """Find the stages among ``rows`` that cannot meet scope and realism together, each with a sentence.

    The gains with the largest smaller slack of the two are sought, then those that are most real among those that meet
    the scope; a stage where neither search finds admissible gains is told with the second's. While the gains violate
    the scope between the slots, that frequency is added.
    """
    found: dict[int, str] = {}
    slots = Slots.of(task.problem, task.frequency_hz)
    open_rows = rows
    for _ in range(_ROUNDS):
        part = task.at(task.frequency_hz[open_rows])
        own = Slots(slots.frequency_hz[:, open_rows], slots.fixed)
        states, slack = _searched(part, own, np.minimum, enough=True)
        lost = np.flatnonzero(slack < 0)
        if lost.size:
            few = part.at(part.frequency_hz[lost])
            nearest, real = _nearest(few, Slots(own.frequency_hz[:, lost], own.fixed))
            states[:, lost], slack[lost] = nearest, real
            for at in np.flatnonzero(real < 0):
                found[int(open_rows[lost[at]])] = _reason(few, int(at), nearest)
        gains = part.states.gains(states)
        worst = worst_slack(part.problem, part.frequency_hz, gains)
        violated = (slack >= 0) & ~worst.met
        if not violated.any() or len(own.frequency_hz) == own.fixed:
            return found
        own.add(part.problem, gains, worst, violated)
        open_rows = open_rows[violated]
        slots.frequency_hz[:, open_rows] = own.frequency_hz[:, violated]
    part = task.at(task.frequency_hz[open_rows])
    return found | {int(row): _reason(part, at, states[:, violated]) for at, row in enumerate(open_rows)}


def _nearest(task: Task, slots: Slots) -> tuple[FloatArray, FloatArray]:
    """States (d, n) that are most real among those that meet the scope, and how much more than needed, (n,).

    Along the scope's boundary a lattice comes to rest too early, so that an NLP without the requirement goes on.
    """
    states, most = _searched(task, slots, _scope_first, enough=False)
    nowhere = np.zeros(len(most), dtype=bool)
    data, z = task.data(slots, 1.5 * task.backoff(nowhere, nowhere)), task.loop.perceived
    goal, objective = np.asarray(task.loop.target), "complex"
    if task.problem.realism.require == "bounds":
        low, high = bound_magnitudes(task.problem, task.loop)
        goal, objective = np.where(np.abs(z(*task.states.gains(states))) < low, low, high) + 0j, "magnitude"
    cost = data.cost.copy()
    cost[GOAL_ROWS] = goal.real, goal.imag
    cost[PENALTY_ROW] = 0.0
    least = data.least[: len(slots.frequency_hz)] if task.hands is None else data.least[-1:]
    alone = replace(
        data,
        cost=cost,
        least=least,
        weight=np.full(len(most), _WEIGHT),
        slope_penalty=0.0,
        slope_limit=np.inf,
        constant=False,
        require="none",
    )
    polished = solve_program(alone, objective, states, extra=task.hands).states
    value = _scope_first(*(each[0] for each in _slack(task, slots)(polished[:, None])))
    return np.where(value > most, polished, states), np.maximum(value, most)


def _scope_first(scope: FloatArray, real: FloatArray) -> FloatArray:
    return np.where(scope >= 0, real, _FIRST * scope - _FIRST)


def _slack(task: Task, slots: Slots) -> Callable[[FloatArray], Slack]:
    """States (d, m, n) -> how much more than needed they are inside scope and realism, (m, n) each."""
    loops, margin = slots.loops(task.problem), task.problem.stability.margin_ns_per_m

    def slack(states: FloatArray) -> Slack:
        gains = task.states.gains(states)
        if task.hands is None:
            lowest = np.minimum.reduce([loop.perceived(*gains).real for loop in loops])
            scope = (lowest - margin) / task.scale_ns_per_m
        else:
            scope = task.hands(states.reshape(len(states), -1)).full().reshape(states.shape[1:])
        return scope - task.tolerance, realism_slack(task.problem, task.loop, gains) - REALISM_BACKOFF

    return slack


def _searched(task: Task, slots: Slots, value: Value, *, enough: bool) -> tuple[FloatArray, FloatArray]:
    """States (d, n) of the largest value, and that value (n,).

    Each half of a lattice along each state gives a start; a window about it moves, and is halved where it stays.

    Args:
        task: the stages.
        slots: frequencies of their scopes.
        value: (slack of the scope, slack of realism) -> what is to be large.
        enough: whether any value from 0 on will do.
    """
    slack, n = _slack(task, slots), len(task.frequency_hz)
    low, high = task.states.low[:, None, None], task.states.high[:, None, None]
    points, stage = _POINTS[len(low)], np.arange(n)
    shares = _grid(points)
    nodes = np.broadcast_to(low + (high - low) * shares[:, :, None], (*shares.shape, n))
    first = value(*slack(nodes))
    best, most = np.zeros((len(low), n)), np.full(n, -np.inf)
    window = _grid(_ZOOM_POINTS[len(low)])[:, :, None] - 0.5
    for half in itertools.product((False, True), repeat=len(low)):
        inside = ((shares > 0.5) == np.array(half)[:, None]).all(axis=0)
        chosen = first[inside].argmax(axis=0)
        at, reached = nodes[:, inside][:, chosen, stage], first[inside][chosen, stage]
        share = np.full(n, 4 / points[0])
        for _ in range(_STEPS):
            if (share < _NARROWEST).all() or (enough and (np.maximum(reached, most) >= 0).all()):
                break
            around = np.clip(at[:, None] + share * (high - low) * window, low, high)
            values = value(*slack(around))
            chosen = values.argmax(axis=0)
            better = values[chosen, stage] > reached
            at, reached = np.where(better, around[:, chosen, stage], at), np.maximum(values[chosen, stage], reached)
            share = np.where(better, share, share / 2)
        closer = reached > most
        best, most = np.where(closer, at, best), np.where(closer, reached, most)
    return best, most


def _grid(points: tuple[int, ...]) -> FloatArray:
    """Nodes of the unit box, (d, m)."""
    axes = np.meshgrid(*(np.linspace(0, 1, count) for count in points), indexing="ij")
    return np.array([axis.ravel() for axis in axes])


def _reason(task: Task, at: int, states: FloatArray) -> str:
    b, k, p = (float(gain[at]) for gain in task.states.gains(states))
    target = np.asarray(task.loop.target)
    z = task.loop.perceived(*task.states.gains(states))[at]
    realism, stability = task.problem.realism, task.problem.stability
    lower = "lower stability.margin_ns_per_m, " if stability.margin_ns_per_m > 0 else ""
    narrow = "narrow the scope, " if stability.scope != "pointwise" else ""
    ending = (
        f"with the best gains b = {b:.6g} N.s/m, k = {k:.6g} N/m, b_p = {p:.6g} N.s/m that meet scope"
        f" {stability.scope}; {lower}{narrow}add device damping, widen the box of [coupling]"
    )
    if realism.require == "jnd":
        error = float(abs(z - target[at]) / abs(target[at]))
        return (
            f"|Z_h - Z_h_ds| <= {realism.jnd:g} |Z_h_ds| (realism.require, realism.jnd) cannot be met: at best"
            f" {error:.6g} |Z_h_ds|, missed by {error - realism.jnd:.6g}, {ending} or raise realism.jnd"
        )
    low, high = (float(end[at]) for end in bound_magnitudes(task.problem, task.loop))
    size = float(abs(z))
    return (
        f"|Z_h| between {low:.6g} and {high:.6g} N.s/m (realism.require, [boundaries]) cannot be met: at best"
        f" {size:.6g} N.s/m, missed by {max(low - size, size - high):.6g} N.s/m, {ending} or [boundaries]"
    )
