"""The search for a law: a descent by slopes over its numbers, from a few starts, the same every time."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.claims.stability.state_feedback import stiffness_at_rest
from avc_casadi.design.robust.descent import Descended, as_cheap, descend
from avc_casadi.design.robust.goal import Cost, cost_of
from avc_casadi.design.robust.pieces import pieces_of

if TYPE_CHECKING:
    from avc_casadi.claims.stability.frozen_loop import Rendering
    from avc_casadi.design.robust.law import Space
    from avc_casadi.design.robust.loops import Loops
    from avc_casadi.model.runtime import StateFeedback

# A search that lost sight of the loops that are hardest for what it found, so that it costs so many times as much,
# goes on with them, so often at most.
_MISLED, _MOST_MISLED = 1.1, 4
# It goes on from there in such a trust region.
_AGAIN = 0.1
# Other laws that are kept: those whose cost is no more than so many times the least and that differ by so much in some
# logarithm from each other.
_AS_CHEAP, _APART, _MOST_OTHERS = 1.15, 0.15, 9


@dataclass(frozen=True)
class Found:
    """A law, where it stands in the search space, and what it costs.

    Attributes:
        law: observer and feedback.
        logarithms: its numbers.
        cost: what it costs.
        others: laws that cost hardly more. The goal tells little of the last hand in a hundred: where one law loses
            it, another may not.
    """

    law: StateFeedback
    logarithms: FloatArray
    cost: Cost
    others: tuple[Found, ...] = ()

    def beside(self, others: Iterable[Found]) -> Found:
        """Return it with others."""
        return replace(self, others=tuple(others))


def search(
    space: Space,
    loops: Loops,
    rendering: Rendering,
    start: FloatArray | None = None,
) -> Found:
    """Find the cheapest law for a rendering.

    Nothing says that what it finds is the best there is: a descent ends in the valley in which it begins.

    Args:
        space: what is searched.
        loops: what the law must hold.
        rendering: coupling and wall behind it.
        start: logarithms of a near law; None begins at each of the usual starts.

    Raises:
        numpy.linalg.LinAlgError: the start has no law.
    """
    starts = space.starts if start is None else (start,)
    each = [_searched(space, loops, rendering, begin) for begin in starts]
    laws = (law for one in each for law in (one, *one.others))
    first, *others = sorted(laws, key=lambda law: (not law.cost.holds, law.cost.total))
    return first.beside(one for one in others if one.cost.holds)


def _searched(space: Space, loops: Loops, rendering: Rendering, begin: FloatArray) -> Found:
    """Search from one start on."""
    found = found_at(space, loops, rendering, begin)
    hardest, region = loops.hardest(found.law, rendering), None
    for again in range(_MOST_MISLED + 1):
        ended = _descended(space, hardest, rendering, found.logarithms, region)
        if ended is None:
            return found
        found = found_at(space, loops, rendering, ended.point)
        if found.cost.holds or found.cost.total < _MISLED * ended.cost or again == _MOST_MISLED:
            points = _apart(ended, as_cheap(ended, space.bounds, _AS_CHEAP))
            others = (found_at(space, loops, rendering, point) for point in points)
            return found.beside(one for one in others if one.cost.holds)
        # The loops that are hardest for this law were not among those that were for the first.
        hardest, region = hardest.and_of(loops.hardest(found.law, rendering)), _AGAIN
    return found


def _descended(
    space: Space, loops: Loops, rendering: Rendering, begin: FloatArray, region: float | None
) -> Descended | None:
    usual = {} if region is None else {"region": region}
    return descend(partial(pieces_of, space, loops, rendering), begin, space.bounds, **usual)


def found_at(space: Space, loops: Loops, rendering: Rendering, logarithms: FloatArray) -> Found:
    """Weigh the law of one point before all loops; arguments as for `search`.

    Raises:
        numpy.linalg.LinAlgError: the point has no law.
    """
    law = space.law(logarithms, stiffness_at_rest(rendering))
    return Found(law, logarithms, cost_of(law, rendering, loops))


def _apart(ended: Descended, more: Iterable[FloatArray]) -> list[FloatArray]:
    """Take points that cost hardly more than the last, none next to it or to one that was taken."""
    on_the_way = (point for cost, point in reversed(ended.seen) if cost <= _AS_CHEAP * ended.cost)
    taken = [ended.point]
    for point in (*more, *on_the_way):
        if len(taken) <= _MOST_OTHERS and all(float(np.abs(point - other).max()) > _APART for other in taken):
            taken.append(point)
    return taken[1:]
