"""Whole samples of delay between measurement and force."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

from avc_casadi.problem import Problem, whole_delay
from avc_casadi.scene.effects._base import SceneEffect, Station, required_number
from avc_casadi.scene.loop import Tick


@dataclass(frozen=True)
class Delay(SceneEffect):
    """A line of past commands.

    Attributes:
        samples: its length.
    """

    kind: ClassVar[str] = "delay"
    station: ClassVar[Station] = Station.ACTUATION

    samples: int

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        """Take what is left out from the device."""
        source, default = "device.delay_samples", problem.device.delay_samples
        samples = required_number(table.samples, default, key="samples", place=place, problem=problem, source=source)
        return cls(whole_delay(samples, "the effect delay"))

    def sample(self, tick: Tick) -> None:
        """Put the command into the line and take out the oldest."""
        if tick.command is None:
            return
        coming = tick.asked = tick.command
        for place in range(self.samples):
            name = f"delayed_{place + 1}_n"
            held = tick.state(name)
            tick.follow(name, coming)
            coming = held
        tick.command = coming
