"""A notch on the measured position, and estimators of its velocity."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Self

from avc_casadi._errors import Fault, InputError
from avc_casadi.model.effects import NotchEffect
from avc_casadi.model.problem import Problem
from avc_casadi.model.runtime import Poles, VelocityFilterEffect, velocity_poles
from avc_casadi.simulation.effects.base import SceneEffect
from avc_casadi.simulation.tick import Tick


@dataclass(frozen=True)
class Notch(SceneEffect, keys=NotchEffect, rank=100, scene_alone=True):
    """(s^2 + d w omega s + omega^2)/(s^2 + w omega s + omega^2) by Tustin's rule, exact at its frequency; 1 at rest."""

    frequency_hz: float
    depth: float
    width: float

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        """Build it from the table; the frequency lies below that of Nyquist."""
        nyquist = 0.5 / problem.device.sample_time_s
        if table.frequency_hz >= nyquist:
            message = f"is {table.frequency_hz:g}; allowed: below the Nyquist frequency {nyquist:g} Hz"
            raise InputError([Fault(problem.name, None, f"{place}.frequency_hz", message)])
        return super().build(table, problem, place)

    def section(self, sample_time_s: float) -> tuple[float, float, float, float, float]:
        """Return b0, b1, b2, a1, a2 of the discrete filter."""
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
        """Replace the position: y(k) = b0 u(k) + b1 u(k-1) + b2 u(k-2) - a1 y(k-1) - a2 y(k-2), initially at rest."""
        b0, b1, b2, a1, a2 = self.section(tick.sample_time_s)
        first = tick.state("notch_first_m", (1 - b0) * tick.start_m)
        second = tick.state("notch_second_m", (b2 - a2) * tick.start_m)
        coming = tick.position
        tick.position = b0 * coming + first
        tick.follow("notch_first_m", b1 * coming - a1 * tick.position + second)
        tick.follow("notch_second_m", b2 * coming - a2 * tick.position)


@dataclass(frozen=True)
class VelocityFilter(SceneEffect, keys=VelocityFilterEffect, rank=130, scene_alone=True):
    """Velocity estimator of coupling, environment and contact damper."""

    poles: Poles

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        """Resolve the numbers."""
        return cls(velocity_poles(problem, table, place))

    def sample(self, tick: Tick) -> None:
        """Set the poles."""
        tick.poles = self.poles
