"""What exported C believes of a position: one rule for walls, tools and teleoperators, its bounds, its words, its C.

A position that no hand brings about is a fault of the sensor. What a law remembers would take it for a motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from avc_hardware.codegen.figures import board_limits

if TYPE_CHECKING:
    from avc_casadi.model.device import Device
    from avc_hardware.codegen.operations import Precision

FARTHEST_M = 1e6
"""No device measures more; beyond it a position is as good as infinite, and single precision might end."""
FASTEST_M_PER_S = 10.0
"""No hand moves the handle faster: what goes farther in a sample is a fault of the sensor."""
HAND_M_PER_S2 = 100.0
"""No hand accelerates the handle more in front of a wall, where nothing else does: ten times what a fast tap takes."""
# Six standard deviations of a second difference, in which noise of 1 has sqrt(1 + 4 + 1).
_NOISE = 15.0
# A second difference has two steps by rounding, and two more where a count flickers.
_STEPS = 4


@dataclass(frozen=True)
class SensorBounds:
    """How far a position may be from what the ones before let expect, in the device's own units.

    Attributes:
        fastest_m_per_s: the handle's fastest, by the radius of one that turns.
        outside_m_per_s2: what a hand alone gives the handle.
        acceleration_m_per_s2: beyond it the encoder has jumped: what firmware watches, `board_limits`.
        jump_m: farthest from the position before; the fastest and a step of the encoder at both ends.
        outside_m: farthest that a movement from outside differs from the one before; a hand's, steps and noise.
        change_m: the same from inside, where actuator and hand strike.
    """

    fastest_m_per_s: float
    outside_m_per_s2: float
    acceleration_m_per_s2: float
    jump_m: float
    outside_m: float
    change_m: float

    @classmethod
    def of(cls, device: Device, *, detents: bool = False) -> Self:
        """Return those of a device; detents move it in front of a wall too."""
        time, step = device.sample_time_s, device.encoder_resolution_m or 0.0
        fastest = FASTEST_M_PER_S / device.metres_per_unit
        most = board_limits(device).max_acceleration_m_per_s2
        alone = most if detents else HAND_M_PER_S2 / device.metres_per_unit
        unsure = _STEPS * step + _NOISE * device.position_noise_rms_m
        return cls(
            fastest_m_per_s=fastest,
            outside_m_per_s2=alone,
            acceleration_m_per_s2=most,
            jump_m=fastest * time + 2 * step,
            outside_m=alone * time**2 + unsure,
            change_m=most * time**2 + unsure,
        )


_BELIEVED = """\
static int within({real} value, {real} most)
{{
    return value >= -most && value <= most;
}}

/* Whether a position can have come after the one before, that a movement had brought; known: 0 none of the two, 1 the
 * position, 2 both. No hand moves faster, none changes its speed faster. */
static int believed({real} position_m, {real} before_m, {real} moved_m, unsigned char known, {real} jump_m,
                    {real} change_m)
{{
    const {real} moved_now_m = position_m - before_m;
    if (!within(position_m, {farthest})) {{
        return 0;
    }}
    return known == 0u || (within(moved_now_m, jump_m) && (known == 1u || within(moved_now_m - moved_m, change_m)));
}}
"""


def believed_c(precision: Precision) -> str:
    """Return the rule as functions of C: ``within`` and ``believed``."""
    return _BELIEVED.format(real=precision.c_type, farthest=precision.literal(FARTHEST_M))
