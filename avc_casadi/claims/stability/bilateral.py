"""Stability of two devices coupled over a link: spectral radius with hands, environments, delays and clocks."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._errors import InputError
from avc_casadi._util.arrays import ComplexArray, FloatArray, IndexArray
from avc_casadi.claims.stability.periodic import PeriodicLoops, leading
from avc_casadi.claims.stability.worst_point import Box, Ranges, hand_at, hand_boxes, held_plant, worst_point
from avc_casadi.model.bilateral_loop import BilateralLoop, link_clocks
from avc_casadi.model.corners import LINEAR_KEYS, device_corners, device_ranges, linear_values
from avc_casadi.model.hands import Hand, hand_corners, with_released
from avc_casadi.model.sampled_plant import sampled_plant

if TYPE_CHECKING:
    from avc_casadi.model.bilateral_loop import LinkClock
    from avc_casadi.model.device import Device
    from avc_casadi.model.follower import Follower
    from avc_casadi.model.lifted_loop import ToolGains
    from avc_casadi.model.problem import Problem

# Number of stiffnesses between free and the stiffest environment, spaced logarithmically.
_ENVIRONMENTS = 4
# Damping of a contact without a declared one.
_CONTACT_DAMPING_RATIO = 0.1
# Stiffest non-rigid environment, and softest, as shares of the follower's m/T^2: no effect beyond these.
_STIFFEST, _SOFTEST = 1.0, 1e-5
# Number of delays of each way that are searched in a range of them.
_DELAYS = 3


@dataclass(frozen=True)
class BilateralCase:
    """One loop: the hand on the leader, the environment of the follower, the delays of the link."""

    hand: dict[str, float]
    environment_n_per_m: float
    leader: dict[str, float]
    follower: dict[str, float]
    delays_s: tuple[float, float]


class BilateralLoops(PeriodicLoops):
    """All loops of a problem with [follower]: hands, released, environments, both devices, delays, clocks.

    Args:
        problem: with [follower].

    Attributes:
        patterns: the loop of each corner, delay and clock, then that of each worst point inside the ranges.
        follower: the [follower].
        hands: corners of [hands], the leader released last.
        environments_n_per_m: stiffnesses at the follower, in the leader's units.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.follower = follower = required_follower(problem)
        self.hands = with_released(hand_corners(problem.hands))
        stiffness, damping = environments(follower)
        self.environments_n_per_m = stiffness
        touched = Hand(np.zeros(len(stiffness)), damping, np.where(np.isinf(stiffness), 0.0, stiffness))
        self.patterns: list[BilateralLoop] = []
        self._about: list[tuple[Device, Device, tuple[float, float]]] = []
        leaders, followers = (device_corners(one, LINEAR_KEYS) for one in (problem.device, follower.at_leader()))
        for leader, other in product(leaders, followers):
            plants = sampled_plant(leader, self.hands), sampled_plant(other, touched)
            for delays_s in follower.delays_s:
                for clock in link_clocks(leader.sample_time_s, other.sample_time_s, *delays_s):
                    loop = BilateralLoop(*plants, stiffness, damping, clock, follower.architecture, follower.force)
                    self.patterns.append(loop)
                    self._about.append((leader, other, delays_s))
        self._inside: list[BilateralCase] = []
        super().__init__()

    def __len__(self) -> int:
        return len(self._about) * len(self.environments_n_per_m) * len(self.hands) + len(self._inside)

    def matrices(self, place: int, gains: ToolGains) -> FloatArray:
        """Return the monodromy matrices over one period of both clocks, shape (loops, size, size)."""
        loop = self.patterns[place]
        return loop.monodromy(gains).reshape(-1, loop.size, loop.size)

    def radius(self, gains: ToolGains) -> tuple[float, BilateralCase]:
        """Return the largest spectral radius, per sample of the leader, and its loop, after a search of the ranges."""
        self.search(gains)
        place, row, radius = self.worst(gains)
        samples = sum(event[0] for event in self.patterns[place].clock.events)
        return radius ** (1 / samples), self._case(place, row)

    def add_worst(self, gains: ToolGains, known: float) -> int:
        """Search each clock and delay, free and in contact, held and released, over all other ranges."""
        before, times = len(self._inside), (self.problem.device.sample_time_s, self.follower.sample_time_s)
        for delays_s in _delays_s(self.follower):
            contacts, hands = _contact_ranges_n_per_m(self.follower), hand_boxes(self.problem)
            for clock, contact, hand, slow in product(link_clocks(*times, *delays_s), contacts, hands, (True, False)):
                growth, loop, case = _Ranges(self.problem, clock, delays_s, contact, hand).worst(gains, slow=slow)
                if growth > known:
                    self.patterns.append(loop)
                    self._inside.append(case)
        return len(self._inside) - before

    def _case(self, place: int, row: int) -> BilateralCase:
        if place >= len(self._about):
            return self._inside[place - len(self._about)]
        hand, environment = np.unravel_index(row, (len(self.hands), len(self.environments_n_per_m)))
        leader, other, delays_s = self._about[place]
        return BilateralCase(
            self.hands.values(int(hand)),
            float(self.environments_n_per_m[environment]),
            linear_values(leader),
            linear_values(other),
            delays_s,
        )


