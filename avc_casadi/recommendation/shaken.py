"""Rendered impedance by sinusoidal excitation of the handle, with encoder, observer, dead zone, one-sided wall."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi.claims.passivity.rendered_impedance import Excitation, Handle, below_quarter_rate
from avc_casadi.model.device import DeviceRange
from avc_casadi.model.hands import Hand
from avc_casadi.model.scene import Hold
from avc_casadi.simulation.execute import execute
from avc_casadi.simulation.population.setup import Setup, engine_for, prepare

if TYPE_CHECKING:
    from collections.abc import Sequence

    from avc_casadi._util.arrays import ComplexArray, FloatArray
    from avc_casadi.coupling import Coupling
    from avc_casadi.model.problem import Problem

TOLD_HZ = (1.0, 10.0, 50.0)
"""Frequencies at which a coupling's error is reported."""
# The handle is moved into the wall, the transient decays, and the response is recorded.
_RAMP_S, _SETTLED_S, _END_S = 0.25, 2.0, 4.0
# The motion is imposed by a mass far beyond the device's force, on a spring much faster than the motion.
_HEAVY, _FASTER, _LEAST_HZ = 1e7, 20.0, 30.0
# What lies between command and handle is linear and computed analytically.
_IDEAL: dict[str, Any] = {
    "delay_samples": 0,
    "coulomb_friction_n": 0.0,
    "amplifier_bandwidth_hz": None,
    "max_force_n": None,
    "resonance": None,
    "encoder_at": "motor",
    "range": DeviceRange(),
}


@dataclass(frozen=True)
class Shaken:
    """Impedance rendered to a handle excited about a mean depth.

    Attributes:
        depth_m: mean depth.
        amplitude_m: of the sine about it.
        frequency_hz: shape (n,), those below a quarter of the sample rate.
        stiffness_n_per_m: |Z_h - Z_d| omega, rendered beside the device, shape (n,).
        error: |Z_h - Z|/|Z| with the physical wall Z = m s + b_d + b_e + k_e/s, shape (n,).
        mismatch: |ln((Z_h - Z_d)/Z_e)|, rendered impedance over the wall b_e + k_e/s, shape (n,).
    """

    depth_m: float
    amplitude_m: float
    frequency_hz: FloatArray
    stiffness_n_per_m: FloatArray
    error: FloatArray
    mismatch: FloatArray

    def errors(self) -> dict[str, float]:
        """Return the error by frequency."""
        return {f"{hz:g}": float(error) for hz, error in zip(self.frequency_hz, self.error, strict=True)}

    def stiffnesses(self) -> dict[str, float]:
        """Return the stiffness by frequency."""
        return {f"{hz:g}": float(one) for hz, one in zip(self.frequency_hz, self.stiffness_n_per_m, strict=True)}


def shaken(
    coupling: Coupling,
    felt_n_per_m: float,
    frequency_hz: Sequence[float] | FloatArray = TOLD_HZ,
    *,
    wanted: Problem | None = None,
) -> Shaken:
    """Return the impedance rendered to the sinusoidally excited handle in the wall.

    By the force at the frequency of the motion (describing function: Gelb and Vander Velde 1968), without dry
    friction, which belongs to the device.
    """
    device = coupling.problem.device
    heard, excitation = below_quarter_rate(device, np.array(frequency_hz)), Excitation.of(device, felt_n_per_m)
    force = force_over_position(coupling, excitation, heard)
    found = Handle.of(wanted or coupling.problem, heard).rendered(force, excitation)
    return Shaken(**vars(excitation), frequency_hz=heard, **vars(found))


def force_over_position(coupling: Coupling, excitation: Excitation, frequency_hz: FloatArray) -> ComplexArray:
    """Return commanded force over measured position for imposed sines, N/m, shape (n,)."""
    period = coupling.problem.device.sample_time_s
    time = period * np.arange(round(_END_S / period) + 1)
    ramp = excitation.depth_m * np.clip(time / _RAMP_S, 0.0, 1.0)
    last = slice(round(_SETTLED_S / period), None)
    found = []
    for hz in frequency_hz:
        goes = ramp + excitation.amplitude_m * np.sin(2 * np.pi * hz * np.maximum(time - _RAMP_S, 0.0))
        position, force = (part[last] for part in led(coupling, goes, float(np.max(frequency_hz))))
        wave = np.exp(-2j * np.pi * hz * time[:-1][last]) * np.hanning(len(position))
        found.append(((force - force.mean()) @ wave) / ((position - position.mean()) @ wave))
    return np.array(found)


def led(
    coupling: Coupling,
    position_m: FloatArray,
    fastest_hz: float = 0.0,
    *,
    exact: bool = False,
) -> tuple[FloatArray, FloatArray]:
    """Return position and commanded force for an imposed motion, with an ideal actuator."""
    device = coupling.problem.device
    read = {"encoder_resolution_m": 0.0} if exact else {}
    setup = Setup.of(coupling, device.model_copy(update=_IDEAL | read)).without("guard")
    setup = replace(setup, steps_anywhere=False)
    fast = 2 * math.pi * max(_FASTER * fastest_hz, _LEAST_HZ)
    mass = _HEAVY * (device.mass_kg + coupling.problem.hands.mass_kg[1])
    hand = Hand(*(np.array([value]) for value in (mass, 2 * mass * fast, mass * fast**2)))
    samples, t = len(position_m) - 1, device.sample_time_s
    scene, parameters, held = prepare(setup, hand, Hold(end_m=0.0), samples * t)
    inputs = held.copy()
    inputs[scene.inputs.index("target_position_m")] = position_m[:-1]
    inputs[scene.inputs.index("target_velocity_m_per_s")] = np.diff(position_m) / t
    run = execute(scene, parameters, inputs, engine=engine_for(1))
    # Without a wall no force is commanded.
    return run["position_m"][0], run["force_n"][0] if "force_n" in run else np.zeros(samples)
