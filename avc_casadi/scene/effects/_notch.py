"""A notch on the measured position."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar, Self

from avc_casadi._errors import Fault, InputError
from avc_casadi.problem import Problem
from avc_casadi.scene.effects._base import SceneEffect, Station
from avc_casadi.scene.effects._sections import filter_position
from avc_casadi.scene.loop import Tick


@dataclass(frozen=True)
class Notch(SceneEffect):
    """(s^2 + d w omega s + omega^2)/(s^2 + w omega s + omega^2) by Tustin's rule, exact at its frequency; 1 at rest.

    Attributes:
        frequency_hz: omega / 2 pi.
        depth: gain d at the frequency.
        width: w, the band as a share of the frequency.
    """

    kind: ClassVar[str] = "notch"
    station: ClassVar[Station] = Station.COMPUTATION

    frequency_hz: float
    depth: float
    width: float

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        """Take the table; the frequency lies below that of Nyquist."""
        nyquist = 0.5 / problem.device.sample_time_s
        if table.frequency_hz >= nyquist:
            message = f"is {table.frequency_hz:g}; allowed: below the Nyquist frequency {nyquist:g} Hz"
            raise InputError([Fault(problem.name, None, f"{place}.frequency_hz", message)])
        return cls(table.frequency_hz, table.depth, table.width)

    def section(self, sample_time_s: float) -> tuple[float, float, float, float, float]:
        """Return b0, b1, b2, a1, a2 of the discrete filter.

        Args:
            sample_time_s: T.
        """
        turned = math.tan(math.pi * self.frequency_hz * sample_time_s)
        wide, square = self.width * turned, turned * turned
        whole = 1 + wide + square
        middle = 2 * (square - 1) / whole
        return (
            (1 + self.depth * wide + square) / whole,
            middle,
            (1 - self.depth * wide + square) / whole,
            middle,
            (1 - wide + square) / whole,
        )

    def sample(self, tick: Tick) -> None:
        """Replace the position."""
        filter_position(tick, "notch", self.section(tick.sample_time_s))
