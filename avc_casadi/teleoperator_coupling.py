"""TeleoperatorCoupling: spring and damper between a leader and its follower, with the problem they were made for."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from avc_casadi.model.lifted_loop import ToolGains

if TYPE_CHECKING:
    from avc_casadi.model.follower import Follower
    from avc_casadi.model.problem import Problem


@dataclass(frozen=True, eq=False)
class TeleoperatorCoupling:
    """What couples two devices over a link.

    Attributes:
        problem: the problem as stated: device, hands, follower.
        gains: K, B and the damper that each loop adds to its own device, at the leader.
        certificate: what is known of its loops, a JSON document; None before it was judged.
        trial: how simulated hands fared with it, a JSON document; None before it was tried.
        versions: of what made it, by package.
    """

    problem: Problem
    gains: ToolGains
    certificate: Mapping[str, Any] | None = field(default=None, repr=False)
    trial: Mapping[str, Any] | None = field(default=None, repr=False)
    versions: Mapping[str, str] = field(default_factory=dict, repr=False)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, TeleoperatorCoupling) and self.id == other.id

    def __hash__(self) -> int:
        return hash(self.id)

    @property
    def follower(self) -> Follower:
        """The [follower] of its problem."""
        found = self.problem.follower
        assert found is not None  # noqa: S101 - made by `recommend` and read from files that have one
        return found

    @property
    def at_follower(self) -> ToolGains:
        """All gains as the follower counts its positions and forces."""
        return self.gains.at_scale(1 / self.follower.scale)

    @property
    def id(self) -> str:
        """Name of what runs, from its content: 8 hexadecimal digits."""
        runs = {
            "gains": vars(self.gains),
            "device": self.problem.device.model_dump(mode="json"),
            "follower": self.follower.model_dump(mode="json"),
        }
        return hashlib.sha256(json.dumps(runs, sort_keys=True).encode()).hexdigest()[:8]
