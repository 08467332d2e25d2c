"""A joint that an engine moves, with no device and no hand: the end of a file with [simulation] and no [device]."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

from avc_casadi.model import table as t
from avc_casadi.model.control_law import ControlLaw
from avc_casadi.model.device import Device
from avc_casadi.model.ends import End, Simulation

_OF_DEVICES = ("exchange", "clock", "position_scale", "force_scale", "stiffness_n_per_m")
"""Keys of [simulation] that say how a device is joined to its tool."""
_OF_JOINTS = ("stiffness_n_per_m", "damping_ns_per_m", "velocity")
"""Keys of [law] that act in a joint."""


class NoDevice(Device):
    """The device of a problem that states none: its motion alone means something."""

    def faults(self) -> Iterator[t.Finding]:
        """Yield nothing: it has no handle, and no value that a file states."""
        yield from ()


@dataclass(frozen=True)
class Joint(End):
    """What an engine moves by force = -(kp x + kd v) of its own state, or of that of some steps ago."""

    kind: ClassVar[str] = "joint"
    required: ClassVar[str] = "a table [simulation] with tool_mass_kg, and no [device]"

    engine: Simulation

    def document(self) -> dict[str, Any]:
        """Return the values of its engine."""
        return self.engine.document()

    def faults_beside(self, device: Device) -> Iterator[t.Finding]:  # noqa: ARG002 - there is none
        """Yield a joint without a mass, and keys of a tool that a device moves."""
        if self.engine.tool_mass_kg is None:
            yield ("tool_mass_kg",), "is missing; give the mass that the engine moves, or a range [lowest, highest]"
        for key in _OF_DEVICES:
            if key in self.engine.model_fields_set:
                yield (key,), "is of a tool that a device moves; leave it out, or add a [device]"


def joint_law_faults(law: ControlLaw, engine: Simulation) -> Iterator[t.Finding]:
    """Yield the keys of a law that no joint has, and a difference in place of a velocity that the engine solves."""
    of_joint = f"is no part of the law of a joint; allowed: {', '.join(_OF_JOINTS)}"
    for key in sorted(law.model_fields_set - set(_OF_JOINTS)):
        yield (key,), of_joint
    if law.velocity.kind != "difference":
        yield (
            ("velocity", "kind"),
            f'is {t.shown(law.velocity.kind)}; allowed: "difference", or no velocity: the engine has its own',
        )
    elif "velocity" in law.model_fields_set and engine.solved != "nothing":
        solves = f"the integrator {engine.integrator} solves for the velocity itself"
        yield ("velocity", "kind"), f'is "difference", but {solves}; leave velocity out'
