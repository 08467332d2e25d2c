"""Plausibility of positions in exported C: bounds of walls, tools and followers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from avc_hardware.codegen.figures import actuator_m_per_s2, board_limits

if TYPE_CHECKING:
    from avc_casadi.model.device import Device

FARTHEST_M = 1e6
"""Larger positions count as infinite, and single precision might end."""
FASTEST_M_PER_S = 10.0
"""No hand moves the handle faster: a larger step in a sample is a sensor fault."""
HAND_M_PER_S2 = 100.0
"""No hand accelerates the handle more outside the wall, where nothing else does: ten times that of a fast tap."""
# Six standard deviations of a second difference, in which noise of 1 has sqrt(1 + 4 + 1).
_NOISE = 15.0
# A second difference has two steps of rounding, and two more of a flickering count.
_STEPS = 4
# By which movements may differ, at the handle, where no encoder is declared: it has steps all the same, of 50 um or
# less. Otherwise a fast loop would take each of them for a fault, and its wall would never push.
_UNDECLARED_M = 1e-4


@dataclass(frozen=True)
class SensorBounds:
    """Bounds of a position about its prediction, in the device's own units."""

    fastest_m_per_s: float  # of the handle, by the radius of a rotary one
    acceleration_m_per_s2: float  # above it the encoder has jumped: as monitored by firmware, `board_limits`
    jump_m: float  # farthest from the position before; the fastest and a step of the encoder at both ends
    outside_m: float  # largest change of movement outside the wall: by a hand, the last forces, steps and noise
    change_m: float  # the same inside, where actuator and hand act

    @classmethod
    def of(cls, device: Device, *, detents: bool = False) -> Self:
        """Return the bounds of a device; detents move it outside a wall too."""
        time, ranges = device.sample_time_s, device.range
        step = max((device.encoder_resolution_m or 0.0, *(ranges.encoder_resolution_m or ())))
        noise = max((device.position_noise_rms_m, *(ranges.position_noise_rms_m or ())))
        fastest = FASTEST_M_PER_S / device.metres_per_unit
        most = board_limits(device).max_acceleration_m_per_s2
        alone = HAND_M_PER_S2 / device.metres_per_unit + actuator_m_per_s2(device)
        unsure: float = _STEPS * step + _NOISE * noise
        least = 0.0 if step else _UNDECLARED_M / device.metres_per_unit

        def change_m(acceleration_m_per_s2: float) -> float:
            return max(acceleration_m_per_s2 * time**2, least) + unsure

        return cls(
            fastest_m_per_s=fastest,
            acceleration_m_per_s2=most,
            jump_m=fastest * time + 2 * step,
            outside_m=change_m(most if detents else min(most, alone)),
            change_m=change_m(most),
        )
