"""The amplifier's bandwidth: the force follows the command as a lag or as a current loop does."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar, Self

from avc_casadi.loop import Plant
from avc_casadi.problem import CURRENT_LOOP_DAMPING_RATIO, Problem
from avc_casadi.scene.effects._base import SceneEffect, Station, required_number


@dataclass(frozen=True)
class Amplifier(SceneEffect):
    """Lag between the command and the force.

    Attributes:
        bandwidth_hz: its corner frequency.
        order: 1, or 2 for a current loop.
        damping_ratio: of a current loop.
    """

    kind: ClassVar[str] = "amplifier"
    station: ClassVar[Station] = Station.ACTUATION

    bandwidth_hz: float
    order: int = 1
    damping_ratio: float = CURRENT_LOOP_DAMPING_RATIO

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        """Take what is left out from the device."""
        device, key, source = problem.device, "bandwidth_hz", "device.amplifier_bandwidth_hz"
        default = device.amplifier_bandwidth_hz
        bandwidth = required_number(table.bandwidth_hz, default, key=key, place=place, problem=problem, source=source)
        ratio = table.damping_ratio or device.amplifier_damping_ratio
        return cls(bandwidth, table.order or device.amplifier_order, ratio)

    def mechanics(self, plant: Plant) -> None:
        """Make the force a state of the continuous part."""
        plant.actuator_rate_per_s = 2 * math.pi * self.bandwidth_hz
        plant.actuator_order = self.order
        plant.actuator_damping_ratio = self.damping_ratio
