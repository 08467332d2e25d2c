"""The amplifier's bandwidth: the force follows the command as a lag or as a current loop does."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Self

from avc_casadi.model.device import CURRENT_LOOP_DAMPING_RATIO
from avc_casadi.model.effects import AmplifierEffect, SaturationEffect
from avc_casadi.model.plant import Plant
from avc_casadi.model.problem import Problem
from avc_casadi.simulation.effects.base import SceneEffect, declared_number
from avc_casadi.simulation.tick import Tick


@dataclass(frozen=True)
class Saturation(SceneEffect, keys=SaturationEffect, rank=200, declared={"force_n": "max_force_n"}):
    """Saturation of the commanded force."""

    force_n: float

    def sample(self, tick: Tick) -> None:
        """Clip."""
        import casadi as ca  # noqa: PLC0415

        if tick.command is not None:
            tick.command = ca.fmin(ca.fmax(tick.command, -self.force_n), self.force_n)


@dataclass(frozen=True)
class Amplifier(SceneEffect, keys=AmplifierEffect, rank=230, scene_alone=True):
    """Lag between the command and the force."""

    bandwidth_hz: float
    order: int = 1
    damping_ratio: float = CURRENT_LOOP_DAMPING_RATIO

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        """Build it; missing numbers are taken from the device."""
        device, key = problem.device, "amplifier_bandwidth_hz"
        bandwidth = declared_number(table.bandwidth_hz, problem, f"{place}.bandwidth_hz", key)
        ratio = table.damping_ratio or device.amplifier_damping_ratio
        return cls(bandwidth, table.order or device.amplifier_order, ratio)

    def mechanics(self, plant: Plant) -> None:
        """Make the force a state of the continuous part."""
        plant.actuator_rate_per_s = 2 * math.pi * self.bandwidth_hz
        plant.actuator_order = self.order
        plant.actuator_damping_ratio = self.damping_ratio
