"""The order in which candidates are judged: the likeliest first, the others only where none is the wall itself."""

from __future__ import annotations

import math
from itertools import islice
from typing import TYPE_CHECKING

from avc_casadi.design.robust import MOST_SOFTER, SOFTER
from avc_casadi.loop import hand_corners
from avc_casadi.recommendation._candidates import (
    SAFER,
    RobustCandidates,
    felt_at_rest_n_per_m,
    plain_candidates,
    softened_to,
    stiffer_rung_n_per_m,
    tuned_candidates,
)
from avc_casadi.recommendation._choice import AS_STIFF, Judged, best_of, confirmed, tried
from avc_casadi.trial import draw_hands

if TYPE_CHECKING:
    from avc_casadi.loop import Hand, StylusHand
    from avc_casadi.problem import Problem
    from avc_casadi.stability import DampingRange
    from avc_casadi.support import Progress

# Times that the way between two softened walls is halved.
_HALVED = 3


def judged_candidates(
    problem: Problem,
    people: Hand | StylusHand,
    seed: int,
    limit: DampingRange,
    progress: Progress,
    *,
    lean_on_friction: bool,
) -> tuple[list[Judged], int]:
    """Try the likeliest couplings first, and the others only where none is the wall itself."""
    wall = problem.environment.stiffness_n_per_m
    others = draw_hands(problem.hands, 2 * len(people), seed, "training")
    robust = RobustCandidates(problem, limit, progress)
    judged: list[Judged] = []
    considered = 0
    plainly = min(wall, limit.stiffness_n_per_m)
    corners = hand_corners(problem.hands)
    plain = (plain_candidates(problem, corners, limit), wall)
    first = (islice(robust.stiff, 1), wall)
    # A wall beyond what spring and damper hold is robust from the start; one that nothing holds is softened until
    # everybody rests quietly. Tuned gains come last: what holds spring and damper back holds them back too.
    for more, ceiling in (
        *((plain, first) if wall <= limit.stiffness_n_per_m else (first, plain)),
        (robust.stiff, wall),
        *((softened_to(problem, corners, share * plainly), 0.0) for share in SAFER),
        *((islice(robust.soft, 1), SOFTER ** (1 + step) * plainly) for step in range(MOST_SOFTER)),
        (tuned_candidates(problem, progress), 0.0),
    ):
        if _reached(judged, lean_on_friction=lean_on_friction) >= (1 - AS_STIFF) * ceiling:
            judged = confirmed(judged, people, others, seed, lean_on_friction=lean_on_friction)
            if _reached(judged, lean_on_friction=lean_on_friction) >= (1 - AS_STIFF) * ceiling:
                continue
        every = list(more)
        considered += len(every)
        judged = tried(every, judged, people, seed, progress, lean_on_friction=lean_on_friction)
    if judged:
        judged, more = _closer(problem, judged, people, seed, limit, lean_on_friction=lean_on_friction)
        considered += more
        judged = confirmed(judged, people, others, seed, lean_on_friction=lean_on_friction)
    return judged, considered


def _reached(judged: list[Judged], *, lean_on_friction: bool) -> float:
    """Return the stiffest that is felt of what is safe and quiet; below 0 where nothing is."""
    enough = [one for one in judged if one.complete(lean_on_friction=lean_on_friction)]
    return max((felt_at_rest_n_per_m(one.coupling) for one in enough), default=-1.0)


def _closer(
    problem: Problem,
    judged: list[Judged],
    people: Hand | StylusHand,
    seed: int,
    limit: DampingRange,
    *,
    lean_on_friction: bool,
) -> tuple[list[Judged], int]:
    """Halve the way from a softened wall to the next stiffer one, a few times; say how many more were considered."""
    best = best_of(judged, lean_on_friction=lean_on_friction).coupling
    low, high = felt_at_rest_n_per_m(best), stiffer_rung_n_per_m(problem, limit, best)
    considered = 0
    for _ in range(_HALVED if high is not None else 0):
        middle = math.sqrt(low * (high or low))
        every = list(softened_to(problem, hand_corners(problem.hands), middle))
        considered += len(every)
        judged = tried(every, judged, people, seed, lean_on_friction=lean_on_friction)
        found = felt_at_rest_n_per_m(best_of(judged, lean_on_friction=lean_on_friction).coupling)
        low, high = (middle, high) if found >= (1 - AS_STIFF) * middle else (low, middle)
    return judged, considered
