"""A wall: the environment on one side only, by one of two contact laws."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.arrays import FloatArray
from avc_casadi.model.device import Detent
from avc_casadi.model.effects import DetentEffect, EnvironmentEffect, WallEffect
from avc_casadi.model.problem import Contact, Problem
from avc_casadi.simulation.contact import Environment
from avc_casadi.simulation.effects.base import SceneEffect
from avc_casadi.simulation.tick import Rate, Tick


@dataclass(frozen=True)
class Detents(SceneEffect, keys=DetentEffect, rank=180):
    """The force of the detents of a problem and their damper."""

    detent: Detent

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:  # noqa: ARG003
        """Build it from the detents of the problem."""
        if problem.detent is None:
            message = "is listed and [detent] is missing; allowed: both, or neither"
            raise InputError([Fault(problem.name or "problem", None, place, message)])
        return cls(problem.detent)

    def sample(self, tick: Tick) -> None:
        """Add their force to the commanded force."""
        import casadi as ca  # noqa: PLC0415

        one = self.detent
        turns = (tick.position - one.centre_m) / one.pitch_m
        share = (turns - ca.floor(turns + 0.5)) / one.width
        inside = ca.fabs(share) < 0.5
        force = ca.if_else(inside, one.force_n * ca.sin(2 * math.pi * share), 0)
        tick.environment_energy_j += self._depth_j * (1 - ca.cos(2 * math.pi * ca.fmin(ca.fabs(share), 0.5)))
        if one.damping_ns_per_m > 0:
            force += one.damping_ns_per_m * Rate(tick, "detent_position", tick.start_m).settle(tick.position)
        tick.command = force if tick.command is None else tick.command + force

    @property
    def _depth_j(self) -> float:
        one = self.detent
        return one.force_n * one.width * one.pitch_m / (2 * math.pi)

    def potential_j(self, position_m: FloatArray) -> FloatArray:
        """Return the energy stored in the detents at positions, 0 in the valleys."""
        one = self.detent
        turns = (position_m - one.centre_m) / one.pitch_m
        share = np.minimum(np.abs(turns - np.floor(turns + 0.5)) / one.width, 0.5)
        return np.asarray(self._depth_j * (1 - np.cos(2 * math.pi * share)))


@dataclass(frozen=True)
class Wall(SceneEffect, keys=WallEffect, rank=160, role="environment"):
    """A spring and a damper that begin at x = 0 and never pull."""

    damping_ns_per_m: float
    stiffness_n_per_m: float
    contact: Contact

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:  # noqa: ARG003
        """Build it; missing numbers are taken from the environment."""
        given = problem.environment
        return cls(
            given.damping_ns_per_m if table.damping_ns_per_m is None else table.damping_ns_per_m,
            given.stiffness_n_per_m if table.stiffness_n_per_m is None else table.stiffness_n_per_m,
            problem.coupling.contact,
        )

    @property
    def environment(self) -> Environment:
        """The environment on one side."""
        clips_last = self.contact == "clip-last"
        return Environment(self.stiffness_n_per_m, self.damping_ns_per_m, one_sided=True, clips_last=clips_last)


@dataclass(frozen=True)
class TwoSidedEnvironment(Wall, keys=EnvironmentEffect, rank=170, role="environment"):
    """A spring towards x = 0 and a damper, always in contact."""

    @property
    def environment(self) -> Environment:
        """The environment on both sides."""
        return Environment(self.stiffness_n_per_m, self.damping_ns_per_m, one_sided=False)
