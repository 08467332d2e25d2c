"""Plausibility of positions in exported C: bounds of walls, tools and followers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from avc_hardware.codegen.figures import actuator_m_per_s2, board_limits

if TYPE_CHECKING:
    from avc_casadi.model.device import Device

FARTHEST_M = 1e6
"""Larger positions count as infinite, and single precision might end."""


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
        # No hand moves the handle faster: a larger step in a sample is a sensor fault.
        fastest = 10.0 / device.metres_per_unit
        most = board_limits(device).max_acceleration_m_per_s2
        # No hand accelerates it more outside the wall, where nothing else does: ten times that of a fast tap.
        alone = 100.0 / device.metres_per_unit + actuator_m_per_s2(device)
        # Two steps of rounding, two of a flickering count; six deviations of a second difference, of sqrt(1 + 4 + 1).
        unsure: float = 4 * step + 15.0 * noise
        # At the handle: an undeclared encoder has steps of 50 um or less, none of which is a fault.
        least = 0.0 if step else 1e-4 / device.metres_per_unit

        def change_m(acceleration_m_per_s2: float) -> float:
            return max(acceleration_m_per_s2 * time**2, least) + unsure

        return cls(
            fastest_m_per_s=fastest,
            acceleration_m_per_s2=most,
            jump_m=fastest * time + 2 * step,
            outside_m=change_m(most if detents else min(most, alone)),
            change_m=change_m(most),
        )
