"""Who tries the candidates: a few first, then everybody, then people who had no part in the choice."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.model.hands import Hand
from avc_casadi.recommendation.asked_first import AskedFirst, Group, elsewhere, off_file, together
from avc_casadi.recommendation.candidates import felt_at_rest_n_per_m
from avc_casadi.recommendation.choice import AS_STIFF, FIRST, Judged, confirmed, likeliest, tried
from avc_casadi.simulation.population.operators import draw_hands, loose_hands

if TYPE_CHECKING:
    from collections.abc import Iterable
    from concurrent.futures import Executor

    from avc_casadi._util.progress import Progress
    from avc_casadi.coupling import Coupling
    from avc_casadi.model.problem import Problem
    from avc_casadi.recommendation.candidates import Alternatives

# Of those who hold on loosely so many try a law before the others.
_ONE_IN = 4
# Share of the people who move, up to which those are asked first from then on.
_FEW_MOVE = 0.05


class Jury:
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
        count = 2 * len(people)
        draws = itertools.count(0, count)
        self._others = (draw_hands(problem.hands, count, seed, "training", first=first) for first in draws)
        self._first, self._loose = people.pick(slice(FIRST)), loose_hands(problem.hands, len(people), seed)
        self._elsewhere = elsewhere(problem.device, (self._first, self._loose), seed)
        self._off = off_file(problem.device, self._first, self._loose)
        self._candidates: list[Alternatives] = []
        self._restless: list[Alternatives] = []
        self._search = ""

    def ask(self, more: Iterable[Alternatives], search: str) -> bool:
        """Try more candidates, of a search that is told; say whether all who try first come to rest with the last."""
        self._search, everybody = search, False
        for alternatives in more:
            self.considered += len(alternatives)
            groups = (Group(self._first), Group(self._loose))
            likely, everybody = likeliest(alternatives, groups, self._elsewhere, lean_on_friction=self._lean)
            self._candidates.append(likely)
            if everybody:
                self._replace(likely[0])
            else:
                self._restless.append(likely)
        self._try()
        return everybody

    def _replace(self, better: Coupling) -> None:
        """Forget those as stiff with which somebody hardly came to rest."""
        felt = felt_at_rest_n_per_m(better)
        worse = (one for one in self._restless if abs(felt_at_rest_n_per_m(one[0]) / felt - 1) < AS_STIFF)
        gone = {id(coupling) for one in worse for coupling in one}
        self._candidates = [one for one in self._candidates if id(one[0]) not in gone]
        self.judged = [one for one in self.judged if id(one.coupling) not in gone]

    def asked_first(self) -> AskedFirst:
        """Return who tries a law first: now, as they may be others after the next ones were tried."""
        few = np.arange(len(self._loose)) % _ONE_IN == 0
        loose = Group(self._loose)
        likely = Group(together(self._first, loose.pick(few).people))
        others = loose.pick(~few)
        stages = ((likely,), self._elsewhere, (others,) if len(others.people) else ())
        return AskedFirst(tuple(stage for stage in stages if stage), self._lean, self._off)

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
        best = self.stiffest()
        return -1.0 if best is None else best.felt_n_per_m

    def stiffest(self) -> Judged | None:
        """Return the stiffest of what is safe and quiet, if anything is."""
        enough = [one for one in self.judged if one.complete(lean_on_friction=self._lean)]
        return max(enough, key=lambda one: one.felt_n_per_m, default=None)

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
        self._learn(before)
        return self.judged is not before

    def _learn(self, before: list[Judged]) -> None:
        """Let those try the next ones first who move with one of these, with which others rested."""
        known = {id(one) for one in before}
        for one in (one for one in self.judged if id(one) not in known):
            trial, people = (one.trial, self._people) if one.others is None else (one.others, one.asked)
            if people is None or trial.hands < len(people):
                continue
            moving = np.flatnonzero(~(trial.stable if self._lean else trial.stable & trial.stable_without_friction))
            if not 0 < len(moving) <= _FEW_MOVE * trial.hands:
                continue
            if trial.devices == 1:
                self._first = together(self._first, people.pick(moving))
            else:
                met = moving % len(one.devices)
                groups = (Group(people.pick(moving[met == place]), one.devices[place]) for place in np.unique(met))
                self._elsewhere = (*self._elsewhere, *groups)

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
            before, self.judged = self.judged, judged
            self._learn(before)
