"""A low pass on the velocities that the computer takes from positions."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar, Self

from avc_casadi.problem import Problem
from avc_casadi.scene.effects._base import SceneEffect, Station
from avc_casadi.scene.loop import Tick


@dataclass(frozen=True)
class VelocityFilter(SceneEffect):
    """First-order low pass on every backward difference: of the coupling, the environment and the contact damper.

    Attributes:
        cutoff_hz: its corner frequency.
    """

    kind: ClassVar[str] = "velocity-filter"
    station: ClassVar[Station] = Station.COMPUTATION

    cutoff_hz: float

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:  # noqa: ARG003
        """Take the table."""
        return cls(table.cutoff_hz)

    def sample(self, tick: Tick) -> None:
        """Set the share of the old velocity, that of a first-order lag over one sample."""
        tick.filter_share = math.exp(-2 * math.pi * self.cutoff_hz * tick.sample_time_s)
