"""An encoder: the position in whole steps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

from avc_casadi.problem import Problem
from avc_casadi.scene.effects._base import SceneEffect, Station, required_number
from avc_casadi.scene.loop import Tick


@dataclass(frozen=True)
class Encoder(SceneEffect):
    """Rounds the position to the nearest step.

    Attributes:
        resolution_m: length of a step.
    """

    kind: ClassVar[str] = "encoder"
    station: ClassVar[Station] = Station.SENSING

    resolution_m: float

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        """Take what is left out from the device."""
        source, default = "device.encoder_resolution_m", problem.device.encoder_resolution_m
        key = "resolution_m"
        return cls(required_number(table.resolution_m, default, key=key, place=place, problem=problem, source=source))

    def sample(self, tick: Tick) -> None:
        """Quantise."""
        import casadi as ca  # noqa: PLC0415

        tick.position = self.resolution_m * ca.floor(tick.position / self.resolution_m + 0.5)
