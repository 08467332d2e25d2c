"""Gains for a scope without interior: it is met, but with nothing to spare, and a solver finds no way in."""

from __future__ import annotations

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.design.schedule.infeasible import Missing
from avc_casadi.design.schedule.initial_guess import lattice_nodes
from avc_casadi.design.schedule.scope import realism_slack, worst_slack
from avc_casadi.design.schedule.task import Task
from avc_casadi.paper.rows import GainArrays

_JUDGED = 800
"""Gains of a lattice that are judged exactly at a frequency, those of least error."""


def best_without_room(task: Task, missing: Missing, best: GainArrays) -> GainArrays:
    """Where a scope has no interior, which no solver enters, the best gains of a lattice, unless better ones are known.

    The lattice is judged exactly, the gains of least error first, and after it those that are known to meet the scope.
    """
    rows = np.flatnonzero(missing.tight)
    if not rows.size:
        return best
    nodes = lattice_nodes(task.states.low, task.states.high)[1]
    if task.problem.stability.scope == "all":
        # The same gains meet it at every frequency.
        somewhere = np.full(nodes.shape[1], task.frequency_hz[0])
        nodes = nodes[:, worst_slack(task.problem, somewhere, task.states.gains(nodes)).met]
    for row in rows:
        part = task.at(task.frequency_hz[row : row + 1])
        nearest = np.argsort(_error(part, task.states.gains(nodes)), kind="stable")[:_JUDGED]
        gains = task.states.gains(np.concatenate((nodes[:, nearest], missing.states[:, [row]]), axis=1))
        met = worst_slack(task.problem, np.repeat(part.frequency_hz, len(gains[0])), gains).met
        b, k, p = (gain[:, None] for gain in gains)
        met &= realism_slack(task.problem, part.loop, (b, k, p))[:, 0] >= 0
        if met.any():
            error = np.where(met, _error(part, gains), np.inf)
            known = _error(part, tuple(gain[row : row + 1] for gain in best))[0]
            if not known <= error.min():
                for gain, new in zip(best, gains, strict=True):
                    gain[row] = new[error.argmin()]
    return best


def _error(task: Task, gains: tuple[FloatArray, ...]) -> FloatArray:
    """Magnitude errors of gains (m,) at the only frequency of a task, (m,)."""
    radius = np.abs(task.loop.target)
    return np.asarray(np.abs(np.abs(task.loop.perceived(*gains)) / radius - 1))
