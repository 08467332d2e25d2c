"""The order in which candidates are judged: the likeliest first, the others only where none is the wall itself."""

from __future__ import annotations

import math
from itertools import islice
from typing import TYPE_CHECKING

from avc_casadi.design.robust import MOST_SOFTER, SOFTER
from avc_casadi.loop import hand_corners
from avc_casadi.recommendation._candidates import (
    SAFER,
    Alternatives,
    RobustCandidates,
    felt_at_rest_n_per_m,
    plain_candidates,
    softened_to,
    stiffer_rung_n_per_m,
    tuned_candidates,
)
from avc_casadi.recommendation._choice import AS_STIFF, Judged, confirmed, likeliest, tried
from avc_casadi.trial import draw_hands, loose_hands

if TYPE_CHECKING:
    from collections.abc import Iterable
    from concurrent.futures import Executor

    from avc_casadi.loop import Hand, StylusHand
    from avc_casadi.problem import Problem
    from avc_casadi.stability import DampingRange
    from avc_casadi.support import Progress

# The way from the stiffest that is held to the next stiffer wall is halved until it is so short, or so often.
_CLOSE, _MOST_HALVED = 1.03, 3
# Robust walls in a row that are too stiff, beyond which none is looked at: one of them may owe it to its law.
_TOO_STIFF = 3
# Searches, as they are told.
_PLAIN, _BETWEEN = "springs and dampers", "halfway to the next stiffer wall"


def judged_candidates(
    problem: Problem,
    people: Hand | StylusHand,
    seed: int,
    limit: DampingRange,
    progress: Progress,
    *,
    lean_on_friction: bool,
    executor: Executor | None = None,
) -> tuple[list[Judged], int]:
    """Try the likeliest couplings first, and the others only where none is the wall itself; say how many there were."""
    wall = problem.environment.stiffness_n_per_m
    jury = _Jury(problem, people, seed, progress, lean_on_friction=lean_on_friction, executor=executor)
    robust = RobustCandidates(problem, limit, progress)
    plainly = min(wall, limit.stiffness_n_per_m)
    corners = hand_corners(problem.hands)
    plain = plain_candidates(problem, corners, limit)
    # A wall beyond what spring and damper hold is robust from the start; one that nothing holds is softened until
    # everybody rests quietly. Tuned gains come last: what holds spring and damper back holds them back too.
    held_plainly = wall <= limit.stiffness_n_per_m
    first = (islice(robust.stiff, 1), "the wall behind an observer")
    for more, search in ((plain, _PLAIN), first) if held_plainly else (first,):
        if not jury.holds(wall):
            jury.ask(more, search)
    if not jury.holds(wall):
        _climb(jury, robust, wall)
    if not (held_plainly or jury.holds(limit.stiffness_n_per_m)):
        jury.ask(plain, _PLAIN)
    for more, ceiling, search in (
        *((softened_to(problem, corners, share * plainly), 0.0, "softer springs") for share in SAFER),
        *(
            (islice(robust.soft, 1), SOFTER ** (1 + step) * plainly, "softer walls behind an observer")
            for step in range(MOST_SOFTER)
        ),
        (tuned_candidates(problem, progress), 0.0, "tuned gains"),
    ):
        if not jury.holds(ceiling):
            jury.ask(more, search)
    if jury.judged:
        _closer(problem, jury, limit, robust)
        jury.holds(0.0)
    return jury.judged, jury.considered


class _Jury:
    """Who tries the candidates.

    Attributes:
        judged: what was tried, and how.
        considered: how many couplings there were.
    """

    def __init__(
        self,
        problem: Problem,
        people: Hand | StylusHand,
        seed: int,
        progress: Progress,
        *,
        lean_on_friction: bool,
        executor: Executor | None,
    ) -> None:
        self.judged: list[Judged] = []
        self.considered = 0
        self._people, self._seed, self._progress, self._lean = people, seed, progress, lean_on_friction
        self._executor = executor
        self._others = draw_hands(problem.hands, 2 * len(people), seed, "training")
        self._loose = loose_hands(problem.hands, len(people), seed)
        self._candidates: list[Alternatives] = []
        self._search = ""

    def ask(self, more: Iterable[Alternatives], search: str) -> None:
        """Try more candidates, of a search that is told."""
        self._search = search
        for alternatives in more:
            self.considered += len(alternatives)
            self._candidates.append(likeliest(alternatives, self._loose, lean_on_friction=self._lean))
        self._try()

    def reaches(self, stiffness_n_per_m: float) -> bool:
        """Whether something so stiff is safe and quiet, as far as is known."""
        return bool(self.judged) and self.reached_n_per_m() >= (1 - AS_STIFF) * stiffness_n_per_m

    def reached_n_per_m(self) -> float:
        """Return the stiffest that is felt of what is safe and quiet; below 0 where nothing is."""
        enough = [one for one in self.judged if one.complete(lean_on_friction=self._lean)]
        return max((felt_at_rest_n_per_m(one.coupling) for one in enough), default=-1.0)

    def holds(self, stiffness_n_per_m: float) -> bool:
        """Whether something so stiff is safe and quiet, also with people who had no part in the choice."""
        while self.reaches(stiffness_n_per_m):
            before = self.judged
            self.judged = confirmed(
                before,
                self._people,
                self._others,
                self._seed,
                lean_on_friction=self._lean,
                executor=self._executor,
            )
            if self.judged is before:
                return True
            self._try()
        return False

    def _try(self) -> None:
        judged = tried(
            self._candidates,
            self.judged,
            self._people,
            self._seed,
            self._progress,
            lean_on_friction=self._lean,
            executor=self._executor,
            search=self._search,
        )
        if len(judged) > len(self.judged):
            self.judged = judged


def _climb(jury: _Jury, robust: RobustCandidates, wall_n_per_m: float) -> None:
    """Try the robust walls from the softest on, until a few in a row are too stiff."""
    too_stiff = 0
    for alternatives in robust.stiff:
        jury.ask([alternatives], "walls of rising stiffness behind an observer")
        if jury.reaches(wall_n_per_m):
            return
        too_stiff = 0 if jury.reaches(felt_at_rest_n_per_m(alternatives[0])) else too_stiff + 1
        if too_stiff == _TOO_STIFF:
            return


def _closer(problem: Problem, jury: _Jury, limit: DampingRange, robust: RobustCandidates) -> None:
    """Look afresh for laws of the next stiffer wall, then halve the way to it, a few times.

    So that what is felt hardly depends on where the walls stand that were looked at, and thus on the one wanted.
    """
    corners = hand_corners(problem.hands)
    low = jury.reached_n_per_m()
    high = None if low < 0 else stiffer_rung_n_per_m(problem, limit, robust, low)
    if high is not None and robust.walls_n_per_m:
        jury.ask(robust.afresh(high), "the next stiffer wall afresh")
        if jury.holds(high):
            low, high = high, stiffer_rung_n_per_m(problem, limit, robust, high)
    for _ in range(_MOST_HALVED if high is not None else 0):
        if (high or low) < _CLOSE * low:
            break
        middle = math.sqrt(low * (high or low))
        jury.ask(softened_to(problem, corners, middle), _BETWEEN)
        held = jury.holds(middle)
        for more in () if held else robust.at(middle):
            jury.ask([more], _BETWEEN)
            held = jury.holds(middle)
            if held:
                break
        low, high = (middle, high) if held else (low, middle)
