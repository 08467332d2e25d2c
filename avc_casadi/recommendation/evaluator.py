"""Evaluate candidates: deployable, then simulated hands, then the robustness asked for, then hands never seen."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi._util.json_values import Document
from avc_casadi.claims.deployable import deployable
from avc_casadi.coupling import Coupling
from avc_casadi.loops.margins import OpenLoop
from avc_casadi.loops.plant_family import PlantFamily, perturbed_plants
from avc_casadi.loops.wall import law_at_rest
from avc_casadi.model.corners import (
    USUAL,
    Robustness,
    device_corners,
    device_draws,
    unmodelled,
)
from avc_casadi.model.device import Device
from avc_casadi.model.effects import Effect
from avc_casadi.model.hands import Hand, StylusHand
from avc_casadi.model.perturbed import PERTURBED_SHARE, perturbed_devices, perturbed_keys
from avc_casadi.model.problem import Problem
from avc_casadi.recommendation.rank import Candidate, Safety, best_of, error_in_motion
from avc_casadi.recommendation.reasons import Flaw, UnmetRequirement, UnmetRequirements
from avc_casadi.recommendation.request import Request
from avc_casadi.simulation.population.operators import GRIPS, draw_hands, draw_population, loose_grips, people_of
from avc_casadi.simulation.population.trial import CouplingTrial, residual_speeds, try_coupling, try_on_devices

FIRST = 16
"""Hands of a first trial, corners included."""
USUAL_COUPLINGS = 9
"""So many couplings are judged for three of four drawn devices: what progress expects until there are more."""
WORST_DEVICES = 8
"""Of the perturbed devices, so many are tried: those with which the loop is the least stable."""
MOST_MOTIONS = ("press", "tap", "hold", "strike", "touch", "graze")
MORE_FRICTION = 1.5
"""Factor on the declared dry friction that a law must bear: friction that holds the motor while a structure swings may
keep the swing going, and it is seldom known better than this."""
_FEW = 0.03
"""Share of the loose grips that may still be on the way when the trial ends."""


@dataclass(frozen=True)
class Group:
    """Hands that press, tap, hold, strike and touch lightly on a device with an unmodelled effect."""

    hands: Hand | StylusHand
    device: Device | None = None  # None is that of the problem
    effects: tuple[Effect, ...] = ()  # beside those that the device declares
    key: str = ""  # of [robustness]; or held, of [device]
    value: float | str = ""

    def settles(self, coupling: Coupling, *, friction: bool) -> BoolArray:
        """Return which hands settle in every motion."""
        circumstances: Any = {"friction": friction, "device": self.device, "effects": self.effects}
        return np.asarray(residual_speeds(coupling, self.hands, MOST_MOTIONS, **circumstances) < 1)


def groups_beyond(problem: Problem, required: Robustness, seed: int, count: int = 60) -> tuple[Group, ...]:
    """Return groups of hands that try devices with one unmodelled effect each, and a grip where [hands] is another.

    `required` are the effects of [robustness]; each group has so many hands.
    """
    device, hands = problem.device, people_of(problem.hands, count, seed)
    groups = [
        Group(hands, effect.device, effect.effects, effect.key, effect.value) for effect in unmodelled(device, required)
    ]
    if device.held != "grip":
        drawn = draw_population(GRIPS[device.held], count, seed).at_handle(device.metres_per_unit)
        groups.append(Group(drawn, key="held", value=device.held))
    return tuple(groups)


class Evaluator:
    """Judges couplings of one problem, the only place that does.

    `within` is the impedance error in motion above which a coupling is not worth a trial.
    """

    def __init__(self, problem: Problem, request: Request, *, within: float = math.inf) -> None:
        """Draw the hands, devices and groups by which every coupling of the problem is judged.

        `within` is the error in motion, a share, beyond which a coupling is not tried.
        """
        self.candidates: list[Candidate] = []
        self.considered = 0
        seed = request.seed
        self._hands = people_of(problem.hands, request.hands, seed)
        self._seed = seed
        self._progress = request.progress
        self._executor = request.executor
        self._trial = partial(try_coupling, seed=seed, executor=request.executor)
        self._lean = request.lean_on_friction
        self._required = Safety.BY_FRICTION if request.lean_on_friction else Safety.ALWAYS
        self._within = within
        count = 2 * len(self._hands)
        self._others = (
            draw_hands(problem.hands, count, seed, first=first, training=True) for first in itertools.count(0, count)
        )
        self._beyond = groups_beyond(problem, problem.robustness, seed)
        # They strike and touch lightly too: the last that come to rest behind a law.
        self._loose, self._corners = Group(loose_grips(problem.hands, 100, seed)), PlantFamily.of(problem).corner_hands
        self._devices = _devices(problem.device, seed)
        friction_n = MORE_FRICTION * problem.device.coulomb_friction_n
        self._with_more_friction = problem.device.model_copy(update={"coulomb_friction_n": friction_n})

    def __call__(self, coupling: Coupling) -> Candidate | None:
        """Return the coupling with its trials; None where it is not deployable, or further off in motion than asked.

        Some hands try it first, all of them where these settle, then groups beyond the trial.
        """
        self.considered += 1
        expected = max(USUAL_COUPLINGS, self.considered + 1)
        self._progress.advance(self.considered - 1, expected, f"couplings, {coupling.method}")
        too_far = math.isfinite(self._within) and error_in_motion(coupling) > self._within
        if too_far or not deployable(coupling).passed:
            return None
        candidate = Candidate(coupling, self._trial(coupling, self._hands.pick(slice(FIRST))), self.considered)
        if candidate.safety <= self._required and len(self._hands) > FIRST:
            candidate = replace(candidate, trial=self._trial(coupling, self._hands))
        if not self.flaw(candidate):
            candidate = replace(candidate, beyond=self._tried_beyond(coupling))
        self.candidates.append(candidate)
        return candidate

    def _tried_beyond(self, coupling: Coupling) -> tuple[BoolArray, ...]:
        """Return which hands of each group settle beyond the trial, until too few of one do.

        Corner hands strike first, then loose grips, then for a law perturbed devices, then each unmodelled effect.
        """
        # A loop that is stable at full gain need not be at the lower one of a force that is clipped.
        struck = residual_speeds(coupling, self._corners, ("strike", "hit", "slam")) < 1
        if not struck.all():
            return (struck,)
        loose = self._loose.settles(coupling, friction=self._lean)
        if loose.mean() < 1 - _FEW:
            return struck, loose
        if coupling.runtime.state_feedback is not None:
            on_perturbed = self._tried_on_perturbed(coupling)
            if on_perturbed is not None:
                return struck, on_perturbed
        return struck, *(group.settles(coupling, friction=self._lean) for group in self._beyond)

    def _tried_on_perturbed(self, coupling: Coupling) -> BoolArray | None:
        """Return which hands settle on perturbed devices, if too few do; None where enough do.

        A law knows its device. It must bear one with more friction, and those a tenth off with the declared friction.
        """
        if self._with_more_friction.coulomb_friction_n > 0:
            speeds = residual_speeds(coupling, self._corners, ("press", "strike"), device=self._with_more_friction)
            if (speeds >= 1).any():
                return np.asarray(speeds < 1)
        perturbed = try_perturbed_devices(coupling, self._seed)
        if perturbed is not None and perturbed.trial.stable.mean() < 1 - _FEW:
            return perturbed.trial.stable
        return None

    def first_complete(self, couplings: Iterable[Coupling]) -> Candidate | None:
        """Judge couplings until one is complete and confirmed, and return it; None where none is."""
        for coupling in couplings:
            candidate = self(coupling)
            if candidate is not None and not self.flaw(candidate) and not self.flaw(self._confirmed(candidate)):
                return candidate
        return None

    def best(self) -> Candidate | None:
        """Return the best coupling that stays the best with hands never seen; None without any deployable one."""
        while self.candidates:
            candidate = best_of(self.candidates, lean_on_friction=self._lean)
            if candidate.others is not None:
                return candidate
            self._confirmed(candidate)
        return None

    def flaw(self, candidate: Candidate) -> Flaw | None:
        """Return why a coupling is not complete; None where it is."""
        return candidate.flaw(self._required)

    def complete(self) -> list[Candidate]:
        """Return the complete couplings."""
        return [candidate for candidate in self.candidates if not self.flaw(candidate)]

    def least_distance(self) -> float:
        """Return the smallest distance of the complete couplings from the wall; infinite without any."""
        return min((candidate.distance for candidate in self.complete()), default=math.inf)

    def _confirmed(self, candidate: Candidate) -> Candidate:
        """Return a candidate tried by all hands, and by others on devices of the ranges.

        The best of many is chosen by the hands of its trial, which favours luck: others confirm it.
        """
        coupling, trial = candidate.coupling, candidate.trial
        if trial.hands < len(self._hands):
            trial = self._trial(coupling, self._hands)
        trial_of_others = try_on_devices(coupling, next(self._others), self._devices, self._seed, self._executor)
        beyond = candidate.beyond or self._tried_beyond(coupling)
        confirmed = replace(candidate, trial=trial, others=trial_of_others, beyond=beyond)
        place = next(place for place, known in enumerate(self.candidates) if known is candidate)
        self.candidates[place] = confirmed
        return confirmed


def _devices(device: Device, seed: int, count: int = 16) -> list[Device]:
    """Return devices of the ranges for the confirming hands: nominal first, then corners and interior points."""
    corners = device_corners(device)
    if len(corners) == 1:
        return [device]
    chosen = np.random.default_rng(seed).permutation(len(corners))[: count // 2]
    within = device_draws(device, count - 1 - len(chosen), seed)
    return [device, *(corners[place] for place in chosen), *within]


@dataclass(frozen=True)
class UnmodelledTrial:
    """Trial with one unmodelled effect, or with hands outside the design set."""

    key: str  # of [robustness]; or held, of [device]
    value: float | str
    asked: bool  # whether the problem requires it
    hands: int
    at_rest_without_friction: int
    at_rest: int | None  # by friction too; None where all settle without

    @property
    def at_rest_as_required(self) -> int:
        """Hands that settle: by friction too where the problem requires it, which then may be counted on."""
        return self.at_rest if self.asked and self.at_rest is not None else self.at_rest_without_friction


def unmodelled_trials(coupling: Coupling, seed: int = 0) -> tuple[UnmodelledTrial, ...]:
    """Return how many hands settle with a coupling on devices with one unmodelled effect each.

    They are counted without dry friction, and with it where some do not settle. Effects are those of [robustness] and
    usual ones.
    """
    problem = coupling.problem
    given = {key: value for key, value in vars(problem.robustness).items() if value is not None}
    trials = []
    for group in groups_beyond(problem, Robustness(**(vars(USUAL) | given)), seed):
        hand_count = len(group.hands)
        required = group.key in given or group.key == "held"
        without_friction = int(group.settles(coupling, friction=False).sum())
        at_rest = None
        if without_friction < hand_count:
            at_rest = int(group.settles(coupling, friction=True).sum())
        trials.append(UnmodelledTrial(group.key, group.value, required, hand_count, without_friction, at_rest))
    return tuple(trials)


def unmet_requirements(trials: tuple[UnmodelledTrial, ...], *, by_friction: bool) -> UnmetRequirements | None:
    """Return the requirements of [robustness] that are not met; None where all are."""
    unmet = []
    for trial in trials:
        at_rest = trial.at_rest_without_friction
        if by_friction and trial.at_rest is not None:
            at_rest = trial.at_rest
        if trial.asked and at_rest < trial.hands:
            unmet.append(UnmetRequirement(trial.key, trial.value, trial.hands - at_rest, trial.hands))
    return UnmetRequirements(tuple(unmet)) if unmet else None


@dataclass(frozen=True)
class PerturbedDevices(Document):
    """Result of a trial on perturbed devices; no claim is made for it."""

    keys: tuple[str, ...]
    trial: CouplingTrial  # of 16 hands, the corners first, each on every device
    unstable: int  # devices on which the linear loop is not stable, though hands may settle

    def document(self) -> dict[str, Any]:
        """Return JSON values."""
        values = {"share": PERTURBED_SHARE, "keys": [*self.keys], "linearly_unstable": self.unstable}
        return values | self.trial.counts_document()


def try_perturbed_devices(coupling: Coupling, seed: int = 0) -> PerturbedDevices | None:
    """Return a trial of hands on the perturbed devices with which the loop is the least stable; None if none."""
    devices, radii = least_stable_devices(coupling)
    if not devices:
        return None
    hands = people_of(coupling.problem.hands, FIRST, seed)
    each_on_all = hands.pick(np.repeat(np.arange(len(hands)), len(devices)))
    trial = try_on_devices(coupling, each_on_all, devices, seed)
    return PerturbedDevices(perturbed_keys(coupling.problem), trial, int((radii >= 1).sum()))


def least_stable_devices(coupling: Coupling, count: int = WORST_DEVICES) -> tuple[list[Device], FloatArray]:
    """Return the perturbed devices of the largest spectral radius over all hands and released, and these radii."""
    devices = perturbed_devices(coupling.problem)
    if not devices:
        return [], np.zeros(0)
    radii = perturbed_loops(coupling).closed.radius.reshape(len(devices), -1).max(axis=1)
    worst = np.argsort(-radii, kind="stable")[:count]
    return [devices[place] for place in worst], radii[worst]


def unstable_when_perturbed(coupling: Coupling) -> bool:
    """Return whether too many hands cannot settle on the least stable perturbed devices: no friction holds them."""
    if coupling.problem.device.coulomb_friction_n > 0 or not perturbed_devices(coupling.problem):
        return False
    radii = perturbed_loops(coupling).closed.radius.reshape(len(perturbed_devices(coupling.problem)), -1)
    worst = np.argsort(-radii.max(axis=1), kind="stable")[:WORST_DEVICES]
    return float((radii[worst] >= 1).mean()) > _FEW


def perturbed_loops(coupling: Coupling) -> OpenLoop:
    """Return the loops of a coupling on every perturbed device, with every corner of the hands and released."""
    return OpenLoop.around(perturbed_plants(coupling.problem), law_at_rest(coupling))
