"""Infeasible stages: no gains of the box meet scope and realism; with the place and size of the violation."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi._util.units import N_PER_M, NS_PER_M, spoken_key
from avc_casadi.design.schedule.hands import HandsRadii, admissible_states, hands_slack
from avc_casadi.design.schedule.nlp import solve_program
from avc_casadi.design.schedule.scope import REALISM_BACKOFF, Slots, realism_slack, worst_slack
from avc_casadi.design.schedule.stage import GOAL_ROWS, PENALTY_ROW
from avc_casadi.design.schedule.task import Task
from avc_casadi.paper.realism import bound_magnitudes

_POINTS = {2: (13, 13), 3: (9, 9, 5)}
_ZOOMS = 12
_ROUNDS = 6
_SMOOTHEST = 1e6
"""Slope penalty that makes the slopes as small as the scopes allow."""
_JUDGED = 40
"""Number of gains judged with every hand of the ranges, by stability with the known ones."""
_REAL_POINTS = {2: (40, 40), 3: (18, 18, 8)}
"""Nodes of the first lattice; its halves along each state are searched separately."""
_ZOOM_POINTS = {2: (9, 9), 3: (7, 7, 5)}
_STEPS = 60
_WEIGHT = 1e4
"""Weight of each stage's goal: errors of 1e-6 then still count against the solver's tolerance."""
_NARROWEST = 1e-10
"""Width of the window, as a share of the box, at which a search ends."""
_FIRST = 1e6
"""Weight of a violated scope where realism is compared."""

Slack = tuple[FloatArray, FloatArray]
Value = Callable[[FloatArray, FloatArray], FloatArray]


@dataclass(frozen=True)
class Missing:
    """Stages without admissible gains.

    Attributes:
        rows: mask of the infeasible stages, (n,).
        reasons: a sentence for each stage, or empty.
        tight: feasible stages without the slack that the NLP keeps: their scope has no interior, (n,).
        states: of these gains, (d, n); elsewhere meaningless.
    """

    rows: BoolArray
    reasons: tuple[str, ...]
    tight: BoolArray
    states: FloatArray

    @classmethod
    def none(cls, task: Task) -> Missing:
        """Return the result with every stage feasible."""
        n = len(task.frequency_hz)
        nowhere = np.zeros(n, dtype=bool)
        return cls(nowhere, ("",) * n, nowhere, np.repeat(task.states.low[:, None], n, axis=1))

    def at(self, rows: NDArray[np.intp]) -> Missing:
        """Return a subset of the stages."""
        reasons = tuple(self.reasons[row] for row in rows)
        return Missing(self.rows[rows], reasons, self.tight[rows], self.states[:, rows])


def missing_rows(task: Task) -> Missing:
    """Return the stages at which no gains of the box meet scope and required realism together."""
    missing = _without_scope(task)
    if task.problem.realism.require == "none" or missing.rows.all():
        return missing
    unreal = unrealistic_rows(task, np.flatnonzero(~missing.rows))
    rows, reasons = missing.rows.copy(), list(missing.reasons)
    for row, reason in unreal.items():
        rows[row], reasons[row] = True, reason
    return replace(missing, rows=rows, reasons=tuple(reasons), tight=missing.tight & ~rows)


def _without_scope(task: Task) -> Missing:
    """Return the stages whose scope no gains of the box meet, and those where none meet it with slack.

    The best gains are those with the largest slack at the slots; while they violate the scope elsewhere and may still
    improve, that frequency is added. A grid over the box is refined about its best point, so that the stated violation
    is that of actual gains; a stage with a tiny admissible region may be reported infeasible although it is not.
    """
    n = len(task.frequency_hz)
    needed = task.tolerance * (1.0 if task.hands is not None else task.scale_ns_per_m) * np.ones(n)
    softest = np.repeat(task.states.low[:, None], n, axis=1)
    if (worst_slack(task.problem, task.frequency_hz, task.states.gains(softest)).slack >= needed).all():
        return Missing.none(task)
    slots = Slots.of(task.problem, task.frequency_hz)
    margin = task.problem.stability.margin_ns_per_m
    open_rows, gains = np.ones(n, dtype=bool), np.zeros((len(task.states.floors), n))
    missing = np.zeros(n, dtype=bool)
    for _ in range(_ROUNDS):
        states, slack = _best_states(task, slots, needed)
        gains = np.where(open_rows, states, gains)
        best = task.states.gains(gains)
        worst = worst_slack(task.problem, task.frequency_hz, best)
        missing |= open_rows & (slack < 0)
        open_rows &= ~missing & (worst.slack < needed)
        if not open_rows.any() or len(slots.frequency_hz) == slots.fixed:
            break
        slots.add(task.problem, best, worst, open_rows)
    if not (missing | open_rows).any():
        return Missing.none(task)
    if task.hands is not None:
        gains, missing = _with_hands(task, gains, missing)
    exact = worst_slack(task.problem, task.frequency_hz, task.states.gains(gains))
    open_rows = ~missing & (exact.slack < needed)
    tight = open_rows & exact.met
    missing |= open_rows & ~tight
    rows = zip(*task.states.gains(gains), exact.slack, exact.frequency_hz, missing, strict=True)
    reasons = [_reason(task, margin, *row[:5]) if row[5] else "" for row in rows]
    return Missing(missing, tuple(reasons), tight, gains)


def _with_hands(task: Task, gains: FloatArray, missing: BoolArray) -> tuple[FloatArray, BoolArray]:
    """Search the whole box before reporting that no gains are stable with every hand; states (d, n), missing stages."""
    radii = HandsRadii(task.problem, task.states)
    pool = admissible_states(radii)
    if not pool.shape[1]:
        return gains, np.ones_like(missing)
    safest = pool[:, np.argsort(radii.largest(pool), kind="stable")[:_JUDGED]]
    # The worst hand may be interior, which the radii above do not cover.
    slack = worst_slack(task.problem, np.full(safest.shape[1], task.frequency_hz[0]), task.states.gains(safest)).slack
    safest = safest[:, [slack.argmax()]]
    return np.repeat(safest, len(missing), axis=1), np.zeros_like(missing)


def _reason(task: Task, margin: float, b: float, k: float, p: float, slack: float, frequency_hz: float) -> str:
    scope = task.problem.stability.scope
    at = f"b = {b:.6g} {NS_PER_M}, k = {k:.6g} {N_PER_M}, b_p = {p:.6g} {NS_PER_M}"
    if scope == "hands":
        return (
            f"scope hands cannot be met in the gain box: at best a spectral radius of {1 - slack:.6g}, at {at};"
            " narrow [hands], widen the box of [coupling] or add device damping"
        )
    lower = "lower the margin by that, " if margin >= -slack else ""
    return (
        f"Re Z_h >= {margin:g} {NS_PER_M} ({spoken_key('stability.margin_ns_per_m')}) over scope {scope} cannot be met "
        f"in the gain box: missed by {-slack:.6g} {NS_PER_M} at {frequency_hz:.6g} Hz with the best gains {at}; "
        f"{lower}add as much device damping, widen the box of [coupling], or narrow the scope"
    )


def steep_reason(task: Task, missing: Missing, message: str) -> str:
    """Return why the NLP has no solution though every stage has one: the slope limit, or the solver's message."""
    limit = task.problem.schedule.slope_limit
    if limit is None or len(task.frequency_hz) == 1:
        return (
            f"ipopt stopped with {message}; move [schedule] slope_penalty towards 1e-3 or widen the box of [coupling]"
        )
    slots = Slots.of(task.problem, task.frequency_hz)
    data = replace(
        task.data(slots, task.backoff(missing.rows, missing.tight)), slope_limit=np.inf, slope_penalty=_SMOOTHEST
    )
    solution = solve_program(data, task.objective, (data.low + data.high) / 2, extra=task.hands)
    slopes = np.abs(np.diff(solution.states, axis=1)) / data.step
    steepest = np.unravel_index(int(slopes.argmax()), slopes.shape)
    name = ("b", "k", "b_p")[steepest[0]]
    return (
        f"the slope limit {limit:g} (schedule.slope_limit) cannot be met together with scope"
        f" {task.problem.stability.scope}: the smoothest schedule without it changes {name} by"
        f" {slopes[steepest]:.6g} at {task.frequency_hz[steepest[1]]:.6g} Hz; raise the limit or narrow the scope"
    )


