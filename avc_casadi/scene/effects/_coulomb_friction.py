"""Dry friction between device and ground, with true sticking."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

from avc_casadi.problem import Problem
from avc_casadi.scene.effects._base import SceneEffect, Station, required_number


@dataclass(frozen=True)
class CoulombFriction(SceneEffect):
    """A force of constant size against the velocity; at rest, whatever holds the device up to that size.

    Attributes:
        force_n: its size.
    """

    kind: ClassVar[str] = "coulomb-friction"
    station: ClassVar[Station] = Station.MECHANICS

    force_n: float

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        """Take what is left out from the device."""
        source, default = "device.coulomb_friction_n", problem.device.coulomb_friction_n
        return cls(required_number(table.force_n, default, key="force_n", place=place, problem=problem, source=source))

    @property
    def friction_n(self) -> float:
        """Its size."""
        return self.force_n
