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
    jump_m: float  # farthest from the position before; the fastest and a step of the encoder at both ends
    unsure_m: float  # what steps and noise add to a change of movement
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
        most = board_limits(device).max_acceleration_m_per_s2  # above it the encoder has jumped, as firmware judges
        # No hand accelerates it more outside the wall, where nothing else does: ten times that of a fast tap.
        alone = 100.0 / device.metres_per_unit + actuator_m_per_s2(device)
        outside_m = (most if detents else min(most, alone)) * time**2
        # Two steps of rounding, two of a flickering count; six deviations of a second difference, of sqrt(1 + 4 + 1).
        unsure: float = 4 * step + 15.0 * noise
        if not step:  # at the handle, steps of an undeclared encoder are 50 um or less, and none is a fault
            unsure += max(1e-4 / device.metres_per_unit - outside_m, 0.0)
        return cls(
            fastest_m_per_s=fastest,
            jump_m=fastest * time + 2 * step,
            unsure_m=unsure,
            outside_m=outside_m + unsure,
            change_m=most * time**2 + unsure,
        )
