"""Couplings to a remote end other than a wall: the tool of a simulation, or a second device; with their problem."""

from __future__ import annotations

import hashlib
import json
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from avc_casadi.model.virtual_tool import ToolGains

if TYPE_CHECKING:
    from avc_casadi._util.units import Units
    from avc_casadi.model.follower import Follower
    from avc_casadi.model.problem import Problem
    from avc_casadi.model.virtual_tool import VirtualTool


@dataclass(frozen=True, eq=False)
class OtherEndCoupling(ABC):
    """Spring and damper between a device and a moving remote end."""

    problem: Problem
    gains: ToolGains
    certificate: Mapping[str, Any] | None = field(default=None, repr=False)
    trial: Mapping[str, Any] | None = field(default=None, repr=False)
    versions: Mapping[str, str] = field(default_factory=dict, repr=False)

    @property
    def units(self) -> Units:
        """Names and units in which it is printed."""
        return self.problem.units

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and isinstance(other, OtherEndCoupling) and self.id == other.id

    def __hash__(self) -> int:
        return hash(self.id)

    @abstractmethod
    def _end(self) -> tuple[str, VirtualTool | Follower]:
        """Return the table of the remote end, and its name in a problem file."""

    @property
    def id(self) -> str:
        """Identifier, a hash of gains, device and remote end: 8 hexadecimal digits."""
        name, end = self._end()
        runs = {
            "gains": vars(self.gains),
            "device": self.problem.device.model_dump(mode="json"),
            name: end.model_dump(mode="json"),
        }
        return hashlib.sha256(json.dumps(runs, sort_keys=True).encode()).hexdigest()[:8]


@dataclass(frozen=True, eq=False)
class ToolCoupling(OtherEndCoupling):
    """Coupling of a device to the tool of a simulation."""

    @property
    def tool(self) -> VirtualTool:
        """The [simulation] of its problem."""
        found = self.problem.simulation
        assert found is not None  # noqa: S101 - made by `recommend` and read from files that have one
        return found

    @property
    def in_scene(self) -> ToolGains:
        """K and B in the engine's units of position and force; the local damper stays at the device."""
        k, b = self.gains.stiffness_n_per_m / self.tool.scale, self.gains.damping_ns_per_m / self.tool.scale
        return replace(self.gains, stiffness_n_per_m=k, damping_ns_per_m=b)

    def _end(self) -> tuple[str, VirtualTool]:
        return "simulation", self.tool


@dataclass(frozen=True, eq=False)
class TeleoperatorCoupling(OtherEndCoupling):
    """Coupling of two devices over a link; each local loop adds the damper of the gains to its own device."""

    @property
    def follower(self) -> Follower:
        """The [follower] of its problem."""
        found = self.problem.follower
        assert found is not None  # noqa: S101 - made by `recommend` and read from files that have one
        return found

    @property
    def at_follower(self) -> ToolGains:
        """All gains in the follower's units of position and force."""
        return self.gains.at_scale(1 / self.follower.scale)

    def _end(self) -> tuple[str, Follower]:
        return "follower", self.follower
