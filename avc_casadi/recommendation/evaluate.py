"""Evaluate candidates with simulated hands: screening hands, all hands, then hands outside the selection."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.claims.deployable import deployable
from avc_casadi.model.corners import device_corners, device_set
from avc_casadi.model.hands import Hand
from avc_casadi.recommendation.generate import static_stiffness_n_per_m
from avc_casadi.recommendation.rank import AS_STIFF, Judged, best_of
from avc_casadi.recommendation.screening import (
    BEYOND_HANDS,
    Group,
    Screening,
    elsewhere,
    off_file,
    required,
    together,
)
from avc_casadi.simulation.population.coupling_trial import try_coupling, try_on_devices
from avc_casadi.simulation.population.operators import draw_hands, loose_grips

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence
    from concurrent.futures import Executor

    from avc_casadi.coupling import Coupling
    from avc_casadi.model.device import Device
    from avc_casadi.model.hands import StylusHand
    from avc_casadi.model.problem import Problem
    from avc_casadi.recommendation.generate import Alternatives

FIRST = 16
"""Number of screening hands, corners included: a coupling that they do not settle with goes no further."""
# Largest number of equally stiff alternatives, tried in turn while each is refuted.
_MOST_TRIED = 5
# Number of devices of the declared ranges among which the confirming hands are divided.
_DEVICES = 16
# Least number of loose grips that screen a law, of which one in so many does first; and how many times as many others
# screen a refined law, which is the nearest of many: those who refute it are then rarer by as much.
_LOOSE, _ONE_IN, _MORE_LOOSE = 100, 4, 2
# Settled with margin: residual speed below this share of the threshold.
_SETTLED_MARGIN = 0.7
# Largest share of hands not settling at which these join the screening hands.
_FEW_MOVE = 0.05


class Evaluator:
    """Trials of the candidates with simulated hands.

    Attributes:
        judged: couplings tried, with their trials.
        considered: number of couplings proposed.
    """

    def __init__(
        self,
        problem: Problem,
        people: Hand,
        seed: int,
        progress: Progress = SILENT,
        *,
        lean_on_friction: bool,
        executor: Executor | None,
        stiffest: bool = False,
    ) -> None:
        self._stiffest = stiffest
        self.judged: list[Judged] = []
        self.considered = 0
        self._people, self._seed, self._progress, self._lean = people, seed, progress, lean_on_friction
        self._executor = executor
        count = 2 * len(people)
        draws = itertools.count(0, count)
        self._others = (draw_hands(problem.hands, count, seed, "training", first=first) for first in draws)
        loose = max(len(people), _LOOSE)
        self._first, self._loose = people.pick(slice(FIRST)), loose_grips(problem.hands, loose, seed)
        self._more_loose = loose_grips(problem.hands, _MORE_LOOSE * loose, seed + 1)
        self._asked = required(problem, BEYOND_HANDS, seed)
        # Which of these screen, the first ones to begin with.
        self._screening = [np.arange(len(group.people)) < FIRST for group in self._asked]
        self._in_ranges = elsewhere(problem.device, (self._first, self._loose), seed)
        friction, known = problem.device.coulomb_friction_n, problem.device.range.coulomb_friction_n
        self._rough = not lean_on_friction and (friction > 0 or known is not None)
        self._off = off_file(problem.device, self._first, self._loose)
        self._candidates: list[Alternatives] = []
        self._unsettled: list[Alternatives] = []
        self._search = ""

    def ask(self, more: Iterable[Alternatives], search: str) -> bool:
        """Try more candidates of a named search; return whether all screening hands settle with the last."""
        self._search, everybody = search, False
        for alternatives in more:
            self.considered += len(alternatives)
            groups = (Group(self._first), Group(self._loose))
            likely, everybody = likeliest(alternatives, groups, self._elsewhere, lean_on_friction=self._lean)
            self._candidates.append(likely)
            if everybody:
                self._replace(likely[0])
            else:
                self._unsettled.append(likely)
        self._try()
        return everybody

    @property
    def _elsewhere(self) -> tuple[Group, ...]:
        """Screening hands on devices of the ranges and beyond."""
        few = (group.pick(rows) for group, rows in zip(self._asked, self._screening, strict=True))
        return (*self._in_ranges, *few)

    def _replace(self, better: Coupling) -> None:
        """Drop equally stiff couplings with which some screening hand did not settle."""
        felt = static_stiffness_n_per_m(better)
        worse = (one for one in self._unsettled if abs(static_stiffness_n_per_m(one[0]) / felt - 1) < AS_STIFF)
        gone = {id(coupling) for one in worse for coupling in one}
        self._candidates = [one for one in self._candidates if id(one[0]) not in gone]
        self.judged = [one for one in self.judged if id(one.coupling) not in gone]

    def screening(self, *, whole: bool = False) -> Screening:
        """Return the current screening hands, which later trials may extend.

        Args:
            whole: whether all hands of the trial are among them, those on required devices too, and more loose grips.
        """
        few = np.arange(len(self._loose)) % _ONE_IN == 0
        likely = Group(together(self._first, self._loose.pick(np.flatnonzero(few))))
        others, rough = Group(self._loose.pick(np.flatnonzero(~few))), Group(self._first, friction=True)
        rest = (Group(together(self._people.pick(slice(FIRST, None)), self._more_loose)), *self._asked)
        stages = ((likely,), (rough,) if self._rough else (), self._elsewhere, (others,), rest if whole else ())
        some = (tuple(group for group in stage if len(group.people)) for stage in stages)
        return Screening(tuple(stage for stage in some if stage), self._lean, self._off)

    def finds(self, more: Iterable[Alternatives], stiffness_n_per_m: float, search: str) -> bool:
        """Try more candidates until one of this stiffness is acceptable so far; return whether there is one."""
        for alternatives in more:
            if self.ask([alternatives], search) and self.reaches(stiffness_n_per_m):
                return True
        return self.reaches(stiffness_n_per_m)

    def reaches(self, stiffness_n_per_m: float, *, plain: bool = False) -> bool:
        """Return whether a coupling of this stiffness is acceptable so far: safe, vibration below the threshold.

        Args:
            stiffness_n_per_m: static.
            plain: without state feedback.
        """
        best = self.stiffest(plain=plain)
        return best is not None and best.felt_n_per_m >= (1 - AS_STIFF) * stiffness_n_per_m

    def pleases(self, stiffness_n_per_m: float) -> bool:
        """Return whether all hands settle without a detectable vibration with a coupling of this stiffness."""
        enough = (1 - AS_STIFF) * stiffness_n_per_m
        return any(
            one.complete(lean_on_friction=self._lean) and one.felt_n_per_m >= enough and bool(one.trial.quiet.all())
            for one in self.judged
        )

    def stiffest(self, *, plain: bool = False) -> Judged | None:
        """Return the stiffest acceptable coupling, if any; `plain` without state feedback."""
        some = (one for one in self._enough() if not (plain and one.coupling.runtime.state_feedback))
        return max(some, key=lambda one: one.felt_n_per_m, default=None)

    def nearest(self) -> Judged | None:
        """Return the acceptable coupling of smallest distance from the wall, if any."""
        return min(self._enough(), key=lambda one: one.distance, default=None)

    def may_win(self, alternatives: Alternatives) -> bool:
        """Return whether untried couplings may be as stiff as the acceptable ones, or of smaller mismatch."""
        enough = self._enough()
        return not enough or _may_win(Judged(alternatives[0], enough[0].trial, 0), enough)

    def _enough(self) -> list[Judged]:
        return [one for one in self.judged if one.complete(lean_on_friction=self._lean)]

    def holds(self, stiffness_n_per_m: float, *, plain: bool = False) -> bool:
        """Return whether a coupling of this stiffness is acceptable, also with hands outside the selection."""
        while self.reaches(stiffness_n_per_m, plain=plain):
            if not self.confirm():
                return True
            self._try()
        return False

    def confirm(self) -> bool:
        """Try the best coupling with hands outside the selection; return whether a trial was added."""
        before = self.judged
        self.judged = confirmed(
            before,
            self._people,
            self._others,
            self._seed,
            lean_on_friction=self._lean,
            stiffest=self._stiffest,
            executor=self._executor,
        )
        self._learn(before)
        return self.judged is not before

    def _learn(self, before: list[Judged]) -> None:
        """Add to the screening hands those that did not settle with a coupling with which the others did."""
        known = {id(one) for one in before}
        for one in (one for one in self.judged if id(one) not in known):
            for place, rests in enumerate(one.beyond):
                if (~rests).mean() <= _FEW_MOVE:
                    self._screening[place] |= ~rests
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
                self._in_ranges = (*self._in_ranges, *groups)

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
            beyond=self._asked,
        )
        if len(judged) > len(self.judged):
            before, self.judged = self.judged, judged
            self._learn(before)


def tried(
    candidates: Iterable[Alternatives],
    before: list[Judged],
    people: Hand | StylusHand,
    seed: int,
    progress: Progress = SILENT,
    *,
    lean_on_friction: bool,
    executor: Executor | None = None,
    search: str = "",
    beyond: Sequence[Group] = (),
) -> list[Judged]:
    """Return the trials of the deployable candidates, stiffest first, leaving out those that could not win.

    Args:
        candidates: simpler ones first; some may have been judged already.
        before: those judged already.
        people: hands of the trial.
        seed: of their draw, for the record.
        progress: reports the candidates.
        lean_on_friction: as in `best_of`.
        executor: as in `try_coupling`.
        search: name of the search that proposed the new candidates.
        beyond: hands that must settle on perturbed devices.

    Returns:
        Those judged before, and the new ones.
    """
    ranked = sorted(enumerate(candidates), key=lambda pair: (-static_stiffness_n_per_m(pair[1][0]), pair[0]))
    judged = list(before)
    for done, (order, alternatives) in enumerate(ranked, start=1):
        enough = [found for found in judged if found.complete(lean_on_friction=lean_on_friction)]
        if enough and not _may_win(Judged(alternatives[0], enough[0].trial, order), enough):
            continue
        for one in alternatives:
            known = next((found for found in judged if found.coupling is one), None)
            if known is not None and known.complete(lean_on_friction=lean_on_friction):
                break
            if known is not None or not deployable(one).passed:
                continue
            found = Judged(one, try_coupling(one, people.pick(slice(FIRST)), seed, executor=executor), order)
            if found.safety <= int(lean_on_friction) and len(people) > FIRST:
                found = replace(found, trial=try_coupling(one, people, seed, executor=executor))
            if found.complete(lean_on_friction=lean_on_friction):
                settled = [group.residual_speeds([one], friction=lean_on_friction)[0] < 1 for group in beyond]
                found = replace(found, beyond=tuple(settled))
            judged.append(found)
            if found.complete(lean_on_friction=lean_on_friction):
                break
        # Candidates tried before are counted among the new ones.
        progress.advance(max(done, min(len(judged), len(ranked))), len(ranked), f"candidates tried, {search}")
    return judged


def _may_win(one: Judged, enough: list[Judged]) -> bool:
    """Return whether an untried coupling may be as stiff as the acceptable ones, or of smaller mismatch."""
    if static_stiffness_n_per_m(one.coupling) >= (1 - 2 * AS_STIFF) * max(found.felt_n_per_m for found in enough):
        return True
    return one.distance < min(found.distance for found in enough)


def likeliest(
    alternatives: Alternatives, groups: Iterable[Group], elsewhere: Sequence[Group] = (), *, lean_on_friction: bool
) -> tuple[Alternatives, bool]:
    """Return the alternatives with which all hands settle, or that with which most do; and whether all do.

    A single one without state feedback is taken as it is.

    Args:
        alternatives: equally stiff ones.
        groups: hands by stage: a later group tries only those with which all earlier groups settled.
        elsewhere: hands on other devices: alternatives are sorted by how many of these do not settle.
        lean_on_friction: whether the declared dry friction may help.
    """
    left = alternatives
    # Where hands settle by friction alone, a margin is kept: another hand may move a little faster.
    slow = _SETTLED_MARGIN if lean_on_friction else 1.0
    asked = len(left) > 1 or left[0].runtime.state_feedback is not None
    for group in groups if asked else ():
        restless = (~(group.residual_speeds(left, friction=lean_on_friction) < slow)).sum(axis=1)
        if restless.min() > 0:
            return [left[int(restless.argmin())]], False
        left = [one for one, moving in zip(left, restless, strict=True) if not moving]
    moving = np.zeros(len(left))
    for group in elsewhere if asked else ():
        moving += (~(group.residual_speeds(left, friction=lean_on_friction) < slow)).sum(axis=1)
    fewest = np.argsort(moving, kind="stable")[:_MOST_TRIED]
    return [left[place] for place in fewest if moving[place] == 0 or moving.min() > 0], not moving.min()


def confirmed(
    judged: list[Judged],
    people: Hand | StylusHand,
    others: Iterator[Hand],
    seed: int,
    *,
    lean_on_friction: bool,
    stiffest: bool = False,
    executor: Executor | None = None,
) -> list[Judged]:
    """Try the best coupling with all hands, then with hands outside the selection, until it stays the best.

    Selection among many with the same hands is biased. Where the device has ranges, the confirming hands are spread
    over devices within them.

    Args:
        judged: at least one.
        people: hands of the trial.
        others: hands outside the selection, fresh on each iteration.
        seed: of their draws, for the record.
        lean_on_friction: as in `best_of`.
        stiffest: as in `best_of`.
        executor: as in `try_coupling`.
    """
    while True:
        best = best_of(judged, lean_on_friction=lean_on_friction, stiffest=stiffest)
        if best.trial.hands < len(people):
            asked = replace(best, trial=try_coupling(best.coupling, people, seed, executor=executor))
        elif best.others is None:
            devices = _devices(best.coupling.problem.device, seed)
            strangers = next(others)
            found = try_on_devices(best.coupling, strangers, devices, seed, executor)
            asked = replace(best, others=found, asked=strangers, devices=tuple(devices))
        else:
            return judged
        judged = [asked if one is best else one for one in judged]


def _devices(device: Device, seed: int) -> list[Device]:
    """Return devices of the declared ranges, nominal first, then corners and interior points."""
    corners = device_corners(device)
    if len(corners) == 1:
        return [device]
    some = np.random.default_rng(seed).permutation(len(corners))[: _DEVICES // 2]
    within = device_set(device, draws=_DEVICES - 1 - len(some), seed=seed)[len(corners) :]
    return [device, *(corners[place] for place in some), *within]
