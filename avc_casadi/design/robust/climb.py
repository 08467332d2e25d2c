"""Laws for walls that rise while they are searched: as soon as everybody who is simulated rests with one, it is raised.

The goal of a law looks at linear loops. What else keeps a hand moving, the step of the encoder or the force limit, it
does not see; laws near each other differ in it. So the laws whose loops are all damped are simulated, and how fast the
hands end leads the search from wall to wall.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.claims.stability.state_feedback import stiffness_at_rest
from avc_casadi.design.robust.evolve import evolution
from avc_casadi.design.robust.goal import costs_of
from avc_casadi.design.robust.ladder import Rung, softened
from avc_casadi.design.robust.law import Space
from avc_casadi.design.robust.loops import Loops
from avc_casadi.design.robust.search import Found, found_at

if TYPE_CHECKING:
    from avc_casadi.claims.stability.state_feedback import Laws
    from avc_casadi.design.robust.goal import Cost
    from avc_casadi.model.gains import Gains
    from avc_casadi.model.problem import Problem
    from avc_casadi.model.runtime import StateFeedback

Unrest = Callable[[Sequence["StateFeedback"]], FloatArray]
"""Laws to the speed with which each hand ends, over that at which it is no longer at rest, shape (laws, hands)."""
EndsAt = Callable[["Gains", "StateFeedback"], Unrest]
"""What asks that for a wall behind its spring, and laws of the structure of one."""

CLOSE = 1.04
"""The next wall of a climb is no nearer than that."""
MOST_SOFTER = 12
"""How often a softer wall is tried where none is held yet."""
# How far the first laws lie around the start, in logarithms, and, the widest way, those before a wall at least.
_SPREAD, _LEAST_SPREAD, _WIDER = 0.3, 0.08, 1.5
# The next wall over one that is held: at first, and at most where that took no longer than so many generations.
_RISE, _MOST_RISE, _AT_ONCE = 1.3, 1.4, 2
# What makes the rise larger.
_FASTER = 1.5
# A wall is given up after so many generations; where none is held yet one is tried that is so much softer.
_PATIENCE, _SOFTER = 12, 1.4
# The speed that is aimed at, over that at which a hand is no longer at rest; beyond the fastest all are as bad. The
# price of a factor of e between them, of a law's own cost, and of what loops lack of their decay for each 1/s.
_AIM, _FASTEST = 0.5, 1e3
_PER_UNREST, _PER_COST, _PER_DECAY = 4.0, 0.02, 10.0
# What no law costs that is simulated: one whose loops lack some of their decay is not.
_NEVER = 1e4
_MOST_LAWS = 3


def climb(
    problem: Problem,
    start: FloatArray,
    walls_n_per_m: tuple[float, float],
    ends_at: EndsAt,
    *,
    seed: int = 0,
    rise: float = _RISE,
    close: float = CLOSE,
    softer: int = MOST_SOFTER,
) -> list[Rung]:
    """Search laws for stiffer and stiffer walls.

    Args:
        problem: device with what is known of it, hands and wall.
        start: logarithms of the knobs from which to begin.
        walls_n_per_m: stiffness at rest of the first wall, and of the last.
        ends_at: how fast hands end, who must all rest.
        seed: of the draw of laws.
        rise: the second wall over the first.
        close: a wall that is not held ends the climb if it is no more than so many times the last that is.
        softer: how often a softer wall is tried where none is held yet.

    Returns:
        The walls that are held, the softest first, with laws whose loops are all damped.

    Raises:
        numpy.linalg.LinAlgError: the start has no law.
    """
    first, last = walls_n_per_m
    search = _Search(problem, start, ends_at, np.random.default_rng(seed))
    held: list[Rung] = []
    wall, point, lowered = first, start, 0
    while True:
        rung, took = search.held(point, wall)
        if rung is not None:
            held.append(rung)
            if wall >= last:
                return held
            point = rung.found.logarithms
            rise = min(_MOST_RISE, rise**_FASTER) if took <= _AT_ONCE else rise
            wall = min(last, wall * rise)
        elif held:
            reached = held[-1].stiffness_n_per_m
            if wall < close * reached:
                return held
            rise = math.sqrt(wall / reached)
            wall = reached * rise
        elif lowered < softer:
            lowered, wall = lowered + 1, wall / _SOFTER
        else:
            return held


class _Search:
    """The search for laws with which everybody rests, wall by wall; arguments as for `climb`.

    It is one evolution: what it learned before one wall, held or not, is worth as much before the next.
    """

    def __init__(self, problem: Problem, start: FloatArray, ends_at: EndsAt, draw: np.random.Generator) -> None:
        self._problem, self._ends_at = problem, ends_at
        self._space, self._loops = Space(problem.device, problem.hands), Loops.of(problem.device, problem.hands)
        self._evolution = evolution(start, self._space.bounds, _SPREAD, draw)

    def held(self, point: FloatArray, stiffness_n_per_m: float) -> tuple[Rung | None, int]:
        """Search laws for one wall, a given one among the first; return how many generations it took.

        Args:
            point: logarithms of the knobs of that one.
            stiffness_n_per_m: of the wall at rest.
        """
        space, loops = self._space, self._loops
        gains, rendering = softened(self._problem, stiffness_n_per_m)
        stiffness = stiffness_at_rest(rendering)
        law = space.law(point, stiffness)
        hardest, unrest = loops.hardest(law, rendering), self._ends_at(gains, law)
        search = self._evolution
        for done in range(1, _PATIENCE + 1):
            if search.stds.max() < _LEAST_SPREAD:
                search.sigma *= _WIDER
            points = search.ask()
            if done == 1:
                points[0] = np.clip(point, *space.bounds)
            laws = space.laws(np.array(points), stiffness)
            value, rest = _weighed(space, laws, costs_of(laws, rendering, hardest), unrest)
            found: list[Found] = []
            for row in rest:
                with suppress(np.linalg.LinAlgError):
                    found.append(found_at(space, loops, rendering, np.asarray(points[row])))
            search.tell(points, value.tolist())
            whole = sorted((one for one in found if one.cost.holds), key=lambda one: one.cost.total)[:_MOST_LAWS]
            if whole:
                return Rung(gains, stiffness_n_per_m, whole[0].beside(whole[1:])), done
            # The loops that are hardest for these were not among those that were for the first.
            for one in found:
                hardest = hardest.and_of(loops.hardest(one.law, rendering))
        return None, _PATIENCE


def _weighed(space: Space, laws: Laws, costs: list[Cost], unrest: Unrest) -> tuple[FloatArray, list[int]]:
    """Return what laws are worth, the less the better, and with which of them everybody rests."""
    total = np.array([cost.total for cost in costs])
    lacks = np.nan_to_num([cost.lacks_per_s for cost in costs], posinf=0.0)
    value: FloatArray = _NEVER + np.minimum(total + _PER_DECAY * lacks, _NEVER)
    damped = np.flatnonzero([cost.holds for cost in costs])
    if len(damped) == 0:
        return value, []
    ends = unrest([space.one_of(laws, row) for row in damped.tolist()])
    paid = np.log(np.clip(np.nan_to_num(ends, nan=_FASTEST), _AIM, _AIM * _FASTEST) / _AIM).sum(axis=1)
    value[damped] = _PER_UNREST * paid + _PER_COST * total[damped]
    return value, damped[(ends < 1).all(axis=1)].tolist()
