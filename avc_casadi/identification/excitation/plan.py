"""A plan: the signal, the limits that the device keeps, and what holds it near where it began."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from avc_casadi._util.units import MotionKind
from avc_casadi.identification.excitation.signal import Signal

Kind = Literal["multisine", "chirp", "sweep", "release"]

SILENCE_S = 1.0
"""The device stops where it has not heard the host for so long."""
WINDOW_MOST = 32
# The error of a velocity by a step of the encoder, as a share of the speed limit.
_COARSE = 0.1


@dataclass(frozen=True)
class Plan:
    """What a device is to play.

    Attributes:
        kind: multisine, chirp, sweep or release.
        sample_time_s: T.
        metres_per_count: of the encoder.
        ticks: played, with the ramps.
        ramp_ticks: in, and out.
        max_force_n: limit of signal and centring together.
        max_speed_m_per_s: limit; beyond it the force is off for good.
        max_travel_m: limit to either side of where it began.
        spring_n_per_m: that holds the device near there, weak.
        damper_ns_per_m: beside the spring.
        window: ticks over which the velocity is taken, 1 to 32.
        signal: beside the centring.
        motion: of the device; one that turns has rad and N.m in all of these.
    """

    kind: Kind
    sample_time_s: float
    metres_per_count: float
    ticks: int
    ramp_ticks: int
    max_force_n: float
    max_speed_m_per_s: float
    max_travel_m: float
    spring_n_per_m: float
    damper_ns_per_m: float
    window: int
    signal: Signal
    motion: MotionKind = "linear"

    @property
    def seconds(self) -> float:
        """How long it lasts."""
        return self.ticks * self.sample_time_s

    @property
    def silent_ticks(self) -> int:
        """Ticks without a word from the host after which the device stops."""
        return max(1, round(SILENCE_S / self.sample_time_s))

    @property
    def band_hz(self) -> tuple[float, float]:
        """Lowest and highest frequency of the signal."""
        return self.signal.frequency_hz(self.ticks, self.sample_time_s)


def speed_window(metres_per_count: float, sample_time_s: float, max_speed_m_per_s: float) -> int:
    """Return the ticks over which a velocity is taken: as few as the encoder's step allows.

    Args:
        metres_per_count: of the encoder.
        sample_time_s: T.
        max_speed_m_per_s: of which the error shall be a tenth at most.
    """
    wanted = metres_per_count / (_COARSE * max_speed_m_per_s * sample_time_s)
    return int(min(max(1, -(-wanted // 1)), WINDOW_MOST))
