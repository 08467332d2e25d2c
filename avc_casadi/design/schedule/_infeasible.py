"""Stages whose scope no gains of the box can meet: which, where, and by how much."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from avc_casadi.design._gains import BoolArray, FloatArray
from avc_casadi.design.schedule._hands_table import hands_slack
from avc_casadi.design.schedule._scope import Slots, worst_slack
from avc_casadi.design.schedule._task import Task

_POINTS = {2: (13, 13), 3: (9, 9, 5)}
_ZOOMS = 8


@dataclass(frozen=True)
class Missing:
    """Stages without admissible gains, (n,), and a sentence for each stage, empty where there is nothing to say."""

    rows: BoolArray
    reasons: tuple[str, ...]

    @classmethod
    def none(cls, task: Task) -> Missing:
        """Every stage can be met."""
        n = len(task.frequency_hz)
        return cls(np.zeros(n, dtype=bool), ("",) * n)


def missing_rows(task: Task, slots: Slots) -> Missing:
    """Find the stages at which even the best gains of the box miss the scope at one of its slots."""
    low, high = (np.repeat(end[:, None], len(task.frequency_hz), axis=1) for end in (task.states.low, task.states.high))
    best, slack = _best(task, slots, low, high)
    rows = np.flatnonzero(slack < 0)
    if not rows.size:
        return Missing.none(task)
    width = high - low
    for _ in range(_ZOOMS):
        width = width / 3
        best, slack = _best(task, slots, np.maximum(low, best - width / 2), np.minimum(high, best + width / 2))
    missing = slack < 0
    reasons = [""] * len(missing)
    gains = task.states.gains(best)
    exact = worst_slack(task.problem, task.frequency_hz, gains)
    stability = task.problem.stability
    for row in np.flatnonzero(missing):
        b, k, p = (gain[row] for gain in gains)
        at = f"b = {b:.6g} N.s/m, k = {k:.6g} N/m, b_p = {p:.6g} N.s/m"
        if stability.scope == "hands":
            reasons[row] = (
                f"scope hands cannot be met in the gain box: at best a spectral radius of {1 - exact.slack[row]:.6g}, at {at};"
                " narrow [hands], widen the box of [coupling] or add device damping"
            )
            continue
        reasons[row] = (
            f"Re Z_h >= {stability.margin_ns_per_m:g} N.s/m (stability.margin_ns_per_m) over scope {stability.scope} cannot"
            f" be met in the gain box: missed by {-exact.slack[row]:.6g} N.s/m at {exact.frequency_hz[row]:.6g} Hz with"
            f" the best gains {at}: lower the margin by that, add as much device damping, widen the box of [coupling], or"
            " narrow the scope"
        )
    return Missing(missing, tuple(reasons))


def _best(task: Task, slots: Slots, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
    """States (d, n) with the largest least slack over the slots, on a grid between low and high (d, n), and that slack."""
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
