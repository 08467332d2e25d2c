"""A linear discrete filter on the measured position."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

from avc_casadi._errors import Fault, InputError
from avc_casadi.problem import Problem
from avc_casadi.scene.effects._base import SceneEffect, Station
from avc_casadi.scene.effects._sections import filter_position
from avc_casadi.scene.loop import Tick


@dataclass(frozen=True)
class Compensator(SceneEffect):
    """Second-order sections, one after the other.

    Attributes:
        sections: b0, b1, b2, a1, a2 of each.
    """

    kind: ClassVar[str] = "compensator"
    station: ClassVar[Station] = Station.COMPUTATION

    sections: tuple[tuple[float, float, float, float, float], ...]

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        """Take the table; every section must be stable."""
        faults = []
        for index, (*_, a1, a2) in enumerate(table.sections):
            if not (abs(a2) < 1 and abs(a1) < 1 + a2):
                message = f"has a1 = {a1:g}, a2 = {a2:g}: not stable; allowed: |a2| < 1 and |a1| < 1 + a2"
                faults.append(Fault(problem.name, None, f"{place}.sections[{index}]", message))
        if faults:
            raise InputError(faults)
        return cls(table.sections)

    def sample(self, tick: Tick) -> None:
        """Replace the position."""
        for index, section in enumerate(self.sections):
            filter_position(tick, f"compensator_{index + 1}", section)
