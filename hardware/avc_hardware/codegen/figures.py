"""Figures of a firmware: the limits of its board, the parameters of its control tick."""

from __future__ import annotations

import struct
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from avc_casadi.model.device import Device


# In the order of HELLO.
ESTIMATOR_NUMBERS = ("zero-crossing", "spectral-peak", "adaptive-notch", "fused")


@dataclass(frozen=True)
class RuntimeFigures:
    """Parameters for which a firmware is generated.

    Attributes:
        sample_time_s: T.
        metres_per_count: of the encoder; sets the estimator's floor.
        estimator: method.
        hold_s: hold time of a lost estimate.
        slew_per_s: largest relative change of a gain, a second; None for no limit.
        passive: whether gains change without creating energy, with anchor and tank.
        guard_damping_ns_per_m: most that the guard adds: the device's own damping.
        hand_m_per_unit: travel of the hand per unit of position: 1, or the handle radius of a rotary device; the
            estimator's motion threshold applies there.
    """

    sample_time_s: float = 1e-3
    metres_per_count: float = 2e-6
    estimator: str = "fused"
    hold_s: float = 0.2
    slew_per_s: float | None = 20.0
    passive: bool = True
    guard_damping_ns_per_m: float = 2.0
    hand_m_per_unit: float = 1.0


@dataclass(frozen=True)
class BoardLimits:
    """Limits of a board; the values of the netduinoplus2 board.

    Attributes:
        sample_time_s: T.
        metres_per_count: of the encoder.
        max_force_n: of the output.
        max_damping_ns_per_m: of b, of the wall too.
        max_stiffness_n_per_m: of k, of the wall too.
        max_contact_damping_ns_per_m: of b_p.
        max_speed_m_per_s: above it a fault is latched; 0, here and below: not monitored.
        max_acceleration_m_per_s2: above it the encoder has jumped.
        max_energy_j: largest net energy that a coupling may deliver within about a second.
        stuck_swing_n: force oscillations of this size, four of them without one count, indicate a stuck encoder.
        max_overruns: ticks in a row that took longer than T.
    """

    sample_time_s: float = 1e-3
    metres_per_count: float = 2e-6
    max_force_n: float = 50.0
    max_damping_ns_per_m: float = 1e5
    max_stiffness_n_per_m: float = 1e8
    max_contact_damping_ns_per_m: float = 1e4
    max_speed_m_per_s: float = 3.0
    max_acceleration_m_per_s2: float = 1000.0
    max_energy_j: float = 0.2
    stuck_swing_n: float = 12.5
    max_overruns: float = 5.0

    def packed(self) -> bytes:
        """Return the bytes of the firmware's `avc_limits_t`."""
        return struct.pack(f"<{len(fields(self))}f", *(getattr(self, field.name) for field in fields(self)))


def actuator_m_per_s2(device: Device) -> float:
    """Return the acceleration of the lighter part of a device by its actuator alone; as of a board without a limit."""
    share = 0.0 if device.resonance is None else device.resonance.mass_ratio
    force = device.max_force_n or BoardLimits().max_force_n * device.metres_per_unit
    return force / (device.mass_kg * (min(share, 1 - share) or 1.0))


def board_limits(device: Device) -> BoardLimits:
    """Return the limits of a board for a device; by default those of the boards."""
    usual = BoardLimits()
    # Implausible motion is defined at the handle.
    reach = device.metres_per_unit
    force = device.max_force_n or usual.max_force_n * reach
    return replace(
        usual,
        sample_time_s=device.sample_time_s,
        metres_per_count=device.encoder_resolution_m or usual.metres_per_count / reach,
        max_damping_ns_per_m=usual.max_damping_ns_per_m * reach**2,
        max_stiffness_n_per_m=usual.max_stiffness_n_per_m * reach**2,
        max_contact_damping_ns_per_m=usual.max_contact_damping_ns_per_m * reach**2,
        max_speed_m_per_s=usual.max_speed_m_per_s / reach,
        max_force_n=force,
        stuck_swing_n=force / 4,
        # hands and stops strike too
        max_acceleration_m_per_s2=max(usual.max_acceleration_m_per_s2 / reach, 4 * actuator_m_per_s2(device)),
    )
