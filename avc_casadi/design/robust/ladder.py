"""From a wall that a plain spring and damper hold up to the wall that is wanted, as far as a law is found for it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi.claims.stability.frozen_loop import MAX_DELAY_SAMPLES, Rendering, frozen_rendering
from avc_casadi.claims.stability.state_feedback import stiffness_at_rest
from avc_casadi.claims.stability.stiffest_wall import DampingRange, softest_wall_n_per_m, stiffest_wall
from avc_casadi.design.robust.goal import costs_of
from avc_casadi.design.robust.law import Space
from avc_casadi.design.robust.loops import Loops
from avc_casadi.design.robust.search import Found, found_at, search
from avc_casadi.model.gains import Gains, spring_before
from avc_casadi.model.hands import hand_corners, with_let_go

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem

# The first wall as a share of what spring and damper hold.
_FIRST = 0.9
# The next wall of a ladder over the one before, and how many there are.
_NEXT, _MOST_RUNGS = 1.4, 8
# The wanted wall is tried at once if it is no more than so many times what spring and damper hold.
_AT_ONCE = 4.0
# Of so many near walls the laws are tried as they are, no more than so many before all loops.
_NEIGHBOURS, _MOST_AS_THEY_ARE = 3, 12


@dataclass(frozen=True)
class Rung:
    """A wall that is felt, and the law for it.

    Attributes:
        gains: the spring before the wall, rigid where the wall itself is felt.
        stiffness_n_per_m: felt at rest.
        found: observer and feedback.
    """

    gains: Gains
    stiffness_n_per_m: float
    found: Found


def ladder_n_per_m(problem: Problem, limit: DampingRange | None = None) -> list[float]:
    """Return the walls for which to look for a law, in this order.

    The wanted one comes first, if it is not far beyond what spring and damper hold; whom its law suits need not ask
    for more. Then come walls of rising stiffness, which do not depend on it, and it again, the last, where they lead up
    to it.

    Args:
        problem: device with what is known of it, hands and wall.
        limit: `stiffest_wall` of the device with these hands and let go; None works it out.

    Raises:
        UnsupportedError: no mass, no stiffness to be felt, or too long a delay.
    """
    why = why_no_law(problem)
    if why:
        raise UnsupportedError(f"{problem.name}: robust: {why}; take another method, such as static")
    wanted, plain = problem.environment.stiffness_n_per_m, _plain_n_per_m(problem, limit)
    if wanted <= _FIRST * plain:
        return [wanted]
    rising = [_FIRST * plain * _NEXT**rung for rung in range(_MOST_RUNGS)]
    at_once = [wanted] if wanted <= _AT_ONCE * plain else []
    return [*at_once, *(wall for wall in rising if wall < wanted), *([wanted] if wanted <= _NEXT * rising[-1] else [])]


def robust_at(problem: Problem, stiffness_n_per_m: float, known: Sequence[Rung] = ()) -> Iterator[Rung]:
    """Yield laws for one wall whose loops are all damped: those of the nearest as they are, then what a search finds.

    A wall beyond what the device can give gets a spring before it, so that both together are what is felt. The search
    begins with the cheapest of the former; where there is none, with the nearest; from afar where nothing is known.

    Args:
        problem: as for `ladder_n_per_m`.
        stiffness_n_per_m: that is felt at rest, the wanted wall's at most.
        known: walls and their laws.
    """
    space, loops = Space(problem.device, problem.hands), Loops.of(problem.device, problem.hands)
    # What was found for the wall itself before was not enough: the same search would find the same.
    others = [rung for rung in known if rung.stiffness_n_per_m != stiffness_n_per_m]
    near = sorted(others, key=lambda rung: abs(math.log(rung.stiffness_n_per_m / stiffness_n_per_m)))[:_NEIGHBOURS]
    laws = {one.logarithms.tobytes(): one for rung in near for one in (rung.found, *rung.found.others)}
    same = _as_they_are(problem, space, loops, stiffness_n_per_m, list(laws.values()))
    if same:
        yield replace(same[0], found=same[0].found.beside(one.found for one in same[1:]))
    start = next(iter(same or near), None)
    searched = _searched(problem, space, loops, stiffness_n_per_m, start)
    if searched is not None:
        yield searched


def _plain_n_per_m(problem: Problem, limit: DampingRange | None = None) -> float:
    if limit is None:
        limit = stiffest_wall(problem.device, with_let_go(hand_corners(problem.hands)))
    return max(float(limit.stiffness_n_per_m), softest_wall_n_per_m(problem.device))


def _as_they_are(
    problem: Problem, space: Space, loops: Loops, stiffness_n_per_m: float, others: Sequence[Found]
) -> list[Rung]:
    """Take the numbers of other walls for one; return those whose loops are all damped, the cheapest first."""
    if not others:
        return []
    gains, rendering = softened(problem, stiffness_n_per_m)
    stiffness = stiffness_at_rest(rendering)
    hardest = loops.hardest(others[0].law, rendering)
    costs = costs_of(space.laws(np.array([one.logarithms for one in others]), stiffness), rendering, hardest)
    likely = sorted((cost.total, place) for place, cost in enumerate(costs) if cost.holds)[:_MOST_AS_THEY_ARE]
    found = []
    for _, place in likely:
        with suppress(np.linalg.LinAlgError):
            one = found_at(space, loops, rendering, others[place].logarithms)
            found += [Rung(gains, stiffness_n_per_m, one)] if one.cost.holds else []
    return sorted(found, key=lambda rung: rung.found.cost.total)


def _searched(
    problem: Problem,
    space: Space,
    loops: Loops,
    stiffness_n_per_m: float,
    near: Rung | None = None,
) -> Rung | None:
    """Search for the law of a wall from that of another."""
    gains, rendering = softened(problem, stiffness_n_per_m)
    with suppress(np.linalg.LinAlgError):
        found = search(space, loops, rendering, None if near is None else near.found.logarithms)
        if found.cost.holds:
            return Rung(gains, stiffness_n_per_m, found)
    return None


def softened(problem: Problem, stiffness_n_per_m: float) -> tuple[Gains, Rendering]:
    """Return the spring with which the wall feels so stiff, and both as they are rendered."""
    gains = Gains(0.0, spring_before(problem, stiffness_n_per_m))
    return gains, frozen_rendering(problem, 0.0, gains.stiffness_n_per_m)


def why_no_law(problem: Problem) -> str:
    """Say why a device before a wall has no law; empty where it may have one."""
    device = problem.device
    faults = []
    if not problem.environment.stiffness_n_per_m > 0:
        faults.append("the wall has no stiffness to be felt (environment.stiffness_n_per_m)")
    if not device.mass_kg > 0:
        faults.append("the device has no mass (device.mass_kg), so that nothing is there when it is let go")
    if device.delay_samples > MAX_DELAY_SAMPLES / 4:
        faults.append(f"the delay of {device.delay_samples:g} samples is above {MAX_DELAY_SAMPLES // 4}")
    return "; ".join(faults)
