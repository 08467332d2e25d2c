"""Delay between measurement and force, in samples and a share of one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

from avc_casadi.problem import Problem
from avc_casadi.scene.effects._base import SceneEffect, Station, required_number
from avc_casadi.scene.loop import Tick


@dataclass(frozen=True)
class Delay(SceneEffect):
    """A line of past commands; after whole samples a share of one, in which the command before still acts.

    Attributes:
        samples: its length.
    """

    kind: ClassVar[str] = "delay"
    station: ClassVar[Station] = Station.ACTUATION

    samples: float

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        """Take what is left out from the device."""
        source, default = "device.delay_samples", problem.device.delay_samples
        return cls(required_number(table.samples, default, key="samples", place=place, problem=problem, source=source))

    def sample(self, tick: Tick) -> None:
        """Put the command into the line and take out the oldest, or the last two."""
        if tick.command is None:
            return
        whole = int(self.samples)
        late = float(self.samples - whole)
        line = [tick.command]
        tick.asked = tick.command
        for place in range(whole + (late > 0)):
            name = f"delayed_{place + 1}_n"
            held = tick.state(name)
            tick.follow(name, line[-1])
            line.append(held)
        tick.command = line[whole]
        if late > 0:
            tick.late, tick.command_before = late, line[whole + 1]
