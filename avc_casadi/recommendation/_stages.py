"""The order in which candidates are judged: the likeliest first, the others only where none is the wall itself."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from avc_casadi.loop import hand_corners
from avc_casadi.recommendation._candidates import (
    SAFER,
    Alternatives,
    RobustCandidates,
    behind_observers,
    plain_candidates,
    softened_to,
    stiffer_rung_n_per_m,
    tuned_candidates,
)
from avc_casadi.recommendation._jury import Jury
from avc_casadi.stability import softest_wall_n_per_m

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from avc_casadi.design.robust import Rung
    from avc_casadi.loop import Hand
    from avc_casadi.problem import Problem
    from avc_casadi.recommendation._choice import Judged
    from avc_casadi.stability import DampingRange
    from avc_casadi.support import Progress

# The way from the stiffest that is held to the next stiffer wall is halved until it is so short, or so often.
_CLOSE, MOST_HALVED = 1.05, 3
# Searches, as they are told.
_PLAIN, _BETWEEN = "springs and dampers", "halfway to the next stiffer wall"
_OBSERVED = "springs and dampers behind an observer"


def judged_candidates(
    problem: Problem,
    people: Hand,
    seed: int,
    limit: DampingRange,
    progress: Progress,
    *,
    lean_on_friction: bool,
    executor: Executor | None = None,
    start: Rung | float | None = None,
    halvings: int = MOST_HALVED,
) -> Candidates:
    """Try the likeliest couplings first, and the others only where none is the wall itself.

    Args:
        problem: device, wall and hands.
        people: who tries them.
        seed: of their draw.
        limit: the stiffest wall that is stable with everybody and let go, with a spring and damper.
        progress: told of the candidates.
        lean_on_friction: as in `best_of`.
        executor: as in `try_coupling`.
        start: as in `RobustCandidates`.
        halvings: of the way to the next stiffer wall, at most.
    """
    wall = problem.environment.stiffness_n_per_m
    # Where springs and dampers hold nothing, laws begin at the softest wall there is.
    limit = replace(limit, stiffness_n_per_m=max(limit.stiffness_n_per_m, softest_wall_n_per_m(problem.device)))
    jury = Jury(problem, people, seed, progress, lean_on_friction=lean_on_friction, executor=executor)
    robust = RobustCandidates(problem, limit, jury.ends, start)
    plainly = min(wall, limit.stiffness_n_per_m)
    corners = hand_corners(problem.hands)
    plain = list(plain_candidates(problem, corners, limit))
    # A wall beyond what spring and damper hold is robust from the start; one that nothing holds is softened until
    # everybody rests quietly, behind a law first: what springs give is mostly softer. Tuned gains come last: what holds
    # spring and damper back holds them back too.
    held_plainly = wall <= limit.stiffness_n_per_m
    if held_plainly:
        _plainly(jury, plain, wall)
    if not jury.holds(wall):
        _climb(jury, robust, robust.ladder_n_per_m, wall)
    for ladder in robust.softer:
        if not jury.holds(min(*ladder, plainly)):
            robust.rungs.clear()
            _climb(jury, robust, ladder, wall)
    if not (held_plainly or jury.holds(limit.stiffness_n_per_m)):
        _plainly(jury, plain, limit.stiffness_n_per_m)
    for share in SAFER:
        if not jury.holds(share * plainly):
            jury.ask(softened_to(problem, corners, share * plainly), "softer springs")
    if not jury.holds(0.0):
        jury.ask(tuned_candidates(problem, progress), "tuned gains")
    if jury.judged:
        _closer(problem, jury, limit, robust, halvings)
        jury.confirm()
    return Candidates(jury.judged, jury.considered, tuple(robust.rungs))


@dataclass(frozen=True)
class Candidates:
    """What was judged.

    Attributes:
        judged: what was tried, and how.
        considered: how many couplings there were.
        rungs: walls for which laws were found.
    """

    judged: list[Judged]
    considered: int
    rungs: tuple[Rung, ...]


def _plainly(jury: Jury, plain: list[Alternatives], stiffness_n_per_m: float) -> None:
    """Try springs and dampers, and behind an observer where for somebody without one it is too soft or not quiet."""
    jury.ask(plain, _PLAIN)
    if not (jury.pleases(stiffness_n_per_m) and jury.holds(stiffness_n_per_m)):
        jury.ask(behind_observers(plain), _OBSERVED)


def _climb(jury: Jury, robust: RobustCandidates, ladder_n_per_m: list[float], wall_n_per_m: float) -> None:
    """Try robust walls from the softest on, until one is too stiff."""
    for place, felt in enumerate(ladder_n_per_m):
        search = f"walls behind an observer, {felt:.4g} N/m"
        found = jury.finds(robust.at(felt), felt, search) and _held(jury, robust, felt, search)
        out_of_turn = place == 0 and felt == wall_n_per_m
        if (found and felt == wall_n_per_m) or not (found or out_of_turn):
            return


def _held(jury: Jury, robust: RobustCandidates, felt: float, search: str) -> bool:
    """Whether a wall is held with people who had no part in the choice; if not, search again with those who move."""
    return jury.holds(felt) or (jury.finds(robust.again(felt), felt, search) and jury.holds(felt))


def _closer(problem: Problem, jury: Jury, limit: DampingRange, robust: RobustCandidates, halvings: int) -> None:
    """Halve the way to the next stiffer wall, a few times; where that leads up to it, try it once more.

    Where it is held then, the law for it was what was missing, and the way to the next one is halved as often.

    So that what is felt hardly depends on where the walls stand that were looked at, and thus on the one wanted.
    """
    corners = hand_corners(problem.hands)
    low = jury.reached_n_per_m()
    high = None if low < 0 else stiffer_rung_n_per_m(problem, limit, robust, low)
    nearer, left = False, halvings
    while left > 0 and high is not None and (nearer or high >= _CLOSE * low):
        left -= 1
        again = nearer and high < _CLOSE**3 * low
        felt = high if again else math.sqrt(low * high)
        jury.ask(softened_to(problem, corners, felt), _BETWEEN)
        held = jury.holds(felt)
        for more in () if held else robust.at(felt):
            held = jury.finds([more], felt, _BETWEEN) and _held(jury, robust, felt, _BETWEEN)
            if held:
                break
        nearer = held and not again
        low = felt if held else low
        if held == again:
            high = stiffer_rung_n_per_m(problem, limit, robust, low) if held else felt
            left = halvings if held else left
