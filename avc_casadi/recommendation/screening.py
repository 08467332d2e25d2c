"""Screening hands: a subset that tries a coupling before all hands do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi.design.robust.uncertainty_set import assumed_devices
from avc_casadi.model.corners import device_corners, device_set, linear_values
from avc_casadi.model.hands import Hand, StylusHand
from avc_casadi.model.robustness import Robustness, unmodelled
from avc_casadi.simulation.population.operators import GRIPS, draw_population, people_of
from avc_casadi.simulation.population.settled import prepared_residual_speeds, residual_speeds

if TYPE_CHECKING:
    from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
    from avc_casadi.coupling import Coupling
    from avc_casadi.design.robust.cma_continuation import ResidualSpeed
    from avc_casadi.model.device import Device
    from avc_casadi.model.effects import Effect
    from avc_casadi.model.problem import Problem
    from avc_casadi.model.runtime import StateFeedback
    from avc_casadi.simulation.population.trial import Ends

# Devices at the corners of the ranges, devices within, and hands of each kind on every one.
_CORNERS, _WITHIN, _OF_EACH = 6, 2, 4
# Hands on each perturbed device: corners of [hands], and loose grips.
_OFF_FIRST, _OFF_LOOSE = 8, 60
BEYOND_HANDS = 60
"""Number of hands on each device with an unmodelled effect."""


@dataclass(frozen=True)
class Group:
    """Hands that press, tap, hold, strike and touch lightly.

    Attributes:
        people: the hands.
        device: theirs; None is that of the problem.
        effects: simulated beside those that the device declares.
        friction: whether the declared dry friction acts also where the screening leaves it out: some laws vibrate only
            with it.
    """

    people: Hand | StylusHand
    device: Device | None = None
    effects: tuple[Effect, ...] = ()
    friction: bool = False

    def pick(self, moving: BoolArray) -> Group:
        """Return a subset."""
        return replace(self, people=self.people.pick(np.flatnonzero(moving)))

    def residual_speeds(self, couplings: Sequence[Coupling], *, friction: bool) -> FloatArray:
        """Return residual speeds over the threshold of settling, shape (couplings, hands)."""
        return residual_speeds(couplings, self.people, **self._how(friction=friction))

    def ends(self, coupling: Coupling, *, friction: bool) -> Ends:
        """Return the evaluation of residual speeds for laws of one structure, stopping at the first unsettled hand."""
        return prepared_residual_speeds(coupling, self.people, racing=True, **self._how(friction=friction))

    def _how(self, *, friction: bool) -> dict[str, Any]:
        rough = friction or self.friction
        return {"friction": rough, "beyond": True, "device": self.device, "effects": self.effects}


@dataclass(frozen=True)
class Screening:
    """Groups of hands in stages: a later stage tries only laws with which all before it settle.

    Attributes:
        stages: the most discriminating first.
        friction: whether the declared dry friction may help.
        off: hands on perturbed devices, used where requested.
    """

    stages: tuple[tuple[Group, ...], ...]
    friction: bool
    off: tuple[Group, ...] = ()

    def and_off(self) -> Screening:
        """Return the stages with the perturbed devices as the last."""
        return Screening((*self.stages, self.off), self.friction)

    def only_off(self) -> Screening:
        """Return the perturbed devices as the only stage."""
        return Screening((self.off,), self.friction)

    def ends(self, coupling: Coupling) -> ResidualSpeed:
        """Return the evaluation of residual speeds for laws of one structure.

        Hands of a skipped stage are given the speeds of the stages before.
        """
        first, *later = ([group.ends(coupling, friction=self.friction) for group in stage] for stage in self.stages)

        def residual_speeds(laws: Sequence[StateFeedback]) -> FloatArray:
            found = _speeds(first, laws)
            for stage in later:
                more = np.resize(found.T, (sum(ends.people for ends in stage), len(laws))).T
                rest = np.flatnonzero((found < 1).all(axis=1)).tolist()
                if rest:
                    more[rest] = _speeds(stage, [laws[row] for row in rest])
                found = np.concatenate([found, more], axis=1)
            return found

        return residual_speeds


def _speeds(stage: list[Ends], laws: Sequence[StateFeedback]) -> FloatArray:
    return np.concatenate([ends(laws) for ends in stage], axis=1)


def elsewhere(device: Device, kinds: Sequence[Hand], seed: int) -> tuple[Group, ...]:
    """Return hands on devices of the declared ranges; none without ranges.

    A law has most effect on the lightest devices; of their corners those that differ most are taken. The confirming
    hands get other devices within the ranges, but may get the same corners, which are few.

    Args:
        device: with its ranges.
        kinds: of hands, some of each on every device.
        seed: of the first corner, and of the devices within.
    """
    corners = device_corners(device)
    if len(corners) == 1:
        return ()
    lightest = min(one.mass_kg for one in corners)
    light = np.array([place for place, one in enumerate(corners) if one.mass_kg == lightest])
    taken = _far_apart(light, np.random.default_rng(seed))
    within = device_set(device, draws=_WITHIN, seed=seed + 1)[len(corners) :]
    found = []
    for place, one in enumerate([*(corners[row] for row in taken), *within]):
        rows = np.arange(place * _OF_EACH, (place + 1) * _OF_EACH)
        found.append(Group(together(*(people.pick(rows % len(people)) for people in kinds)), one))
    return tuple(found)


def off_file(device: Device, corners: Hand, loose: Hand) -> tuple[Group, ...]:
    """Return hands on the lightest perturbed devices, where values have no declared range.

    No claim is made for these, and no stiffness is given up for them; but of laws for the same wall those are
    preferred with which they settle.

    Args:
        device: with its ranges, if it has any.
        corners: of the hands, and others.
        loose: loose grips.
    """
    others = [one for one in assumed_devices(device) if linear_values(one) != linear_values(device)]
    lightest = min((one.mass_kg for one in others), default=0.0)
    found = []
    for place, one in enumerate(one for one in others if one.mass_kg == lightest):
        rows = np.arange(place * _OFF_LOOSE, (place + 1) * _OFF_LOOSE) % len(loose)
        found.append(Group(together(corners.pick(slice(_OFF_FIRST)), loose.pick(rows)), one))
    return tuple(found)


def beyond_file(problem: Problem, asked: Robustness, people: Hand) -> tuple[Group, ...]:
    """Return hands on each device with an unmodelled effect.

    Args:
        problem: with its device.
        asked: the effects.
        people: the hands.
    """
    return tuple(Group(people, one.device, effects=one.effects) for one in unmodelled(problem.device, asked))


def held_otherwise(problem: Problem, count: int, seed: int) -> tuple[Group, ...]:
    """Return hands with the grip that the device is made for, where that is not the grip of [hands].

    Args:
        problem: with its device.
        count: how many.
        seed: of their draw.
    """
    device = problem.device
    if device.held == "grip":
        return ()
    return (Group(draw_population(GRIPS[device.held], count, seed).at_handle(device.metres_per_unit)),)


def required(problem: Problem, count: int, seed: int) -> tuple[Group, ...]:
    """Return the hands that must settle beside those of [hands]: with each effect of [robustness], by declared grip.

    Args:
        problem: with its device.
        count: how many of each.
        seed: of their draw.
    """
    people = people_of(problem.hands, count, seed)
    return (*beyond_file(problem, problem.robustness, people), *held_otherwise(problem, count, seed))


def _far_apart(corners: IndexArray, random: np.random.Generator) -> list[int]:
    """Choose corners of a cube, each as far as possible from those before; each bit of an index is a side."""
    taken = [int(random.choice(corners))]
    while len(taken) < min(_CORNERS, len(corners)):
        nearest = [min((int(one) ^ other).bit_count() for other in taken) for one in corners]
        taken.append(int(corners[int(np.argmax(nearest))]))
    return taken


def together(*kinds: Hand) -> Hand:
    """Return the concatenation of several sets of hands."""
    return Hand(*(np.concatenate([getattr(people, name) for people in kinds]) for name in vars(kinds[0])))