def _best_states(task: Task, slots: Slots, needed: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return states (d, n) with the largest least slack over the slots, and that slack (n,)."""
    low, high = (np.repeat(end[:, None], len(task.frequency_hz), axis=1) for end in (task.states.low, task.states.high))
    best, slack = _best_of_grid(task, slots, low, high)
    width = high - low
    for _ in range(_ZOOMS):
        if (slack >= needed).all():
            break
        width = width / 2
        ends = np.maximum(low, best - width / 2), np.minimum(high, best + width / 2)
        better, gained = _best_of_grid(task, slots, *ends)
        best, slack = np.where(gained > slack, better, best), np.maximum(gained, slack)
    return best, slack


def _best_of_grid(task: Task, slots: Slots, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the same on one grid between low and high, (d, n) each."""
    nodes = low[:, None] + (high - low)[:, None] * _grid(_POINTS[len(low)])[:, :, None]
    if task.hands is not None:
        # The scope does not depend on the frequency: one stage suffices.
        one = hands_slack(task.problem, task.states, nodes[:, :, 0])
        slack = np.repeat(one[:, None], nodes.shape[2], axis=1)
    else:
        gains = task.states.gains(nodes)
        real = np.array([loop.perceived(*gains).real for loop in slots.loops(task.problem)])
        slack = real.min(axis=0) - task.problem.stability.margin_ns_per_m
    chosen = slack.argmax(axis=0)
    at = np.arange(nodes.shape[2])
    return nodes[:, chosen, at], slack[chosen, at]


def unrealistic_rows(task: Task, rows: NDArray[np.intp]) -> dict[int, str]:
    """Return the stages among ``rows`` that cannot meet scope and realism together, each with a sentence.

    The gains of largest minimum slack of the two are sought, then the most realistic ones within the scope; a stage
    where neither search finds admissible gains is reported with the second's. While the gains violate
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
                found[int(open_rows[lost[at]])] = _unreal_reason(few, int(at), nearest)
        gains = part.states.gains(states)
        worst = worst_slack(part.problem, part.frequency_hz, gains)
        violated = (slack >= 0) & ~worst.met
        if not violated.any() or len(own.frequency_hz) == own.fixed:
            return found
        own.add(part.problem, gains, worst, violated)
        open_rows = open_rows[violated]
        slots.frequency_hz[:, open_rows] = own.frequency_hz[:, violated]
    part = task.at(task.frequency_hz[open_rows])
    return found | {int(row): _unreal_reason(part, at, states[:, violated]) for at, row in enumerate(open_rows)}


def _nearest(task: Task, slots: Slots) -> tuple[FloatArray, FloatArray]:
    """Return the most realistic states (d, n) within the scope, and their slack of realism, (n,).

    Along the scope's boundary a lattice search stalls, so that an NLP without the requirement follows.
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
    """Return states (d, m, n) -> slack of scope and of realism, (m, n) each."""
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
    """Return states (d, n) of the largest value, and that value (n,).

    Each half of a lattice along each state gives a start; a window about it moves, and is halved where it stays.

    Args:
        task: the stages.
        slots: frequencies of their scopes.
        value: (slack of the scope, slack of realism) -> value to be maximised.
        enough: whether any value of 0 or more suffices.
    """
    slack, n = _slack(task, slots), len(task.frequency_hz)
    low, high = task.states.low[:, None, None], task.states.high[:, None, None]
    points, stage = _REAL_POINTS[len(low)], np.arange(n)
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
    """Return the nodes of the unit box, (d, m)."""
    axes = np.meshgrid(*(np.linspace(0, 1, count) for count in points), indexing="ij")
    return np.array([axis.ravel() for axis in axes])


def _unreal_reason(task: Task, at: int, states: FloatArray) -> str:
    b, k, p = (float(gain[at]) for gain in task.states.gains(states))
    target = np.asarray(task.loop.target)
    z = task.loop.perceived(*task.states.gains(states))[at]
    realism, stability = task.problem.realism, task.problem.stability
    lower = f"lower {spoken_key('stability.margin_ns_per_m')}, " if stability.margin_ns_per_m > 0 else ""
    narrow = "narrow the scope, " if stability.scope != "pointwise" else ""
    ending = (
        f"with the best gains b = {b:.6g} {NS_PER_M}, k = {k:.6g} {N_PER_M}, b_p = {p:.6g} {NS_PER_M} that meet scope "
        f"{stability.scope}; {lower}{narrow}add device damping, widen the box of [coupling]"
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
        f"|Z_h| between {low:.6g} and {high:.6g} {NS_PER_M} (realism.require, [boundaries]) cannot be met: at best "
        f"{size:.6g} {NS_PER_M}, missed by {max(low - size, size - high):.6g} {NS_PER_M}, {ending} or [boundaries]"
    )
