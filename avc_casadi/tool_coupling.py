"""ToolCoupling: the spring and damper between a device and a simulation, with the problem that they were made for."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from avc_casadi.model.lifted_loop import ToolGains

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem
    from avc_casadi.model.virtual_tool import VirtualTool


@dataclass(frozen=True, eq=False)
class ToolCoupling:
    """What couples a device to the tool of a simulation.

    Attributes:
        problem: the problem as stated: device, hands, simulation.
        gains: K, B and the damper of the device's own loop, at the device.
        certificate: which claims it meets, a JSON document; None before it was judged.
        trial: how simulated hands fared with it, a JSON document; None before it was tried.
        versions: of what made it, by package.
    """

    problem: Problem
    gains: ToolGains
    certificate: Mapping[str, Any] | None = field(default=None, repr=False)
    trial: Mapping[str, Any] | None = field(default=None, repr=False)
    versions: Mapping[str, str] = field(default_factory=dict, repr=False)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ToolCoupling) and self.id == other.id

    def __hash__(self) -> int:
        return hash(self.id)

    @property
    def tool(self) -> VirtualTool:
        """The [simulation] of its problem."""
        found = self.problem.simulation
        assert found is not None  # noqa: S101 - made by `recommend` and read from files that have one
        return found

    @property
    def in_scene(self) -> ToolGains:
        """K and B as the engine counts positions and forces; the local damper stays at the device."""
        k, b = self.gains.stiffness_n_per_m / self.tool.scale, self.gains.damping_ns_per_m / self.tool.scale
        return replace(self.gains, stiffness_n_per_m=k, damping_ns_per_m=b)

    @property
    def id(self) -> str:
        """Name of what runs, from its content: 8 hexadecimal digits."""
        runs = {
            "gains": vars(self.gains),
            "device": self.problem.device.model_dump(mode="json"),
            "simulation": self.tool.model_dump(mode="json"),
        }
        return hashlib.sha256(json.dumps(runs, sort_keys=True).encode()).hexdigest()[:8]
