"""Laws near known ones of a wall, chosen by what a simulation of the whole device says of them.

The goal of a law looks at linear loops. What else keeps a hand moving, the step of the encoder or the force limit, it
does not see; laws near each other differ in it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
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

# How far the first laws lie around, and how many are looked at.
_SPREAD, _EVALUATIONS = 0.3, 300
# So many simulated laws end it if with each of them more than this share of the hands moves.
_HOPELESS = {60: 0.3, 120: 0.1, 200: 0.03}
# The speed that is aimed at, over that at which a hand is no longer at rest; beyond the fastest all are as bad. The
# price of a factor of e between them, of a law's own cost, and of the growth of a loop for each 1/s.
_AIM, _FASTEST = 0.5, 1e3
_PER_UNREST, _PER_COST, _PER_GROWTH = 4.0, 0.02, 10.0
# What no law costs that is simulated: one that lets some loop grow is not.
_NEVER = 1e4
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
        The laws that leave everybody at rest, or the one that leaves the fewest moving; None where too many move, or
        nothing is gained.
    """
    known = [rung.found, *rung.found.others]
    speeds = unrest([one.law for one in known])
    start, before = _best(speeds)
    space, loops = Space(problem.device, problem.hands), Loops.of(problem.device, problem.hands)
    _, rendering = softened(problem, rung.stiffness_n_per_m)
    stiffness, first = stiffness_at_rest(rendering), known[start]
    hardest = loops.hardest(first.law, rendering)
    simulated: list[tuple[int, float, FloatArray]] = []

    def weigh(points: FloatArray) -> FloatArray:
        laws = space.laws(points, stiffness)
        costs = costs_of(laws, rendering, hardest)
        total = np.array([cost.total for cost in costs])
        growth = np.nan_to_num([cost.growth_per_s for cost in costs], posinf=0.0)
        value: FloatArray = _NEVER + np.minimum(total + _PER_GROWTH * growth, _NEVER)
        damped = np.flatnonzero([cost.holds for cost in costs])
        if len(damped) == 0:
            return value
        ends = unrest([space.one_of(laws, row) for row in damped.tolist()])
        paid = np.log(np.clip(np.nan_to_num(ends, nan=_FASTEST), _AIM, _AIM * _FASTEST) / _AIM).sum(axis=1)
        value[damped] = _PER_UNREST * paid + _PER_COST * total[damped]
        moving = (~(ends < 1)).sum(axis=1)
        simulated.extend(zip(moving.tolist(), value[damped].tolist(), points[damped], strict=True))
        return value

    settled = partial(_settled, simulated, speeds.shape[1])
    evolve(weigh, first.logarithms, space.bounds, _SPREAD, _EVALUATIONS, enough=lambda _: settled())
    simulated.sort(key=lambda one: one[:2])
    better = (point for moving, _, point in simulated if moving < max(1, before))
    whole = (found_at(space, loops, rendering, point) for point in better)
    found = list(islice((one for one in whole if one.cost.holds), _MOST))
    return Rung(rung.gains, rung.stiffness_n_per_m, found[0].beside(found[1:])) if found else None


def _best(speeds: FloatArray) -> tuple[int, int]:
    """Return the law that leaves the fewest moving, of these the slowest, and how many."""
    moving = (~(speeds < 1)).sum(axis=1)
    place = min(range(len(speeds)), key=lambda row: (moving[row], float(speeds[row].max())))
    return place, int(moving[place])


def _settled(simulated: list[tuple[int, float, FloatArray]], people: int) -> bool:
    """Whether a few laws leave nobody moving, or after so many too many still move with each."""
    fewest = min((moving for moving, _, _ in simulated), default=people)
    resting = sum(moving == 0 for moving, _, _ in simulated)
    return resting >= _MOST or any(
        len(simulated) >= laws and fewest > share * people for laws, share in _HOPELESS.items()
    )
