"""Stability of two devices coupled over a link: spectral radius with hands, environments, delays and clocks."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._errors import InputError
from avc_casadi.claims.stability.periodic import PeriodicLoops
from avc_casadi.model.bilateral_loop import BilateralLoop, link_clocks
from avc_casadi.model.corners import LINEAR_KEYS, device_corners
from avc_casadi.model.hands import Hand, hand_corners, with_released
from avc_casadi.model.sampled_plant import sampled_plant

if TYPE_CHECKING:
    from avc_casadi._util.arrays import FloatArray
    from avc_casadi.model.follower import Follower
    from avc_casadi.model.lifted_loop import ToolGains
    from avc_casadi.model.problem import Problem

# Number of stiffnesses between free and the stiffest environment, spaced logarithmically.
_ENVIRONMENTS = 4
# Damping of a contact without a declared one.
_CONTACT_DAMPING_RATIO = 0.1
# Stiffest non-rigid environment, and softest, as shares of the follower's m/T^2: no effect beyond these.
_STIFFEST, _SOFTEST = 1.0, 1e-5


@dataclass(frozen=True)
class BilateralCase:
    """One loop: the hand on the leader, the environment of the follower, the delays of the link.

    Attributes:
        hand: its parameters; all 0 for the leader released.
        environment_n_per_m: stiffness at the follower, in the leader's units; infinite where it is rigid.
        device: number of the corner of both devices.
        delays_s: to the follower and back.
    """

    hand: dict[str, float]
    environment_n_per_m: float
    device: int
    delays_s: tuple[float, float]


class BilateralLoops(PeriodicLoops):
    """All loops of a problem with [follower]: hands, released, environments, corners of both devices, delays, clocks.

    Args:
        problem: with [follower].

    Attributes:
        patterns: the loop of each corner, delay and clock.
        follower: the [follower].
        hands: corners of [hands], the leader released last.
        environments_n_per_m: stiffnesses at the follower, in the leader's units.
    """

    def __init__(self, problem: Problem) -> None:
        self.follower = follower = required_follower(problem)
        self.hands = with_released(hand_corners(problem.hands))
        stiffness, damping = environments(follower)
        self.environments_n_per_m = stiffness
        touched = Hand(np.zeros(len(stiffness)), damping, np.where(np.isinf(stiffness), 0.0, stiffness))
        self.patterns: list[BilateralLoop] = []
        self._about: list[tuple[int, tuple[float, float]]] = []
        leaders, followers = (device_corners(one, LINEAR_KEYS) for one in (problem.device, follower.at_leader()))
        pairs = [(one, other) for one in leaders for other in followers]
        for number, (leader, other) in enumerate(pairs):
            plants = sampled_plant(leader, self.hands), sampled_plant(other, touched)
            for delays_s in follower.delays_s:
                for clock in link_clocks(leader.sample_time_s, other.sample_time_s, *delays_s):
                    loop = BilateralLoop(*plants, stiffness, damping, clock, follower.architecture, follower.force)
                    self.patterns.append(loop)
                    self._about.append((number, delays_s))
        super().__init__()

    def __len__(self) -> int:
        return len(self.patterns) * len(self.environments_n_per_m) * len(self.hands)

    def matrices(self, place: int, gains: ToolGains) -> FloatArray:
        """Return the monodromy matrices over one period of both clocks, shape (loops, size, size)."""
        loop = self.patterns[place]
        return loop.monodromy(gains).reshape(-1, loop.size, loop.size)

    def radius(self, gains: ToolGains) -> tuple[float, BilateralCase]:
        """Return the largest spectral radius, per sample of the leader, and its loop."""
        place, row, radius = self.worst(gains)
        hand, environment = np.unravel_index(row, (len(self.hands), len(self.environments_n_per_m)))
        number, delays_s = self._about[place]
        samples = sum(event[0] for event in self.patterns[place].clock.events)
        case = BilateralCase(
            self.hands.values(int(hand)), float(self.environments_n_per_m[environment]), number, delays_s
        )
        return radius ** (1 / samples), case


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
    lowest, highest = follower.contact_stiffness_n_per_m
    unit = follower.mass_kg / follower.sample_time_s**2
    top = min(highest, _STIFFEST * unit)
    low = max(lowest, _SOFTEST * unit)
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
