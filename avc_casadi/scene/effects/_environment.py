"""The environment on both sides, as the frequency-domain methods see it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from avc_casadi.scene.effects._wall import Wall
from avc_casadi.scene.loop import Environment


@dataclass(frozen=True)
class TwoSidedEnvironment(Wall):
    """A spring towards x = 0 and a damper, always in contact."""

    kind: ClassVar[str] = "environment"

    @property
    def environment(self) -> Environment:
        """The environment on both sides."""
        return Environment(self.stiffness_n_per_m, self.damping_ns_per_m, one_sided=False)
