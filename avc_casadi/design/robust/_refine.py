"""Laws near one with which nearly everybody rests, chosen by what a simulation of the whole device says of them.

The goal of a law looks at linear loops. What keeps the last hand in a hundred moving, the step of the encoder for one,
it does not see; laws next to each other differ in it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.design.robust._goal import costs_of
from avc_casadi.design.robust._ladder import Rung, softened
from avc_casadi.design.robust._law import Space
from avc_casadi.design.robust._loops import Loops
from avc_casadi.design.robust._search import evolve, found_at
from avc_casadi.stability import stiffness_at_rest
from avc_casadi.support import FloatArray

if TYPE_CHECKING:
    from avc_casadi.problem import Problem
    from avc_casadi.runtime import StateFeedback

# How far the first laws lie around, and how many are simulated.
_SPREAD, _EVALUATIONS = 0.1, 40
# The share of the hands that may move with the law from which to start.
_HOPELESS = 0.15
# The speed that is aimed at, over that at which a hand is no longer at rest; the price of a factor of e above it.
_AIM, _PER_UNREST = 0.5, 4.0
# Cost of a law over that of the one before, up to which it is simulated, and from which on it is paid for.
_DEAREST, _FREE = 1.5, 1.15
_MOST = 3

# Laws to the speed with which each hand ends, over that at which it is no longer at rest, shape (laws, hands).
Unrest = Callable[[Sequence["StateFeedback"]], FloatArray]


def refined(problem: Problem, rung: Rung, unrest: Unrest) -> Rung | None:
    """Find laws near those of a wall with which everybody comes to rest who is simulated.

    Args:
        problem: as for `ladder_n_per_m`.
        rung: a wall and its laws.
        unrest: how fast each hand ends with each of some laws, over the speed at which it is no longer at rest.

    Returns:
        The laws that leave everybody at rest, or the one that leaves the fewest moving; None where too many move with
        all laws of the wall, or nothing is gained.
    """
    known = [rung.found, *rung.found.others]
    speeds = unrest([one.law for one in known])
    start, before = _best(speeds)
    if before > _HOPELESS * speeds.shape[1]:
        return None
    space, loops = Space(problem.device, problem.hands), Loops.of(problem.device, problem.hands)
    _, rendering = softened(problem, rung.stiffness_n_per_m)
    stiffness, first = stiffness_at_rest(rendering), known[start]
    hardest = loops.hardest(first.law, rendering)
    resting: list[tuple[int, float, FloatArray]] = []

    def weigh(points: FloatArray) -> FloatArray:
        costs = costs_of(space.laws(points, stiffness), rendering, hardest)
        total = np.array([cost.total for cost in costs])
        value: FloatArray = np.minimum(total, 1e4) + 1e3
        worth = np.flatnonzero([cost.holds and cost.total < _DEAREST * first.cost.total for cost in costs])
        if len(worth) == 0:
            return value
        ends = unrest([space.law(points[row], stiffness) for row in worth])
        paid = _PER_UNREST * np.log(np.maximum(ends / _AIM, 1.0)).sum(axis=1)
        value[worth] = paid + np.maximum(0.0, total[worth] - _FREE * first.cost.total)
        moving = (~(ends < 1)).sum(axis=1)
        resting.extend(zip(moving.tolist(), value[worth].tolist(), points[worth], strict=True))
        return value

    evolve(weigh, first.logarithms, space.bounds, _SPREAD, _EVALUATIONS, enough=lambda: _settled(resting))
    resting.sort(key=lambda one: one[:2])
    better = (point for moving, _, point in resting if moving < max(1, before))
    whole = (found_at(space, loops, rendering, point) for point in better)
    found = list(islice((one for one in whole if one.cost.holds), _MOST))
    return Rung(rung.gains, rung.stiffness_n_per_m, found[0].beside(found[1:])) if found else None


def _best(speeds: FloatArray) -> tuple[int, int]:
    """Return the law that leaves the fewest moving, of these the slowest, and how many."""
    moving = (~(speeds < 1)).sum(axis=1)
    place = min(range(len(speeds)), key=lambda row: (moving[row], float(speeds[row].max())))
    return place, int(moving[place])


def _settled(resting: list[tuple[int, float, FloatArray]]) -> bool:
    """Whether a few laws leave nobody moving."""
    return sum(moving == 0 for moving, _, _ in resting) >= _MOST
