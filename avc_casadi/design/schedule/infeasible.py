"""Stages whose scope no gains of the box can meet: which, where, and by how much."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi.design.schedule.hands_radii import HandsRadii, admissible_states
from avc_casadi.design.schedule.hands_table import hands_slack
from avc_casadi.design.schedule.program import solve_program
from avc_casadi.design.schedule.scope import Slots, worst_slack
from avc_casadi.design.schedule.task import Task
from avc_casadi.design.schedule.unrealistic import unrealistic_rows

_POINTS = {2: (13, 13), 3: (9, 9, 5)}
_ZOOMS = 12
_ROUNDS = 6
_SMOOTHEST = 1e6
"""Slope penalty that makes the slopes as small as the scopes allow."""
_JUDGED = 40
"""Gains that are judged with every hand of the ranges, those first that hold the known ones best."""


@dataclass(frozen=True)
class Missing:
    """Stages without admissible gains.

    Attributes:
        rows: which they are, (n,).
        reasons: a sentence for each stage, empty where there is nothing to say.
        tight: stages that gains meet, but none with the room that the NLP keeps: their scope has no interior, (n,).
        states: of these gains, (d, n); elsewhere without meaning.
    """

    rows: BoolArray
    reasons: tuple[str, ...]
    tight: BoolArray
    states: FloatArray

    @classmethod
    def none(cls, task: Task) -> Missing:
        """Every stage can be met."""
        n = len(task.frequency_hz)
        nowhere = np.zeros(n, dtype=bool)
        return cls(nowhere, ("",) * n, nowhere, np.repeat(task.states.low[:, None], n, axis=1))

    def at(self, rows: NDArray[np.intp]) -> Missing:
        """Take some of the stages."""
        reasons = tuple(self.reasons[row] for row in rows)
        return Missing(self.rows[rows], reasons, self.tight[rows], self.states[:, rows])


def missing_rows(task: Task) -> Missing:
    """Find the stages at which no gains of the box meet the scope together with what realism requires."""
    missing = _without_scope(task)
    if task.problem.realism.require == "none" or missing.rows.all():
        return missing
    unreal = unrealistic_rows(task, np.flatnonzero(~missing.rows))
    rows, reasons = missing.rows.copy(), list(missing.reasons)
    for row, reason in unreal.items():
        rows[row], reasons[row] = True, reason
    return replace(missing, rows=rows, reasons=tuple(reasons), tight=missing.tight & ~rows)


def _without_scope(task: Task) -> Missing:
    """Find the stages at which even the best gains of the box miss the scope, and those where none meet it with room.

    The best gains are those with the largest slack at the slots; while they violate the scope elsewhere and could still
    do better, that frequency is added. A grid over the box is refined about its best point, so that the miss stated is
    that of gains that exist; a stage with a tiny admissible region can be called missing although it is not.
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
    """Look all over the box before it is said that no gains hold every hand; states (d, n) and the missing stages."""
    radii = HandsRadii(task.problem, task.states)
    pool = admissible_states(radii)
    if not pool.shape[1]:
        return gains, np.ones_like(missing)
    safest = pool[:, np.argsort(radii.largest(pool), kind="stable")[:_JUDGED]]
    # The worst hand may stand inside the ranges, where the radii above do not look.
    slack = worst_slack(task.problem, np.full(safest.shape[1], task.frequency_hz[0]), task.states.gains(safest)).slack
    safest = safest[:, [slack.argmax()]]
    return np.repeat(safest, len(missing), axis=1), np.zeros_like(missing)


def _reason(task: Task, margin: float, b: float, k: float, p: float, slack: float, frequency_hz: float) -> str:
    scope = task.problem.stability.scope
    at = f"b = {b:.6g} N.s/m, k = {k:.6g} N/m, b_p = {p:.6g} N.s/m"
    if scope == "hands":
        return (
            f"scope hands cannot be met in the gain box: at best a spectral radius of {1 - slack:.6g}, at {at};"
            " narrow [hands], widen the box of [coupling] or add device damping"
        )
    lower = "lower the margin by that, " if margin >= -slack else ""
    return (
        f"Re Z_h >= {margin:g} N.s/m (stability.margin_ns_per_m) over scope {scope} cannot be met in the gain box:"
        f" missed by {-slack:.6g} N.s/m at {frequency_hz:.6g} Hz with the best gains {at}; {lower}add as much device"
        " damping, widen the box of [coupling], or narrow the scope"
    )


def steep_reason(task: Task, missing: Missing, message: str) -> str:
    """Say why the NLP has no solution though every stage alone has one: the slope limit, or the solver's own word."""
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
    """States (d, n) with the largest least slack over the slots, and that slack (n,)."""
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
    """The same on one grid between low and high, (d, n) each."""
    shares = [np.linspace(0, 1, points) for points in _POINTS[len(low)]]
    grid = np.array([axis.ravel() for axis in np.meshgrid(*shares, indexing="ij")])
    nodes = low[:, None] + (high - low)[:, None] * grid[:, :, None]
    if task.hands is not None:
        # The scope does not depend on the frequency: one stage tells all.
        one = hands_slack(task.problem, task.states, nodes[:, :, 0])
        slack = np.repeat(one[:, None], nodes.shape[2], axis=1)
    else:
        gains = task.states.gains(nodes)
        real = np.array([loop.perceived(*gains).real for loop in slots.loops(task.problem)])
        slack = real.min(axis=0) - task.problem.stability.margin_ns_per_m
    chosen = slack.argmax(axis=0)
    at = np.arange(nodes.shape[2])
    return nodes[:, chosen, at], slack[chosen, at]
