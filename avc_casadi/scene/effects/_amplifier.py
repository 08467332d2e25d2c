"""The amplifier's bandwidth: the force follows the command with a first-order lag."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar, Self

from avc_casadi.loop import Plant
from avc_casadi.problem import Problem
from avc_casadi.scene.effects._base import SceneEffect, Station


@dataclass(frozen=True)
class Amplifier(SceneEffect):
    """First-order lag between the command and the force.

    Attributes:
        bandwidth_hz: its corner frequency.
    """

    kind: ClassVar[str] = "amplifier"
    station: ClassVar[Station] = Station.ACTUATION

    bandwidth_hz: float

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:  # noqa: ARG003
        """Take the table."""
        return cls(table.bandwidth_hz)

    def mechanics(self, plant: Plant) -> None:
        """Make the force a state of the continuous part."""
        plant.actuator_rate_per_s = 2 * math.pi * self.bandwidth_hz
