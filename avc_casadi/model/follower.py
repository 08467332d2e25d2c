"""The follower of a bilateral teleoperator: a second device at the remote end of the coupling."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BeforeValidator

from avc_casadi.model.device import Device
from avc_casadi.model.quantity import Quantity, Share, Stiffness
from avc_casadi.model.virtual_tool import RIGID_N_PER_M, Contacts, Dampings, Ends, Interval, Scale

Architecture = Literal["position-position", "position-force"]
ForceSent = Literal["commanded", "measured"]

_Delays = Annotated[Interval, BeforeValidator(Ends(Quantity("s", 1e-6, 10)))]


class Follower(Device):
    """The table [follower]: all keys of [device], the link to it, and its environment."""

    delay_s: _Delays = (0.0, 0.0)
    return_delay_s: _Delays | None = None
    jitter: Share = 0.0
    lost_share: Share = 0.0
    architecture: Architecture = "position-position"
    force: ForceSent = "commanded"
    contact_stiffness_n_per_m: Contacts = (0.0, RIGID_N_PER_M)
    # None: a tenth of the critical one; every delayed damper destabilises a stiff contact that rings undamped.
    contact_damping_ns_per_m: Dampings | None = None
    position_scale: Scale = 1.0
    force_scale: Scale = 1.0
    stiffness_n_per_m: Stiffness | None = None

    @property
    def scale(self) -> float:
        """Ratio of mass, damping or stiffness at the leader to that of the follower."""
        return self.position_scale * self.force_scale

    @property
    def rigid(self) -> bool:
        """Whether its environment may be rigid."""
        return self.contact_stiffness_n_per_m[1] >= RIGID_N_PER_M

    @property
    def delays_s(self) -> list[tuple[float, float]]:
        """Pairs of delays, to the follower and back: the shortest and the longest both ways."""
        there, back = self.delay_s, self.return_delay_s or self.delay_s
        return sorted({(there[0], back[0]), (there[1], back[1])})

    def at_leader(self) -> Device:
        """Return the follower in the leader's units of position and force."""
        keys = {key: getattr(self, key) for key in Device.model_fields if key in self.model_fields_set}
        ranges = self.range
        forces, lengths = self.force_scale, 1 / self.position_scale
        scales = {
            **dict.fromkeys(("mass_kg", "damping_ns_per_m"), self.scale),
            **dict.fromkeys(("coulomb_friction_n", "max_force_n"), forces),
            **dict.fromkeys(("encoder_resolution_m", "position_noise_rms_m", "backlash_m"), lengths),
        }
        for key, factor in scales.items():
            if (value := getattr(self, key)) is not None:
                keys[key] = factor * value
        known = {
            key: tuple(factor * end for end in ends)
            for key, factor in scales.items()
            if (ends := getattr(ranges, key)) is not None
        }
        keys["range"] = ranges.model_copy(update=known)
        return Device.model_validate(keys)
