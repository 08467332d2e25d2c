"""From a wall that a plain spring and damper hold up to the wall that is wanted, as far as a law is found for it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi.coupling import Gains, spring_before
from avc_casadi.design.robust._goal import cost_of
from avc_casadi.design.robust._law import Space
from avc_casadi.design.robust._loops import Loops
from avc_casadi.design.robust._search import Found, search
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
    from avc_casadi.support import FloatArray

# The first wall as a share of what spring and damper hold, the next over the one before, and what lies between two, for
# which the law of the lower one is taken as it is.
_FIRST, _NEXT, _BETWEEN = 0.9, 1.4, 1.18
# The wanted wall is tried at once if it is no more than so many times what spring and damper hold.
_AT_ONCE = 4.0
_MOST_RUNGS = 8
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
    wanted, but for the last.

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
        progress.advance(0, 1, f"the wall, {wanted:.4g} N/m")
        with suppress(np.linalg.LinAlgError):
            gains, rendering = _softened(problem, wanted)
            found = search(space, loops, rendering)
            if found.cost.holds:
                yield Rung(gains, wanted, found)
        if wanted <= _FIRST * plain:
            return
    start = None
    stiffness = min(_FIRST * plain, wanted)
    for rung in range(_MOST_RUNGS):
        gains, rendering = _softened(problem, stiffness)
        progress.advance(rung, rung + 2, f"walls, {stiffness:.4g} N/m")
        try:
            found = search(space, loops, rendering, start)
        except np.linalg.LinAlgError:
            return
        if not found.cost.holds:
            return
        yield Rung(gains, stiffness, found)
        if stiffness == wanted:
            return
        start = found.logarithms
        if stiffness * _BETWEEN < wanted:
            between = _as_it_is(problem, space, loops, found.logarithms, stiffness * _BETWEEN)
            if between is not None:
                yield between
        stiffness = min(stiffness * _NEXT, wanted)


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
    start = None if near is None else near.found.logarithms
    stiffness = min(_FIRST * _plain_n_per_m(problem, limit), problem.environment.stiffness_n_per_m)
    if near is not None:
        stiffness = near.stiffness_n_per_m
    for done in range(MOST_SOFTER):
        stiffness *= SOFTER
        progress.advance(done, MOST_SOFTER, f"softer walls, {stiffness:.4g} N/m")
        gains, rendering = _softened(problem, stiffness)
        with suppress(np.linalg.LinAlgError):
            found = search(space, loops, rendering, start)
            if found.cost.holds:
                start = found.logarithms
                yield Rung(gains, stiffness, found)


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
    stiffness, start = _FIRST * plain, None
    if near is not None:
        same = len(space.knobs) == len(near.found.logarithms)
        stiffness, start = near.stiffness_n_per_m, near.found.logarithms if same else None
    best: Rung | None = None
    for done in range(_MOST_STEPS):
        progress.advance(done, done + 2, f"walls, {stiffness:.4g} N/m")
        found = _at_any_price(stated, space, loops, stiffness, start)
        if found is None and best is not None:
            break
        best = found
        start = start if found is None else found.found.logarithms
        stiffness = stiffness / _STEP if found is None else stiffness * _STEP
    return best


def _at_any_price(
    problem: Problem, space: Space, loops: Loops, stiffness_n_per_m: float, start: FloatArray | None
) -> Rung | None:
    """Find a law for a wall: the near one as it is, or one that is like it, or any."""
    if start is not None:
        with suppress(np.linalg.LinAlgError):
            same = _as_it_is(problem, space, loops, start, stiffness_n_per_m)
            if same is not None:
                return same
    gains, rendering = _softened(problem, stiffness_n_per_m)
    for begin in (None,) if start is None else (start, None):
        with suppress(np.linalg.LinAlgError):
            found = search(space, loops, rendering, begin)
            if found.cost.holds:
                return Rung(gains, stiffness_n_per_m, found)
    return None


def _plain_n_per_m(problem: Problem, limit: DampingRange | None = None) -> float:
    if limit is None:
        limit = stiffest_wall(problem.device, with_let_go(hand_corners(problem.hands)))
    return float(limit.stiffness_n_per_m)


def _as_it_is(
    problem: Problem, space: Space, loops: Loops, logarithms: FloatArray, stiffness_n_per_m: float
) -> Rung | None:
    """Take the numbers of one wall for another."""
    gains, rendering = _softened(problem, stiffness_n_per_m)
    law = space.law(logarithms, stiffness_at_rest(rendering))
    cost = cost_of(law, rendering, loops)
    return Rung(gains, stiffness_n_per_m, Found(law, logarithms, cost)) if cost.holds else None


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
