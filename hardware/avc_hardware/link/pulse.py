"""How far a pulse moves a device, against mass, damping and dry friction: how long it lasts, how weak it may be.

The pulse is one period of a sine. From rest, with t = omega time, speed u in F/(m omega), beta = damping/(m omega) and
phi = friction/F the way into the wall obeys

    u' = sin(t) - phi - beta u    from sin(t) = phi on, until u = 0

a linear equation: u is the sum of what answers the sine, what answers the friction, and what dies out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from avc_casadi.model.device import Device as DeclaredDevice

__all__ = ["LEAST_COUNTS", "Moved"]

# The way that a pulse shall make at the hand, and the counts of the encoder above which a device has moved.
_WAY_M, LEAST_COUNTS = 1e-3, 5
# A pulse is planned for so many times these counts; one that makes fewer than that however long it lasts is too weak.
_PLANNED, _ACCEPTED = 4, 2
_SHORTEST_S, _LONGEST_S = 0.02, 1.0
# What a pulse has beyond the dry friction moves the device: a fifth of it, which a little more friction leaves some of.
_OVER_FRICTION = 1.25
_TIMES, _HALVINGS = 1000, 50


def _most(nominal: float, stated: tuple[float, float] | None) -> float:
    return nominal if stated is None else max(nominal, *stated)


@dataclass(frozen=True)
class Moved:
    """What a pulse moves: the device as declared, each value at the end of its range that holds it back most.

    Attributes:
        mass_kg: what the hand moves.
        damping_ns_per_m: viscous.
        friction_n: dry.
        reach_m: how far the hand moves for a unit of the position: 1, or the radius of the handle of what turns.
    """

    mass_kg: float
    damping_ns_per_m: float
    friction_n: float
    reach_m: float = 1.0

    @classmethod
    def of(cls, declared: DeclaredDevice) -> Moved:
        """Return the upper end of each range, where one is stated."""
        ends = declared.range
        return cls(
            _most(declared.mass_kg, ends.mass_kg),
            _most(declared.damping_ns_per_m, ends.damping_ns_per_m),
            _most(declared.coulomb_friction_n, ends.coulomb_friction_n),
            declared.metres_per_unit,
        )

    def way_m(self, force_n: float, seconds: float) -> float:
        """Return how far a pulse moves it into the wall, from rest; 0 where the friction holds it."""
        if force_n <= self.friction_n:
            return 0.0
        rad_s = 2 * math.pi / seconds
        friction, damping = self.friction_n / force_n, self.damping_ns_per_m / (self.mass_kg * rad_s)
        start = math.asin(friction)
        since = np.linspace(0.0, 2 * math.pi - start, _TIMES)
        time = start + since
        left = np.exp(-damping * since)
        sine = damping * np.sin(time) - np.cos(time) - left * (damping * math.sin(start) - math.cos(start))
        dry = -np.expm1(-damping * since) / damping if damping > 0 else since
        speed = np.maximum(sine / (1 + damping**2) - friction * dry, 0.0)
        return force_n / (self.mass_kg * rad_s**2) * float(speed.mean() * since[-1])

    def seconds(self, force_n: float, metres_per_count: float) -> float:
        """Return how long a pulse lasts that makes the way, or the longest one."""
        wanted_m = max(_WAY_M / self.reach_m, _PLANNED * LEAST_COUNTS * metres_per_count)
        low, high = _SHORTEST_S, _LONGEST_S
        for _ in range(_HALVINGS):
            middle = math.sqrt(low * high)
            low, high = (low, middle) if self.way_m(force_n, middle) >= wanted_m else (middle, high)
        return high

    def least_n(self, metres_per_count: float) -> float:
        """Return the weakest force whose pulse is seen: above the friction, and far enough in the longest time.

        Args:
            metres_per_count: of the encoder; 0 asks for what the friction alone asks for.
        """
        above_friction_n = _OVER_FRICTION * self.friction_n
        wanted_m = _ACCEPTED * LEAST_COUNTS * metres_per_count

        def enough(force_n: float) -> bool:
            return self.way_m(force_n, _LONGEST_S) >= wanted_m

        if wanted_m == 0 or (above_friction_n > 0 and enough(above_friction_n)):
            return above_friction_n
        low, high = above_friction_n, max(2 * above_friction_n, 1e-6)
        while not enough(high):
            low, high = high, 2 * high
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            low, high = (low, middle) if enough(middle) else (middle, high)
        return high
