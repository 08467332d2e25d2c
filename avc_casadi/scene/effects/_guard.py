"""A guard in the time domain against energy that the loop generates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

from avc_casadi.problem import Problem
from avc_casadi.runtime import GuardSettings, guard_step
from avc_casadi.scene.effects._base import SceneEffect, Station
from avc_casadi.scene.effects._step import insert
from avc_casadi.scene.loop import Tick


@dataclass(frozen=True)
class Guard(SceneEffect):
    """Watches the energy through the held force and acts where some is missing.

    Attributes:
        method: passivity-controller or energy-tank.
        settings: how far it may go.
    """

    kind: ClassVar[str] = "guard"
    station: ClassVar[Station] = Station.GUARD

    method: str
    settings: GuardSettings

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        """Limit the damper to the device's own damping."""
        del place
        return cls(table.method, GuardSettings(damping_limit_ns_per_m=problem.device.damping_ns_per_m))

    def sample(self, tick: Tick) -> None:
        """Replace the command."""
        if tick.command is None:
            return
        step = guard_step(self.method, tick.sample_time_s, self.settings)
        stored = tick.environment_energy_j + tick.coupling_energy_j
        outputs = insert(tick, "guard", step, [tick.command, tick.position, stored, tick.held_force()])
        tick.command, reserve = outputs
        tick.trace("guard_reserve_j", reserve)
