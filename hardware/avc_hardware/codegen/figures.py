"""Configuration of a firmware: the limits of its board, the figures of its control tick, and the numbers they make."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from avc_casadi import UnsupportedError

if TYPE_CHECKING:
    from avc_casadi.model.device import Device

# In the order of HELLO.
ESTIMATOR_NUMBERS = ("zero-crossing", "spectral-peak", "adaptive-notch", "fused")
SLOWEST_ESTIMATE_S = 1 / 300  # above, the estimator has fewer resonators: another program
NO_SLEW_PER_S = 1e30
"""Stands for no limit of the slew: no gain is changed by it, and single precision holds it times any gain."""


@dataclass(frozen=True)
class RuntimeFigures:
    """What the numbers of the control tick are made of; estimator and passive change are of its program."""

    sample_time_s: float = 1e-3
    metres_per_count: float = 2e-6
    estimator: str = "fused"
    hold_s: float = 0.2
    slew_per_s: float | None = 20.0  # None: no limit
    passive: bool = True
    guard_damping_ns_per_m: float = 2.0  # most that the guard adds: the device's own damping
    hand_m_per_unit: float = 1.0  # of the position: 1, or the handle radius, where the threshold of motion applies

    @property
    def values(self) -> tuple[float, float, float, float, int, int]:
        """The firmware's `avc_figures_t`."""
        slew = NO_SLEW_PER_S if self.slew_per_s is None else self.slew_per_s
        program = (ESTIMATOR_NUMBERS.index(self.estimator), int(self.passive))
        return (self.hold_s, slew, self.guard_damping_ns_per_m, self.hand_m_per_unit, *program)


@dataclass(frozen=True)
class BoardLimits:
    """Limits of a board; by default those of the boards. The last five latch a fault beyond them; 0: not watched."""

    sample_time_s: float = 1e-3
    metres_per_count: float = 2e-6
    max_force_n: float = 50.0  # full scale of the output
    max_damping_ns_per_m: float = 1e5  # of the wall too
    max_stiffness_n_per_m: float = 1e8  # of the wall too
    max_contact_damping_ns_per_m: float = 1e4
    max_speed_m_per_s: float = 3.0
    max_acceleration_m_per_s2: float = 1000.0  # beyond it the encoder has jumped
    max_energy_j: float = 0.2  # that a coupling may give out within about a second
    stuck_swing_n: float = 12.5  # a force that swings so, four times without one count: the encoder is stuck
    max_overruns: float = 5.0  # in a row

    @property
    def values(self) -> tuple[float, ...]:
        """The firmware's `avc_limits_t`."""
        return (
            self.sample_time_s,
            self.metres_per_count,
            self.max_force_n,
            self.max_damping_ns_per_m,
            self.max_stiffness_n_per_m,
            self.max_contact_damping_ns_per_m,
            self.max_speed_m_per_s,
            self.max_acceleration_m_per_s2,
            self.max_energy_j,
            self.stuck_swing_n,
            self.max_overruns,
        )

    @property
    def unwatched(self) -> BoardLimits:
        """The same without faults of motion."""
        names = ("max_speed_m_per_s", "max_acceleration_m_per_s2", "max_energy_j", "stuck_swing_n", "max_overruns")
        return replace(self, **dict.fromkeys(names, 0.0))


@dataclass(frozen=True)
class Config:
    """The firmware's `avc_config_t`: what a board is told, with or without a table."""

    limits: BoardLimits
    figures: RuntimeFigures


def actuator_m_per_s2(device: Device) -> float:
    """Return the acceleration of the lighter part of a device by its actuator alone; as of a board without a limit.

    Raises:
        UnsupportedError: the device has no mass.
    """
    if device.mass_kg == 0:
        message = f"device.{device.units.key('mass_kg')} is 0: C judges positions by it; give the moving mass"
        raise UnsupportedError(message, key="device.mass_kg")
    share = 0.0 if device.resonance is None else device.resonance.mass_ratio
    force = device.max_force_n or BoardLimits().max_force_n * device.metres_per_unit
    return force / (device.mass_kg * (min(share, 1 - share) or 1.0))


def board_limits(device: Device) -> BoardLimits:
    """Return the limits of force, gains, speed and acceleration of a board for a device, in the device's units.

    What a device does not state is that of the boards, at the radius of its handle.
    """
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


def device_config(device: Device) -> Config:
    """Return the configuration of a device without a coupling."""
    limits = board_limits(device)
    figures = RuntimeFigures(limits.sample_time_s, limits.metres_per_count, hand_m_per_unit=device.metres_per_unit)
    return Config(limits, figures)
