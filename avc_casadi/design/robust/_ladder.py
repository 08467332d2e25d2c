"""From a wall that a plain spring and damper hold up to the wall that is wanted, as far as a law is found for it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi.coupling import Gains, spring_before
from avc_casadi.design.robust._goal import cost_of
from avc_casadi.design.robust._law import Space
from avc_casadi.design.robust._loops import Loops
from avc_casadi.design.robust._search import QUICKLY, Found, search
from avc_casadi.loop import hand_corners, with_let_go
from avc_casadi.stability import (
    MAX_DELAY_SAMPLES,
    DampingRange,
    Rendering,
    frozen_rendering,
    stiffest_wall,
    stiffness_at_rest,
)
from avc_casadi.support import SILENT, Progress

if TYPE_CHECKING:
    from avc_casadi.problem import Problem

# The first wall as a share of what spring and damper hold.
_FIRST = 0.9
NEXT = 1.4
"""The next wall of the ladder over the one before."""
# The wanted wall is tried at once if it is no more than so many times what spring and damper hold.
_AT_ONCE = 4.0
_MOST_RUNGS = 8
# Of so many near walls the laws are tried as they are.
_NEIGHBOURS = 2
# From the softest of these down, where it is not enough.
SOFTER = 0.6
MOST_SOFTER = 4
"""Walls that are tried below the softest of the ladder."""
# The stiffest wall is climbed to, from below or from that of a like device: so much at a time, so many times. A wall
# that is out of reach, over what spring and damper hold.
_STEP, _MOST_STEPS, _FAR = 1.4, 16, 1e3


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


def robust_ladder(problem: Problem, progress: Progress = SILENT, limit: DampingRange | None = None) -> Iterator[Rung]:
    """Yield walls with laws whose loops are all damped: the wanted one, then others of rising stiffness.

    The wanted one comes first, if it is not far beyond what spring and damper hold; whom its law suits need not ask
    for more. Each law of the others is searched for from that of the wall before. A wall beyond what the device can
    give gets a spring before it, so that both together are what is felt. The walls do not depend on the one that is
    wanted, but for the last, whose laws are those of the walls below and above or begin there.

    Args:
        problem: device with what is known of it, hands and wall.
        progress: told of the walls.
        limit: `stiffest_wall` of the device with these hands and let go; None works it out.

    Raises:
        UnsupportedError: no mass, no stiffness to be felt, or too long a delay.
    """
    _check(problem)
    wanted = problem.environment.stiffness_n_per_m
    device, hands = problem.device, problem.hands
    plain = _plain_n_per_m(problem, limit)
    space, loops = Space(device, hands), Loops.of(device, hands)
    if wanted <= _AT_ONCE * plain:
        progress.advance(0, 1, f"search of a law for the wall, {wanted:.4g} N/m")
        at_once = _searched(problem, space, loops, wanted)
        if at_once is not None:
            yield at_once
        if wanted <= _FIRST * plain:
            return
    below: Rung | None = None
    for rung in range(_MOST_RUNGS):
        stiffness = _FIRST * plain * NEXT**rung
        progress.advance(rung, rung + 2, f"walls of rising stiffness, search of a law for {stiffness:.4g} N/m")
        found = _searched(problem, space, loops, stiffness, below)
        if stiffness >= wanted:
            known = [one for one in (below, found) if one is not None]
            if known:
                yield from robust_at(problem, wanted, known)
            return
        if found is None:
            return
        yield found
        below = found


def robust_afresh(problem: Problem, stiffness_n_per_m: float) -> Iterator[Rung]:
    """Yield the laws that a search finds for one wall from its usual start; none where it does not damp all loops.

    Args:
        problem: as for `robust_ladder`.
        stiffness_n_per_m: that is felt at rest, the wanted wall's at most.
    """
    space, loops = Space(problem.device, problem.hands), Loops.of(problem.device, problem.hands)
    found = _searched(problem, space, loops, stiffness_n_per_m)
    if found is not None:
        yield found


def robust_at(problem: Problem, stiffness_n_per_m: float, known: Sequence[Rung]) -> Iterator[Rung]:
    """Yield laws for one wall: those of the nearest two as they are, then what a search finds from there.

    Args:
        problem: as for `robust_ladder`.
        stiffness_n_per_m: that is felt at rest, the wanted wall's at most.
        known: walls and their laws; nothing begins without any.
    """
    space, loops = Space(problem.device, problem.hands), Loops.of(problem.device, problem.hands)
    near = sorted(known, key=lambda rung: abs(math.log(rung.stiffness_n_per_m / stiffness_n_per_m)))[:_NEIGHBOURS]
    if not near:
        return
    laws = [one for rung in near for one in (rung.found, *rung.found.others)]
    tried = [_as_it_is(problem, space, loops, stiffness_n_per_m, law) for law in laws]
    same = [one for one in tried if one is not None]
    if same:
        yield replace(same[0], found=replace(same[0].found, others=tuple(one.found for one in same[1:])))
    start = min(same or near, key=lambda rung: rung.found.cost.total)
    searched = _searched(problem, space, loops, stiffness_n_per_m, start)
    if searched is not None:
        yield searched


def softer_robust(
    problem: Problem, near: Rung | None, progress: Progress = SILENT, limit: DampingRange | None = None
) -> Iterator[Rung]:
    """Yield walls of falling stiffness with laws whose loops are all damped.

    A wall that is softer leaves more for the vibration at rest and for the hands that a law for a stiffer one loses.

    Args:
        problem: as for `robust_ladder`.
        near: the softest wall of the ladder, from which to go down; None where it found none.
        progress: told of the walls.
        limit: as for `robust_ladder`.

    Raises:
        UnsupportedError: as `robust_ladder`.
    """
    _check(problem)
    space, loops = Space(problem.device, problem.hands), Loops.of(problem.device, problem.hands)
    stiffness = min(_FIRST * _plain_n_per_m(problem, limit), problem.environment.stiffness_n_per_m)
    if near is not None:
        stiffness = near.stiffness_n_per_m
    for done in range(MOST_SOFTER):
        stiffness *= SOFTER
        progress.advance(done, MOST_SOFTER, f"softer walls, search of a law for {stiffness:.4g} N/m")
        found = _searched(problem, space, loops, stiffness, near)
        if found is not None:
            near = found
            yield found


def stiffest_robust(problem: Problem, near: Rung | None = None, progress: Progress = SILENT) -> Rung | None:
    """Find the stiffest wall for which a law is found, whatever the wall of the problem.

    Args:
        problem: device with what is known of it, and hands.
        near: the stiffest of a like device, from which to go up or down; None climbs from what spring and damper hold.
        progress: told of the walls.

    Raises:
        UnsupportedError: as `robust_ladder`.
    """
    plain = _plain_n_per_m(problem)
    stated = problem.changed(environment={"stiffness_n_per_m": _FAR * plain, "damping_ns_per_m": 0.0})
    _check(stated)
    space, loops = Space(stated.device, stated.hands), Loops.of(stated.device, stated.hands)
    stiffness = _FIRST * plain
    if near is not None:
        stiffness = near.stiffness_n_per_m
        near = near if len(space.knobs) == len(near.found.logarithms) else None
    best: Rung | None = None
    for done in range(_MOST_STEPS):
        progress.advance(done, done + 2, f"stiffest wall, search of a law for {stiffness:.4g} N/m")
        found = _at_any_price(stated, space, loops, stiffness, near)
        if found is None and best is not None:
            break
        best = found
        near = near if found is None else found
        stiffness = stiffness / _STEP if found is None else stiffness * _STEP
    return best


def _at_any_price(
    problem: Problem, space: Space, loops: Loops, stiffness_n_per_m: float, near: Rung | None
) -> Rung | None:
    """Find a law for a wall: the near one as it is, or one that is like it, or any."""
    if near is not None:
        found = _as_it_is(problem, space, loops, stiffness_n_per_m, near.found) or _searched(
            problem, space, loops, stiffness_n_per_m, near, QUICKLY
        )
        if found is not None:
            return found
    return _searched(problem, space, loops, stiffness_n_per_m)


def _plain_n_per_m(problem: Problem, limit: DampingRange | None = None) -> float:
    if limit is None:
        limit = stiffest_wall(problem.device, with_let_go(hand_corners(problem.hands)))
    return float(limit.stiffness_n_per_m)


def _as_it_is(problem: Problem, space: Space, loops: Loops, stiffness_n_per_m: float, other: Found) -> Rung | None:
    """Take the numbers of one wall for another."""
    gains, rendering = _softened(problem, stiffness_n_per_m)
    with suppress(np.linalg.LinAlgError):
        law = space.law(other.logarithms, stiffness_at_rest(rendering))
        cost = cost_of(law, rendering, loops)
        if cost.holds:
            return Rung(gains, stiffness_n_per_m, Found(law, other.logarithms, cost))
    return None


def _searched(
    problem: Problem,
    space: Space,
    loops: Loops,
    stiffness_n_per_m: float,
    near: Rung | None = None,
    effort: tuple[float, int] | None = None,
) -> Rung | None:
    """Search for the law of a wall, which may be stiffer than the wanted one, from that of another."""
    wall = max(stiffness_n_per_m, problem.environment.stiffness_n_per_m)
    gains, rendering = _softened(problem.changed(environment={"stiffness_n_per_m": wall}), stiffness_n_per_m)
    with suppress(np.linalg.LinAlgError):
        found = search(space, loops, rendering, None if near is None else near.found.logarithms, effort)
        if found.cost.holds:
            return Rung(gains, stiffness_n_per_m, found)
    return None


def _softened(problem: Problem, stiffness_n_per_m: float) -> tuple[Gains, Rendering]:
    """Return the spring with which the wall feels so stiff, and both as they are rendered."""
    gains = Gains(0.0, spring_before(problem.environment.stiffness_n_per_m, stiffness_n_per_m))
    return gains, frozen_rendering(problem, 0.0, gains.stiffness_n_per_m)


def _check(problem: Problem) -> None:
    device = problem.device
    faults = []
    if not problem.environment.stiffness_n_per_m > 0:
        faults.append("the wall has no stiffness to be felt (environment.stiffness_n_per_m)")
    if not device.mass_kg > 0:
        faults.append("the device has no mass (device.mass_kg), so that nothing is there when it is let go")
    if device.delay_samples > MAX_DELAY_SAMPLES / 4:
        faults.append(f"the delay of {device.delay_samples:g} samples is above {MAX_DELAY_SAMPLES // 4}")
    if faults:
        raise UnsupportedError(f"{problem.name}: robust: {'; '.join(faults)}; take another method, such as static")
