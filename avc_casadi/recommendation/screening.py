"""Who tries a coupling before everybody does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi.design.robust.uncertainty_set import assumed_devices
from avc_casadi.model.corners import device_corners, device_set, linear_values
from avc_casadi.model.hands import Hand, StylusHand
from avc_casadi.model.robustness import Robustness, unmodelled
from avc_casadi.simulation.population.operators import HOLDING, draw_subjects
from avc_casadi.simulation.population.settled import ends_of, unrest

if TYPE_CHECKING:
    from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
    from avc_casadi.coupling import Coupling
    from avc_casadi.design.robust.cma_continuation import ResidualSpeed
    from avc_casadi.model.device import Device
    from avc_casadi.model.effects import Effect
    from avc_casadi.model.problem import Problem
    from avc_casadi.model.runtime import StateFeedback
    from avc_casadi.simulation.population.trial import Ends

# Where the device has ranges, so many at their corners and so many within are tried, by so many of each kind of people.
_CORNERS, _WITHIN, _OF_EACH = 6, 2, 4
# On every device that is a little off its file so many of each kind of people try a law: corners of the hands, and
# of those who hold on loosely some.
_OFF_FIRST, _OFF_LOOSE = 8, 60
BEYOND_HANDS = 60
"""So many hands try a coupling on each device that the file does not tell of."""
SURELY = 0.7
"""Who ends at less than this share of the speed below which a hand is at rest is so in another simulation too."""


@dataclass(frozen=True)
class Group:
    """People who press, tap, hold, strike and touch lightly.

    Attributes:
        people: who they are.
        device: on which; None is that of the problem.
        effects: what is simulated beside what the device declares.
        slow: what they end at when they rest, over the speed below which a hand is at rest.
    """

    people: Hand | StylusHand
    device: Device | None = None
    slow: float = 1.0
    effects: tuple[Effect, ...] = ()

    def pick(self, moving: BoolArray) -> Group:
        """Return some of them."""
        return replace(self, people=self.people.pick(np.flatnonzero(moving)))

    def unrest(self, couplings: Sequence[Coupling], *, friction: bool) -> FloatArray:
        """Return how fast they end with couplings, over what they rest at, shape (couplings, people)."""
        how: dict[str, Any] = {"friction": friction, "beyond": True, "device": self.device, "effects": self.effects}
        return unrest(couplings, self.people, **how) / self.slow

    def ends(self, coupling: Coupling, *, friction: bool) -> _Asked:
        """Prepare to ask that with laws of the structure of one, until somebody moves."""
        how: dict[str, Any] = {"friction": friction, "beyond": True, "device": self.device, "effects": self.effects}
        return _Asked(ends_of(coupling, self.people, racing=True, **how), self.slow)


@dataclass(frozen=True)
class _Asked:
    """A group who are ready to try laws of one structure."""

    ends: Ends
    slow: float

    @property
    def people(self) -> int:
        """How many they are."""
        return self.ends.people

    def __call__(self, laws: Sequence[StateFeedback]) -> FloatArray:
        """Return how fast they end, over what they rest at, shape (laws, people)."""
        return self.ends(laws) / self.slow


@dataclass(frozen=True)
class Screening:
    """Groups of people in stages: who comes later only tries what all before rest with.

    Attributes:
        stages: with the first of which somebody is likely to move, if anybody does.
        friction: whether the declared dry friction may help.
        off: who try a law on devices that are a little off their file, where that is asked for.
    """

    stages: tuple[tuple[Group, ...], ...]
    friction: bool
    off: tuple[Group, ...] = ()

    def and_off(self) -> Screening:
        """Return them with those on devices that are a little off their file as the last."""
        return Screening((*self.stages, self.off), self.friction)

    def only_off(self) -> Screening:
        """Return those on devices that are a little off their file alone."""
        return Screening((self.off,), self.friction)

    def ends(self, coupling: Coupling) -> ResidualSpeed:
        """Prepare to ask how fast they end with laws of the structure of one.

        Who is not asked is taken to end as those before.
        """
        first, *later = ([group.ends(coupling, friction=self.friction) for group in stage] for stage in self.stages)

        def unrest(laws: Sequence[StateFeedback]) -> FloatArray:
            found = _speeds(first, laws)
            for stage in later:
                more = np.resize(found.T, (sum(ends.people for ends in stage), len(laws))).T
                rest = np.flatnonzero((found < 1).all(axis=1)).tolist()
                if rest:
                    more[rest] = _speeds(stage, [laws[row] for row in rest])
                found = np.concatenate([found, more], axis=1)
            return found

        return unrest


def _speeds(stage: list[_Asked], laws: Sequence[StateFeedback]) -> FloatArray:
    return np.concatenate([ends(laws) for ends in stage], axis=1)


def elsewhere(device: Device, kinds: Sequence[Hand], seed: int) -> tuple[Group, ...]:
    """Deal people out among devices of the declared ranges; none where there are no ranges.

    The lightest ones are where a law that is made for a heavier one does most; of their corners those are taken that
    differ most. Who confirms a coupling has other devices within, and may have the same corners: there are few.

    Args:
        device: with its ranges.
        kinds: of people, of each of which there are some on every device.
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
    """Deal people out among devices that are a little off their file where that does not say how well it is known.

    Nothing is promised of these, and on the lightest, where a law does most, nothing stiffer is given up for them; but
    of laws for the same wall those are better with which they surely rest.

    Args:
        device: with its ranges, if it has any.
        corners: of the hands, and others.
        loose: who hold on loosely.
    """
    others = [one for one in assumed_devices(device) if linear_values(one) != linear_values(device)]
    lightest = min((one.mass_kg for one in others), default=0.0)
    found = []
    for place, one in enumerate(one for one in others if one.mass_kg == lightest):
        rows = np.arange(place * _OFF_LOOSE, (place + 1) * _OFF_LOOSE) % len(loose)
        found.append(Group(together(corners.pick(slice(_OFF_FIRST)), loose.pick(rows)), one, SURELY))
    return tuple(found)


def beyond_file(problem: Problem, asked: Robustness, people: Hand) -> tuple[Group, ...]:
    """Let people try a coupling on each device that its file does not tell of.

    Args:
        problem: with its device.
        asked: which these are.
        people: who they are.
    """
    return tuple(Group(people, one.device, effects=one.effects) for one in unmodelled(problem.device, asked))


def held_otherwise(problem: Problem, count: int, seed: int) -> tuple[Group, ...]:
    """Return people who hold the device as it is made for, where that is not as [hands] says.

    Args:
        problem: with its device.
        count: how many.
        seed: of their draw.
    """
    device = problem.device
    if device.held == "grip":
        return ()
    return (Group(draw_subjects(HOLDING[device.held], count, seed).at_handle(device.metres_per_unit)),)


def _far_apart(corners: IndexArray, random: np.random.Generator) -> list[int]:
    """Take some of the corners of a cube, each as far as can be from those before; a bit of its number is a side."""
    taken = [int(random.choice(corners))]
    while len(taken) < min(_CORNERS, len(corners)):
        nearest = [min((int(one) ^ other).bit_count() for other in taken) for one in corners]
        taken.append(int(corners[int(np.argmax(nearest))]))
    return taken


def together(*kinds: Hand) -> Hand:
    """Return all of some people."""
    return Hand(*(np.concatenate([getattr(people, name) for people in kinds]) for name in vars(kinds[0])))
