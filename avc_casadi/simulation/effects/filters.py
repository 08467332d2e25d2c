"""Filters on the measured position, and estimators of its velocity."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self

from avc_casadi._errors import Fault, InputError
from avc_casadi.model.effects import CompensatorEffect, EffectTable, NotchEffect
from avc_casadi.model.problem import Problem
from avc_casadi.model.velocity import PLAIN, RunningEstimator, VelocityEstimator, velocity_estimator
from avc_casadi.model.velocity_keys import VelocityFilterEffect
from avc_casadi.simulation.effects.base import SceneEffect, Station
from avc_casadi.simulation.tick import Tick


def dc_gain(section: Sequence[float]) -> float:
    """Return the gain of a section at rest."""
    b0, b1, b2, a1, a2 = section
    return (b0 + b1 + b2) / (1 + a1 + a2)


def filter_position(tick: Tick, name: str, section: Sequence[float]) -> None:
    """Pass the position through y(k) = b0 u(k) + b1 u(k-1) + b2 u(k-2) - a1 y(k-1) - a2 y(k-2), initially at rest.

    Args:
        tick: the sample; where the filter's gain is not 1, the initial position downstream differs.
        name: of its two states.
        section: b0, b1, b2, a1, a2.
    """
    b0, b1, b2, a1, a2 = section
    begin, end = tick.start_m, tick.start_m * dc_gain(section)
    first = tick.state(f"{name}_first_m", end - b0 * begin)
    second = tick.state(f"{name}_second_m", b2 * begin - a2 * end)
    coming = tick.position
    tick.position = b0 * coming + first
    tick.follow(f"{name}_first_m", b1 * coming - a1 * tick.position + second)
    tick.follow(f"{name}_second_m", b2 * coming - a2 * tick.position)
    tick.start_m = end


@dataclass(frozen=True)
class Compensator(SceneEffect):
    """Second-order sections in series.

    Attributes:
        sections: b0, b1, b2, a1, a2 of each.
    """

    kind: ClassVar[str] = "compensator"
    keys: ClassVar[type[EffectTable]] = CompensatorEffect
    rank: ClassVar[float] = 110
    scene_alone: ClassVar[bool] = True
    station: ClassVar[Station] = Station.COMPUTATION

    sections: tuple[tuple[float, float, float, float, float], ...]

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        """Build it from the table; every section must be stable."""
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


@dataclass(frozen=True)
class Notch(SceneEffect):
    """(s^2 + d w omega s + omega^2)/(s^2 + w omega s + omega^2) by Tustin's rule, exact at its frequency; 1 at rest.

    Attributes:
        frequency_hz: omega / 2 pi.
        depth: gain d at the frequency.
        width: w, the band as a share of the frequency.
    """

    kind: ClassVar[str] = "notch"
    keys: ClassVar[type[EffectTable]] = NotchEffect
    rank: ClassVar[float] = 100
    scene_alone: ClassVar[bool] = True
    station: ClassVar[Station] = Station.COMPUTATION

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
        return cls(table.frequency_hz, table.depth, table.width)

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
        """Replace the position."""
        filter_position(tick, "notch", self.section(tick.sample_time_s))


@dataclass(frozen=True)
class VelocityFilter(SceneEffect):
    """Velocity estimator of coupling, environment and contact damper; a nonlinear one takes x alone.

    Attributes:
        estimator: its numbers.
    """

    kind: ClassVar[str] = "velocity-filter"
    keys: ClassVar[type[EffectTable]] = VelocityFilterEffect
    rank: ClassVar[float] = 130
    scene_alone: ClassVar[bool] = True
    station: ClassVar[Station] = Station.COMPUTATION

    estimator: VelocityEstimator

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        """Resolve the numbers."""
        return cls(velocity_estimator(problem, table, place))

    def sample(self, tick: Tick) -> None:
        """Set the poles, or estimate the velocity of the measured position."""
        one = self.estimator
        if one.poles is not None or not isinstance(one, RunningEstimator):
            tick.poles = one.poles or PLAIN
            return
        names = one.initial(tick.start_m)
        state = {name: tick.state(f"estimated_{name}", value) for name, value in names.items()}
        following, tick.velocity, tick.position = one.step(tick.position, state)
        for name, value in following.items():
            tick.follow(f"estimated_{name}", value)
        tick.trace("estimated_m_per_s", tick.velocity)
