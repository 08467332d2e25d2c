"""An encoder: the position in whole steps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

from avc_casadi._errors import Fault, InputError
from avc_casadi.loop import DEVICE, HANDLE
from avc_casadi.problem import Problem, scene_effects
from avc_casadi.scene.effects._base import SceneEffect, Station, required_number
from avc_casadi.scene.loop import Tick


@dataclass(frozen=True)
class Encoder(SceneEffect):
    """Rounds the position to the nearest step, of the motor or of the handle.

    Attributes:
        resolution_m: length of a step; 0 only at the handle, for a position without steps.
        body: the body whose position is measured.
    """

    kind: ClassVar[str] = "encoder"
    station: ClassVar[Station] = Station.SENSING

    resolution_m: float
    body: str = DEVICE

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        """Take what is left out from the device."""
        source, default = "device.encoder_resolution_m", problem.device.encoder_resolution_m
        resonant = any(effect.kind == "resonance" for effect in scene_effects(problem))
        if (table.at or problem.device.encoder_at) == "handle" and (table.at is not None or resonant):
            if not resonant:
                message = 'is "handle", where there is none; allowed: beside the effect resonance, or "motor"'
                raise InputError([Fault(problem.name, None, f"{place}.at", message)])
            return cls(default if table.resolution_m is None else table.resolution_m, HANDLE)
        key = "resolution_m"
        return cls(required_number(table.resolution_m, default, key=key, place=place, problem=problem, source=source))

    @property
    def sensed_body(self) -> str | None:
        """The body whose position is measured."""
        return self.body

    def sample(self, tick: Tick) -> None:
        """Quantise."""
        import casadi as ca  # noqa: PLC0415

        if self.resolution_m > 0:
            tick.position = self.resolution_m * ca.floor(tick.position / self.resolution_m + 0.5)