@dataclass(frozen=True)
class _Ranges:
    """The ranges left where clock, delays and the kind of contact are set, and a hand holds the leader or none."""

    problem: Problem
    clock: LinkClock
    delays_s: tuple[float, float]
    contact: tuple[float, float]
    hand: Ranges

    def worst(self, gains: ToolGains, *, slow: bool) -> tuple[float, BilateralLoop, BilateralCase]:
        """Return the largest growth that a search finds, its loop and what that is; slow: of all modes."""
        leader, other = self.problem.device, required_follower(self.problem).at_leader()
        of_other = {f"follower.{key}": ends for key, ends in device_ranges(other, LINEAR_KEYS).items()}
        box = Box({**self.hand, **device_ranges(leader, LINEAR_KEYS), **of_other, **self._of_contact()})

        def growth(_: IndexArray, places: FloatArray) -> ComplexArray:
            loop = self._loops(box.values(places))[0]
            return leading(loop.monodromy(gains).reshape(-1, loop.size, loop.size), loop, slow=slow)

        place, value = worst_point(growth, len(box.sides))
        found = box.values(place[:, None])
        loop, environment, devices = self._loops(found)
        ends = linear_values(devices[0]), linear_values(devices[1])
        return abs(value), loop, BilateralCase(hand_at(found, 0), environment, *ends, self.delays_s)

    def _of_contact(self) -> Ranges:
        """Return the ranges of the environment, in the follower's units."""
        follower, springs = required_follower(self.problem), self.contact[0] > 0 and self.contact[1] < math.inf
        found = {"contact.stiffness_n_per_m": self.contact}
        if springs and follower.contact_damping_ns_per_m is not None:
            found["contact.damping_ns_per_m"] = follower.contact_damping_ns_per_m
        return found

    def _loops(self, values: dict[str, FloatArray]) -> tuple[BilateralLoop, float, tuple[Device, Device]]:
        """Return the loop of m points; the environment and both devices of the first."""
        follower = required_follower(self.problem)
        contact = values["contact.stiffness_n_per_m"]
        dampers = values.get("contact.damping_ns_per_m")
        if dampers is None:
            each = [contact_dampers_ns_per_m(follower, one)[0] if 0 < one < math.inf else 0.0 for one in contact]
            dampers = np.array(each)
        stiffness, damping = follower.scale * contact, follower.scale * dampers
        touched = {
            "hand.mass_kg": np.zeros(len(contact)),
            "hand.damping_ns_per_m": damping,
            "hand.stiffness_n_per_m": np.where(np.isinf(stiffness), 0.0, stiffness),
        }
        inner = {key.removeprefix("follower."): value for key, value in values.items() if key.startswith("follower.")}
        leaders, leader = held_plant(self.problem.device, values)
        others, other = held_plant(follower.at_leader(), {**inner, **touched})
        loop = BilateralLoop(
            leader, other, stiffness, damping, self.clock, follower.architecture, follower.force, paired=True
        )
        return loop, float(stiffness[0]), (leaders[0], others[0])


def required_follower(problem: Problem) -> Follower:
    """Return the [follower] of a problem.

    Raises:
        InputError: it has no [follower].
    """
    if problem.follower is None:
        raise InputError.of(
            "is missing; allowed: a table with the keys of [device] and delay_s",
            file=problem.name or "problem",
            key="follower",
        )
    return problem.follower


def environments(follower: Follower) -> tuple[FloatArray, FloatArray]:
    """Return stiffness and damping of the follower's environments, in the leader's units: free, springs, rigid.

    Args:
        follower: with its ranges.
    """
    low, top = _springs_n_per_m(follower)
    springs = np.geomspace(low, top, _ENVIRONMENTS).tolist() if low < top else [top] if top > 0 else []
    found = [(0.0, 0.0)]
    found += [(one, damper) for one in springs for damper in contact_dampers_ns_per_m(follower, one)]
    found += [(math.inf, 0.0)] if follower.rigid else []
    stiffness, damping = (follower.scale * np.array(column) for column in zip(*found, strict=True))
    return stiffness, damping


def contact_dampers_ns_per_m(follower: Follower, stiffness_n_per_m: float) -> list[float]:
    """Return the dampers in parallel with a contact spring, in the follower's units.

    Args:
        follower: with the range.
        stiffness_n_per_m: of the spring.
    """
    if follower.contact_damping_ns_per_m is not None:
        return sorted(set(follower.contact_damping_ns_per_m))
    return [2 * _CONTACT_DAMPING_RATIO * math.sqrt(stiffness_n_per_m * follower.mass_kg)]


def _contact_ranges_n_per_m(follower: Follower) -> list[tuple[float, float]]:
    """Return the ranges of environments that are searched, in the follower's units: free, springs, rigid."""
    low, top = _springs_n_per_m(follower)
    springs = [(min(low, top), top)] if top > 0 else []
    return [(0.0, 0.0), *springs, *([(math.inf, math.inf)] if follower.rigid else [])]


def _springs_n_per_m(follower: Follower) -> tuple[float, float]:
    """Return the softest and the stiffest environment that has any effect and is not rigid."""
    lowest, highest = follower.contact_stiffness_n_per_m
    unit = follower.mass_kg / follower.sample_time_s**2
    return max(lowest, _SOFTEST * unit), min(highest, _STIFFEST * unit)


def _delays_s(follower: Follower) -> list[tuple[float, float]]:
    """Return the delays that are searched: the ends of both ranges and some between."""
    ways = (follower.delay_s, follower.return_delay_s or follower.delay_s)
    each = [np.linspace(*way, _DELAYS).tolist() if way[1] > way[0] else [way[0]] for way in ways]
    return list(product(*each))
