"""Play between the handle and the motor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

from avc_casadi.problem import Problem
from avc_casadi.scene.effects._base import SceneEffect, Station, required_number
from avc_casadi.scene.loop import Tick


@dataclass(frozen=True)
class Backlash(SceneEffect):
    """The encoder at the motor follows the position only beyond half the play either way: a hysteresis (play operator).

    The force passes without play, as a gear under load does; the play is taken up at the samples. A dead zone of the
    force would need the stiffness of the gear's flanks, which nobody declares.

    Attributes:
        gap_m: the whole play.
    """

    kind: ClassVar[str] = "backlash"
    station: ClassVar[Station] = Station.SENSING

    gap_m: float

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        """Take what is left out from the device."""
        source, default = "device.backlash_m", problem.device.backlash_m
        return cls(required_number(table.gap_m, default, key="gap_m", place=place, problem=problem, source=source))

    def sample(self, tick: Tick) -> None:
        """Follow the position with play."""
        import casadi as ca  # noqa: PLC0415

        name = "backlash_position_m"
        before = tick.state(name, tick.start_m, computed=False)
        half = self.gap_m / 2
        tick.position = ca.fmax(ca.fmin(before, tick.position + half), tick.position - half)
        tick.follow(name, tick.position)
