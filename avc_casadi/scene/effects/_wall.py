"""A wall: the environment on one side only, by one of two contact laws."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

from avc_casadi.problem import Contact, Problem
from avc_casadi.scene.effects._base import SceneEffect, Station
from avc_casadi.scene.loop import Environment


@dataclass(frozen=True)
class Wall(SceneEffect):
    """A spring and a damper that begin at x = 0 and never pull.

    Attributes:
        damping_ns_per_m: b_e.
        stiffness_n_per_m: k_e.
        contact: the contact law.
    """

    kind: ClassVar[str] = "wall"
    station: ClassVar[Station] = Station.ENVIRONMENT

    damping_ns_per_m: float
    stiffness_n_per_m: float
    contact: Contact

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:  # noqa: ARG003
        """Take what is left out from the environment."""
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
