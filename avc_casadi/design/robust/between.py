"""A law between two for the same wall: one that gives way least, and one with which all rest who are asked."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.claims.stability.state_feedback import stiffness_at_rest
from avc_casadi.design.robust.ladder import softened
from avc_casadi.design.robust.law import Space
from avc_casadi.design.robust.loops import Loops
from avc_casadi.design.robust.search import Found, found_at

if TYPE_CHECKING:
    from avc_casadi.design.robust.climb import EndsAt
    from avc_casadi.model.problem import Problem

# How many laws are looked at, evenly spaced, and at what share of the speed that is asked of the last all must end: the
# nearest is near to where somebody moves, and only some are asked.
_BETWEEN, _CLEARLY = 9, 0.5


def between(problem: Problem, stiffness_n_per_m: float, first: Found, last: Found, ends_at: EndsAt) -> Found | None:
    """Return the law nearest to the first with damped loops and with which everybody clearly rests, if there is one.

    Laws are looked at on the line between the two, whose numbers are logarithms; nothing says that none is nearer.

    Args:
        problem: device with what is known of it, hands and wall.
        stiffness_n_per_m: of the wall at rest.
        first: a law with which somebody moves.
        last: a law with which everybody rests.
        ends_at: how fast hands end, who must all rest.
    """
    space, loops = Space(problem.device, problem.hands), Loops.of(problem.device, problem.hands)
    gains, rendering = softened(problem, stiffness_n_per_m)
    shares = np.linspace(0.0, 1.0, _BETWEEN + 2)[1:-1]
    points = [first.logarithms + share * (last.logarithms - first.logarithms) for share in shares.tolist()]
    with suppress(np.linalg.LinAlgError):
        laws = space.laws(np.array(points), stiffness_at_rest(rendering))
        each = [space.one_of(laws, row) for row in range(_BETWEEN)]
        rest = (ends_at(gains, each[0])(each) < _CLEARLY).all(axis=1)
        for row in np.flatnonzero(rest).tolist():
            found = found_at(space, loops, rendering, points[row])
            if found.cost.holds:
                return found
    return None
