"""The couplings among which `recommend` chooses: today's designs, each for every hand and the device let go."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi.coupling import Coupling, Gains, Runtime, near_rigid_n_per_m, spring_before
from avc_casadi.design.constant import tuned_margin
from avc_casadi.design.robust import MOST_RUNGS, NEXT, ladder_n_per_m, refined, robust_at, softer_ladders
from avc_casadi.loop import with_let_go
from avc_casadi.recommendation._reach import tuned
from avc_casadi.stability import DampingRange, damping_range
from avc_casadi.support import SILENT, Progress

if TYPE_CHECKING:
    from avc_casadi.design.robust import Rung, Unrest
    from avc_casadi.loop import Hand, StylusHand
    from avc_casadi.problem import Problem

# Damping kept in reserve, as multiples of the tuned designs' own: a coarse encoder asks for more.
_RESERVES = (1.0, 3.0)
# Where in the interval of stable dampings the contact damper stands.
_SHARES = (0.5, 0.25, 0.1, 0.03, 0.01)
# Stiffness felt before a wall that is too stiff, as a share of the stiffest that is stable with everybody.
_OF_STIFFEST = (0.9, 0.82, 0.75)
SAFER = (0.6, 0.45, 0.33, 0.24, 0.15)
"""The same where nothing stiffer brings everybody to rest: of the wall, if that is softer."""
SOFTENED = "softened wall"
Alternatives = list[Coupling]
"""Couplings that are equally stiff, the likeliest first: the first that is safe and quiet will do."""
# How much stiffer another wall is at least.
_BARELY = 1.02


def felt_at_rest_n_per_m(coupling: Coupling) -> float:
    """Return the stiffness of coupling and wall in series at rest."""
    k, wall = coupling.table.at_rest.stiffness_n_per_m, coupling.wall.stiffness_n_per_m
    return k * wall / (k + wall) if k + wall else 0.0


def plain_candidates(problem: Problem, subjects: Hand | StylusHand, stiffest: DampingRange) -> Iterator[Alternatives]:
    """Yield couplings of spring and damper.

    No coupling but the wall itself; a rigid coupling with a contact damper; for a wall beyond what the device can give,
    springs that soften it to just below that.

    Args:
        problem: device, wall and hands.
        subjects: the extreme hands.
        stiffest: the stiffest wall that is stable with everybody and let go.
    """
    people = with_let_go(subjects)
    for gains, name in _rigid(problem, people):
        yield [Coupling.constant(problem, gains, name)]
    for share in _OF_STIFFEST:
        yield from _softened(problem, people, share * stiffest.stiffness_n_per_m)


def stiffer_rung_n_per_m(
    problem: Problem, stiffest: DampingRange, robust: RobustCandidates, felt_n_per_m: float
) -> float | None:
    """Return the next stiffer wall of those that are looked at, behind whatever law; None where it is the wanted one.

    Args:
        problem: device, wall and hands.
        stiffest: the stiffest wall that is stable with everybody and let go.
        robust: walls with laws that were looked at.
        felt_n_per_m: what is felt so far.
    """
    wall, limit, looked = problem.environment.stiffness_n_per_m, stiffest.stiffness_n_per_m, robust.walls_n_per_m
    if not looked:
        looked = [share * limit for share in (*_OF_STIFFEST, 1.0)] + [share * min(limit, wall) for share in SAFER]
    elif felt_n_per_m >= max(looked):
        looked = [NEXT * felt_n_per_m]  # no law was found for it
    above = [one for one in (*looked, wall) if _BARELY * felt_n_per_m < one <= wall]
    return min(above, default=None)


def softened_to(problem: Problem, subjects: Hand | StylusHand, felt_n_per_m: float) -> Iterator[Alternatives]:
    """Yield springs with which the wall feels so stiff, then the same behind an observer.

    Args:
        problem: device, wall and hands.
        subjects: the extreme hands.
        felt_n_per_m: of spring and wall in series.
    """
    found = list(_softened(problem, with_let_go(subjects), felt_n_per_m))
    yield from (*found, *behind_observers(found))


class RobustCandidates:
    """Walls behind an observer with state feedback; none for a device without a law, nor beside detents.

    Attributes:
        ladder_n_per_m: walls in the order in which to ask for them: the wanted one first, if it is near, then others of
            rising stiffness, and it again.
        softer: ladders of walls softer than these.
        rungs: walls and laws that were found so far.

    Args:
        problem: device, wall and hands.
        stiffest: the stiffest wall that is stable with everybody and let go.
        ends: how fast those end who try a coupling first.
        start: a wall from which on to look. With a law for it only a first answer is looked for: of walls near one of
            those that have a law no other law is searched. None begins where spring and damper end.
    """

    def __init__(
        self,
        problem: Problem,
        stiffest: DampingRange,
        ends: Callable[[Coupling], Unrest],
        start: Rung | float | None = None,
    ) -> None:
        self._problem, self._ends = problem, ends
        self._known = known = None if isinstance(start, float) else start
        self.rungs: list[Rung] = []
        self.ladder_n_per_m: list[float] = []
        self.softer: list[list[float]] = []
        if problem.detent is not None:
            return  # whose slopes nobody judges behind an observer
        with suppress(UnsupportedError):
            ladder = ladder_n_per_m(problem, stiffest)
            if known is not None:
                self.rungs.append(known)
            if start is not None:
                first = start if isinstance(start, float) else start.stiffness_n_per_m
                ladder = [first * NEXT**rung for rung in range(MOST_RUNGS)]
            self.ladder_n_per_m, self.softer = ladder, softer_ladders(ladder)

    @property
    def walls_n_per_m(self) -> list[float]:
        """Stiffness at rest of the walls for which laws were found so far."""
        return [rung.stiffness_n_per_m for rung in self.rungs]

    def at(self, felt_n_per_m: float) -> Iterator[Alternatives]:
        """Yield laws for a wall, those of walls near it before what a search finds; none where there is none.

        After either come laws near them with which more people rest, for whom they were not enough.

        Args:
            felt_n_per_m: stiffness at rest, the wanted wall's at most.
        """
        if not self.ladder_n_per_m:
            return
        known = self._known
        if known is not None and known.stiffness_n_per_m == felt_n_per_m and known.found.cost.holds:
            yield self._with(known)
            yield from self._better(known)
            return
        for rung in islice(robust_at(self._problem, felt_n_per_m, tuple(self.rungs)), None if known is None else 1):
            self.rungs.append(rung)
            alternatives = self._with(rung)
            yield alternatives
            yield from self._better(rung)

    def again(self, felt_n_per_m: float) -> Iterator[Alternatives]:
        """Yield laws near the last one for a wall with which more people rest of those who try first by now."""
        last = next((rung for rung in reversed(self.rungs) if rung.stiffness_n_per_m == felt_n_per_m), None)
        if last is not None:
            yield from self._better(last)

    def _better(self, rung: Rung) -> Iterator[Alternatives]:
        better = refined(self._problem, rung, self._ends(self._with(rung)[0]))
        if better is not None:
            self.rungs.append(better)
            yield self._with(better)

    def _with(self, rung: Rung) -> Alternatives:
        laws = (rung.found.law, *(one.law for one in rung.found.others))
        return [Coupling.constant(self._problem, rung.gains, "robust", Runtime(state_feedback=law)) for law in laws]


def tuned_candidates(problem: Problem, progress: Progress = SILENT) -> Iterator[Alternatives]:
    """Yield constant gains tuned for every hand and the device let go, with growing reserves.

    Args:
        problem: device, wall and hands.
        progress: told of the tuning.
    """
    safe = problem.changed(hands={"let_go": True})
    for share in _RESERVES:
        found = _tuned(safe, share, progress)
        if isinstance(found, Gains):
            yield from _with_observer(Coupling.constant(problem, found, "static-tuned"))


def _tuned(problem: Problem, share: float, progress: Progress) -> object:
    try:
        return tuned(problem, scheduled=False, margin_ns_per_m=share * tuned_margin(problem), progress=progress)
    except UnsupportedError:
        return None


def _rigid(problem: Problem, people: Hand | StylusHand) -> Iterator[tuple[Gains, str]]:
    wall, rigid = problem.environment, near_rigid_n_per_m(problem.device)
    yield Gains(0.0, rigid), "none"
    for total in _dampings(damping_range(problem.device, people, wall.stiffness_n_per_m)):
        yield Gains(0.0, rigid, max(0.0, total - wall.damping_ns_per_m)), "contact damper"


def _softened(problem: Problem, people: Hand | StylusHand, felt_n_per_m: float) -> Iterator[Alternatives]:
    """Put a spring before a wall that is too stiff, so that both are as stiff as wanted; the least damped first.

    The less damped the less a hand feels before the wall, and of what is as stiff many dampers are much alike.
    """
    wall = problem.environment.stiffness_n_per_m
    if 0 < felt_n_per_m < wall:
        spring = spring_before(problem, felt_n_per_m)
        dampings = _dampings(damping_range(problem.device, people, felt_n_per_m))
        alike = [Coupling.constant(problem, Gains(0.0, spring, total), SOFTENED) for total in reversed(dampings)]
        yield from [alike] if alike else []


def _dampings(found: DampingRange) -> list[float]:
    if np.isnan(found.lowest_ns_per_m):
        return []
    return [found.lowest_ns_per_m + share * (found.highest_ns_per_m - found.lowest_ns_per_m) for share in _SHARES]


def _with_observer(coupling: Coupling) -> Iterator[Alternatives]:
    yield [coupling]
    yield from behind_observers([[coupling]])


def behind_observers(some: Iterable[Alternatives]) -> Iterator[Alternatives]:
    """Yield couplings behind an observer between the steps of the encoder; none where it has none."""
    for alternatives in some:
        problem = alternatives[0].problem
        if problem.device.encoder_resolution_m > 0:
            runtime = Runtime(observer_mass_kg=problem.device.mass_kg + problem.hands.mass_kg[0])
            yield [Coupling.constant(problem, one.table.at_rest, one.method, runtime) for one in alternatives]
