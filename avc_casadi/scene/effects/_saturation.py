"""The largest force of the actuator."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

from avc_casadi.problem import Problem
from avc_casadi.scene.effects._base import SceneEffect, Station, required_number
from avc_casadi.scene.loop import Tick


@dataclass(frozen=True)
class Saturation(SceneEffect):
    """Clips the command.

    Attributes:
        force_n: largest force either way.
    """

    kind: ClassVar[str] = "saturation"
    station: ClassVar[Station] = Station.ACTUATION

    force_n: float

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        """Take what is left out from the device."""
        source, default = "device.max_force_n", problem.device.max_force_n
        return cls(required_number(table.force_n, default, key="force_n", place=place, problem=problem, source=source))

    def sample(self, tick: Tick) -> None:
        """Clip."""
        import casadi as ca  # noqa: PLC0415

        if tick.command is not None:
            tick.command = ca.fmin(ca.fmax(tick.command, -self.force_n), self.force_n)
