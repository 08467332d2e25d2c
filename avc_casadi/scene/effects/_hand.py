"""A hand that holds the device: a mass, and a spring and a damper towards its moving target."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

from numpy.typing import ArrayLike

from avc_casadi.loop import TARGET, Plant
from avc_casadi.problem import Problem
from avc_casadi.scene.effects._base import SceneEffect, Station


@dataclass(frozen=True)
class Hand(SceneEffect):
    """Mass moving with the device, spring and damper to the target; arrays stand for many hands.

    Attributes:
        mass_kg: m_h.
        damping_ns_per_m: b_h.
        stiffness_n_per_m: k_h.
    """

    kind: ClassVar[str] = "hand"
    station: ClassVar[Station] = Station.HAND

    mass_kg: ArrayLike
    damping_ns_per_m: ArrayLike
    stiffness_n_per_m: ArrayLike

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:  # noqa: ARG003
        """Take what is left out from the middle of the problem's set of hands."""
        return cls(
            *(
                sum(getattr(problem.hands, key)) / 2 if getattr(table, key) is None else getattr(table, key)
                for key in ("mass_kg", "damping_ns_per_m", "stiffness_n_per_m")
            )
        )

    def mechanics(self, plant: Plant) -> None:
        """Add the mass to the body that the hand holds, and join that to the target."""
        plant.add_mass(plant.grip, self.mass_kg)
        plant.join(plant.grip, TARGET, self.stiffness_n_per_m, self.damping_ns_per_m)
