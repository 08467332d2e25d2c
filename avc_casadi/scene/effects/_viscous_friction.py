"""Viscous friction beyond the damping of the device model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

from avc_casadi.loop import DEVICE, GROUND, Plant
from avc_casadi.problem import Problem
from avc_casadi.scene.effects._base import SceneEffect, Station, required_number


@dataclass(frozen=True)
class ViscousFriction(SceneEffect):
    """A damper between device and ground, in addition to ``device.damping_ns_per_m``.

    Attributes:
        damping_ns_per_m: its damping.
    """

    kind: ClassVar[str] = "viscous-friction"
    station: ClassVar[Station] = Station.MECHANICS

    damping_ns_per_m: float

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        """Take the table; what the device model has already is not taken twice."""
        key = "damping_ns_per_m"
        return cls(required_number(table.damping_ns_per_m, None, key=key, place=place, problem=problem, source=""))

    def mechanics(self, plant: Plant) -> None:
        """Add the damper."""
        plant.join(DEVICE, GROUND, 0.0, self.damping_ns_per_m)
