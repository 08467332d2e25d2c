"""A hand on a stylus: grip, mass of the hand, arm (Fu and Cavusoglu 2012)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

from numpy.typing import ArrayLike

from avc_casadi.loop import TARGET, Plant
from avc_casadi.problem import Problem
from avc_casadi.scene.effects._base import SceneEffect, Station, settled

_BODY = "hand"


@dataclass(frozen=True)
class StylusHand(SceneEffect):
    """Tip -(k1, b1)- mass -(k2, b2)- target; arrays stand for many hands.

    Attributes:
        mass_kg: mass of the hand.
        grip_damping_ns_per_m: b1.
        grip_stiffness_n_per_m: k1.
        arm_damping_ns_per_m: b2.
        arm_stiffness_n_per_m: k2.
    """

    kind: ClassVar[str] = "stylus-hand"
    station: ClassVar[Station] = Station.HAND

    mass_kg: ArrayLike
    grip_damping_ns_per_m: ArrayLike
    grip_stiffness_n_per_m: ArrayLike
    arm_damping_ns_per_m: ArrayLike
    arm_stiffness_n_per_m: ArrayLike

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        """Take the table as it stands; the hand needs a mass."""
        mass = settled(table.mass_kg, None, key="mass_kg", place=place, problem=problem, source="")
        return cls(
            mass,
            table.grip_damping_ns_per_m,
            table.grip_stiffness_n_per_m,
            table.arm_damping_ns_per_m,
            table.arm_stiffness_n_per_m,
        )

    def mechanics(self, plant: Plant) -> None:
        """Add the hand as a body between the device and the target."""
        plant.add_mass(_BODY, self.mass_kg)
        plant.join(plant.grip, _BODY, self.grip_stiffness_n_per_m, self.grip_damping_ns_per_m)
        plant.join(_BODY, TARGET, self.arm_stiffness_n_per_m, self.arm_damping_ns_per_m)
