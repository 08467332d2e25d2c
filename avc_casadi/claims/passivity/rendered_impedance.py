"""Impedance rendered to a handle that moves sinusoidally in the wall, against the impedance of the wall itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi.claims.passivity.worst_port import impedance_at_handle
from avc_casadi.paper.equations import SampleAngle, environment_impedance
from avc_casadi.paper.loop import loop_at
from avc_casadi.paper.numbers import NUMPY

if TYPE_CHECKING:
    from avc_casadi.model.device import Device
    from avc_casadi.model.problem import Impedance, Problem

PRESS_N = 10.0
"""A firm press of a hand. The handle is excited about half of it, or half the force limit if that is less."""
# Amplitude over mean depth: the handle never leaves the wall.
_SHARE = 0.5
# Mean depth for a wall without a spring.
_DEPTH_M = 0.01
# Samples of a period, for the wall's own force.
_A_PERIOD = 1024
# A smaller share of the wall counts as zero.
_NOTHING = 1e-9


@dataclass(frozen=True)
class Excitation:
    """A sinusoidal motion in the wall."""

    depth_m: float
    amplitude_m: float

    @classmethod
    def of(cls, device: Device, stiffness_n_per_m: float) -> Excitation:
        """Return the excitation about half of a firm press, or of the force limit."""
        press_n = PRESS_N * device.metres_per_unit
        mean_n = min(press_n, press_n if device.max_force_n is None else device.max_force_n) / 2
        depth = mean_n / stiffness_n_per_m if stiffness_n_per_m > 0 else _DEPTH_M / device.metres_per_unit
        return cls(depth, _SHARE * depth)


def below_quarter_rate(device: Device, frequency_hz: FloatArray) -> FloatArray:
    """Return the frequencies below a quarter of the sample rate; that itself where none remain."""
    quarter_hz = 0.25 / device.sample_time_s
    return np.array([hz for hz in frequency_hz if hz < quarter_hz] or [quarter_hz])


@dataclass(frozen=True)
class Rendered:
    """Rendered impedance at the handle by frequency, each of shape (..., n)."""

    stiffness_n_per_m: FloatArray
    error: FloatArray
    mismatch: FloatArray


@dataclass(frozen=True)
class Handle:
    """The handle of a device in front of a wall, at some frequencies."""

    device: Device
    environment: Impedance
    frequency_hz: FloatArray
    unit: ComplexArray

    @classmethod
    def of(cls, problem: Problem, frequency_hz: FloatArray) -> Handle:
        """Return the handle of a problem's device."""
        device = problem.device
        loop = loop_at(problem.changed(stability={"model": "sampled-data"}), frequency_hz)
        angle = SampleAngle.at(NUMPY, frequency_hz, device.sample_time_s)
        # The hold includes the delay, which belongs to the port of the handle.
        on_time = np.exp(2j * np.pi * frequency_hz * device.delay_samples * device.sample_time_s)
        unit = loop.hold * environment_impedance(angle, "sampled-data", 0.0, 1.0) * on_time
        return cls(device, problem.environment, frequency_hz, np.asarray(unit))

    def rendered(self, force_n_per_m: ComplexArray, excitation: Excitation) -> Rendered:
        """Return what a transfer from measured position to force renders."""
        device, wall, s = self.device, self.environment, 2j * np.pi * self.frequency_hz
        alone = device.mass_kg * s + device.damping_ns_per_m
        felt = impedance_at_handle(device, force_n_per_m * self.unit, self.frequency_hz)
        wanted = alone + wall.damping_ns_per_m + wall.stiffness_n_per_m / s
        spring = (felt - alone) * s
        own = wall_over_position(wall, excitation, self.frequency_hz)
        return Rendered(np.abs(spring), np.asarray(np.abs(felt - wanted) / np.abs(wanted)), _log_ratio(spring, own))


def wall_over_position(wall: Impedance, excitation: Excitation, frequency_hz: FloatArray) -> ComplexArray:
    """Return max(0, k_e x + b_e dx/dt) over x, N/m, at the frequency of a sine about a depth, shape (n,)."""
    angle, amplitude = 2 * np.pi * np.arange(_A_PERIOD) / _A_PERIOD, excitation.amplitude_m
    moved, speed = amplitude * np.sin(angle), 2 * np.pi * frequency_hz[:, None] * amplitude * np.cos(angle)
    force = np.maximum(0.0, wall.stiffness_n_per_m * (excitation.depth_m + moved) + wall.damping_ns_per_m * speed)
    wave = np.exp(-1j * angle)
    return np.asarray((force @ wave) / (moved @ wave))


def _log_ratio(rendered: ComplexArray, wanted: NDArray[np.complexfloating[Any, Any]]) -> FloatArray:
    """Return |ln(rendered/wanted)|, 0 where both vanish."""
    there = wanted != 0
    ratio = np.where(there, rendered / np.where(there, wanted, 1.0), 1.0)
    return np.asarray(np.abs(np.log(np.where(np.abs(ratio) > _NOTHING, ratio, _NOTHING))))
