"""The order in which candidates are judged: the likeliest first, the others only where none is the wall itself."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.loop import Hand, hand_corners
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
from avc_casadi.recommendation._choice import AS_STIFF, FIRST, Judged, confirmed, likeliest, tried
from avc_casadi.trial import draw_hands, ends_of, loose_hands

if TYPE_CHECKING:
    from collections.abc import Iterable
    from concurrent.futures import Executor

    from avc_casadi.coupling import Coupling
    from avc_casadi.design.robust import Rung
    from avc_casadi.problem import Problem
    from avc_casadi.stability import DampingRange
    from avc_casadi.support import Progress
    from avc_casadi.trial import Ends

# The way from the stiffest that is held to the next stiffer wall is halved until it is so short, or so often.
_CLOSE, MOST_HALVED = 1.03, 4
# Robust walls in a row that are too stiff, beyond which none is looked at: one of them may owe it to its law.
_TOO_STIFF = 2
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
    known: Rung | None = None,
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
        known: a wall and its law with which to begin; None begins where spring and damper end.
        halvings: of the way to the next stiffer wall, at most.
    """
    wall = problem.environment.stiffness_n_per_m
    jury = _Jury(problem, people, seed, progress, lean_on_friction=lean_on_friction, executor=executor)
    robust = RobustCandidates(problem, limit, jury.ends, known)
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


class _Jury:
    """Who tries the candidates.

    Attributes:
        judged: what was tried, and how.
        considered: how many couplings there were.
    """

    def __init__(
        self,
        problem: Problem,
        people: Hand,
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
        self._groups = (people.pick(slice(FIRST)), loose_hands(problem.hands, len(people), seed))
        self._candidates: list[Alternatives] = []
        self._search = ""

    def ask(self, more: Iterable[Alternatives], search: str) -> bool:
        """Try more candidates, of a search that is told; say whether all who try first come to rest with the last."""
        self._search, everybody = search, False
        for alternatives in more:
            self.considered += len(alternatives)
            likely, everybody = likeliest(alternatives, self._groups, lean_on_friction=self._lean)
            self._candidates.append(likely)
        self._try()
        return everybody

    def ends(self, coupling: Coupling) -> Ends:
        """Prepare to ask how fast those end who try a coupling first."""
        both = (np.append(*(getattr(group, name) for group in self._groups)) for name in vars(self._groups[0]))
        return ends_of(coupling, Hand(*both), friction=self._lean)

    def finds(self, more: Iterable[Alternatives], stiffness_n_per_m: float, search: str) -> bool:
        """Try more candidates until something so stiff is safe and quiet, as far as is known; say whether there is."""
        for alternatives in more:
            if self.ask([alternatives], search) and self.reaches(stiffness_n_per_m):
                return True
        return self.reaches(stiffness_n_per_m)

    def reaches(self, stiffness_n_per_m: float) -> bool:
        """Whether something so stiff is safe and quiet, as far as is known."""
        return bool(self.judged) and self.reached_n_per_m() >= (1 - AS_STIFF) * stiffness_n_per_m

    def pleases(self, stiffness_n_per_m: float) -> bool:
        """Whether with something so stiff everybody rests quietly."""
        enough = (1 - AS_STIFF) * stiffness_n_per_m
        return any(
            one.complete(lean_on_friction=self._lean) and one.felt_n_per_m >= enough and bool(one.trial.quiet.all())
            for one in self.judged
        )

    def reached_n_per_m(self) -> float:
        """Return the stiffest that is felt of what is safe and quiet; below 0 where nothing is."""
        enough = [one for one in self.judged if one.complete(lean_on_friction=self._lean)]
        return max((one.felt_n_per_m for one in enough), default=-1.0)

    def holds(self, stiffness_n_per_m: float) -> bool:
        """Whether something so stiff is safe and quiet, also with people who had no part in the choice."""
        while self.reaches(stiffness_n_per_m):
            if not self.confirm():
                return True
            self._try()
        return False

    def confirm(self) -> bool:
        """Let others try what is best, safe and quiet or not; say whether anything new was seen."""
        before = self.judged
        self.judged = confirmed(
            before, self._people, self._others, self._seed, lean_on_friction=self._lean, executor=self._executor
        )
        return self.judged is not before

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


def _plainly(jury: _Jury, plain: list[Alternatives], stiffness_n_per_m: float) -> None:
    """Try springs and dampers, and behind an observer where for somebody without one it is too soft or not quiet."""
    jury.ask(plain, _PLAIN)
    if not (jury.pleases(stiffness_n_per_m) and jury.holds(stiffness_n_per_m)):
        jury.ask(behind_observers(plain), _OBSERVED)


def _climb(jury: _Jury, robust: RobustCandidates, ladder_n_per_m: list[float], wall_n_per_m: float) -> None:
    """Try robust walls from the softest on, until a few in a row are too stiff."""
    too_stiff = 0
    for place, felt in enumerate(ladder_n_per_m):
        found = jury.finds(robust.at(felt), felt, f"walls behind an observer, {felt:.4g} N/m")
        if found and felt == wall_n_per_m and jury.holds(felt):
            return
        # The wanted wall comes first, out of turn.
        too_stiff = 0 if found else too_stiff + (place > 0 or felt != wall_n_per_m)
        if too_stiff == _TOO_STIFF:
            return


def _closer(problem: Problem, jury: _Jury, limit: DampingRange, robust: RobustCandidates, halvings: int) -> None:
    """Halve the way to the next stiffer wall, a few times; where that leads up to it, try it once more and go on.

    So that what is felt hardly depends on where the walls stand that were looked at, and thus on the one wanted.
    """
    corners = hand_corners(problem.hands)
    low = jury.reached_n_per_m()
    high = None if low < 0 else stiffer_rung_n_per_m(problem, limit, robust, low)
    nearer = False
    for _ in range(halvings):
        if high is None or (high < _CLOSE * low and not nearer):
            return
        again = nearer and high < _CLOSE**3 * low
        felt = high if again else math.sqrt(low * high)
        jury.ask(softened_to(problem, corners, felt), _BETWEEN)
        held = jury.holds(felt)
        for more in () if held else robust.at(felt):
            jury.ask([more], _BETWEEN)
            held = jury.holds(felt)
            if held:
                break
        nearer = held and not again
        low = felt if held else low
        if held == again:
            high = stiffer_rung_n_per_m(problem, limit, robust, low) if held else felt
