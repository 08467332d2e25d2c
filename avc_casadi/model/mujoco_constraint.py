"""Stiffness of MuJoCo's soft constraints in N/m; MuJoCo states welds and contacts by time constants and impedances.

A constraint that is violated by r lets its point accelerate by a = (1 - d) a_0 - d (b v + k r), a_0 without it
(MuJoCo's documentation, Computation, "Constraint model", and Modeling, "Solver parameters"). For a point of the
effective mass m that is a spring of m k d/(1 - d) and a damper of m b d/(1 - d), towards which every other force has
the mass m/(1 - d): both grow with the mass, and the tool becomes heavier by 1/(1 - d).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

# With it the tool is a thousandth heavier, and spring and damper act nearly as a force.
SOFT_IMPEDANCE = 1e-3


@dataclass(frozen=True)
class MujocoConstraint:
    """`solref` and `solimp` of a constraint; the defaults are MuJoCo's own of contacts and welds."""

    solref: tuple[float, float] = (0.02, 1.0)
    solimp: tuple[float, float, float, float, float] = (0.9, 0.95, 0.001, 0.5, 2.0)

    @classmethod
    def of(
        cls, stiffness_n_per_m: float, damping_ns_per_m: float, mass_kg: float, impedance: float = SOFT_IMPEDANCE
    ) -> MujocoConstraint:
        """Return the constraint that is a spring and a damper for a tool of some mass, whatever the load."""
        share = (1 - impedance) / mass_kg
        return cls((-stiffness_n_per_m * share, -damping_ns_per_m * share), (impedance, impedance, 0.001, 0.5, 2.0))

    def impedance(self, violation_m: float) -> float:
        """Return d at a violation r."""
        first, last, width, midpoint, power = self.solimp
        share = min(abs(violation_m) / width, 1.0)
        if share <= midpoint:
            share = midpoint * math.pow(share / midpoint, power)
        else:
            share = 1 - (1 - midpoint) * math.pow((1 - share) / (1 - midpoint), power)
        return first + share * (last - first)

    def force_n(self, mass_kg: float, violation_m: float) -> float:
        """Return the static force on a point of some mass at a violation."""
        d, last, (first, second) = self.impedance(violation_m), self.solimp[1], self.solref
        k = 1 / (last * first * second) ** 2 if first > 0 else -first / last**2
        # k is d times as large at small r.
        return mass_kg * d * d * k * violation_m / (1 - d)

    def stiffness_n_per_m(self, mass_kg: float, load_n: float) -> float:
        """Return static load over violation for a point of some mass."""
        low, high = 0.0, 1e-6
        while self.force_n(mass_kg, high) < load_n:
            low, high = high, 2 * high
        for _ in range(100):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self.force_n(mass_kg, middle) < load_n else (low, middle)
        return load_n / high
