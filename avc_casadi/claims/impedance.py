"""Impedance at the handle of a device as declared: alone, with a rendering, and against that of the wall itself."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray
from avc_casadi.claims.worst_frequency import lowest_of, refine_minima
from avc_casadi.loops.wall import Fractions
from avc_casadi.model.corners import device_with
from avc_casadi.model.device import Device
from avc_casadi.model.plant import DEVICE, device_plant
from avc_casadi.model.problem import Model, Problem


@dataclass(frozen=True)
class Mechanics:
    """Parameters of a device alone; a rigid device has infinite k_r."""

    device: Device

    @cached_property
    def rigid(self) -> bool:
        """Whether hand and motor move as one."""
        return self.device.resonance is None

    @cached_property
    def at_handle(self) -> bool:
        """Whether the encoder measures the handle beyond a resonance."""
        return not self.rigid and self.device.encoder_at == "handle"

    @cached_property
    def motor(self) -> tuple[float, float, float]:
        """m_1, k_r and c_r."""
        plant = device_plant(self.device)
        mass, row = float(plant.mass_kg(DEVICE)), plant.linear().matrix[1]
        return mass, mass * float(row[2]), mass * float(row[3])

    @cached_property
    def least_loss(self) -> float:
        """R towards infinite frequency."""
        return self.device.damping_ns_per_m if self.rigid else self.motor[2]

    @cached_property
    def fastest_turns(self) -> float:
        """The highest corner frequency, in turns a sample."""
        fastest = self.device.amplifier_bandwidth_hz or 0.0
        if not self.rigid:
            mass, stiffness, damping = self.motor
            ratio = self.device.damping_ns_per_m / damping if damping else 1.0
            fastest = max(fastest, math.sqrt(stiffness / mass) * max(1.0, ratio**0.25) / (2 * math.pi))
        return fastest * self.device.sample_time_s

    def amplifier(self, s: ComplexArray) -> ComplexArray:
        """Return force over command, without the delay."""
        if self.device.amplifier_bandwidth_hz is None:
            return np.ones_like(s)
        plant = device_plant(device_with(self.device, {"mass_kg": self.device.mass_kg or 1.0})).linear()
        rates, drive = plant.matrix[-1], plant.force[-1]
        if self.device.amplifier_order == 1:
            return np.asarray(drive / (s - rates[-1]))
        return np.asarray(drive / (s**2 - rates[-1] * s - rates[-2]))

    def transmission(self, s: ComplexArray) -> tuple[ComplexArray, ComplexArray, FloatArray]:
        """Return tau, the motor's admittance with the handle held, and R."""
        b = self.device.damping_ns_per_m
        if self.rigid:
            return np.ones_like(s), np.zeros_like(s), np.full(s.shape, b)
        mass, stiffness, damping = self.motor
        whole = stiffness + (damping + b) * s + mass * s**2
        tau, slip = (stiffness + damping * s) / whole, (b + mass * s) * s / whole
        return tau, s / whole, np.asarray(b * np.abs(tau) ** 2 + damping * np.abs(slip) ** 2)

    def alone(self, s: ComplexArray) -> ComplexArray:
        """Return the impedance of the device at its handle, without a force."""
        mass, b = self.device.mass_kg, self.device.damping_ns_per_m
        if self.rigid:
            return mass * s + b
        tau, (motor, _, _) = self.transmission(s)[0], self.motor
        return np.asarray((mass - motor) * s + (motor * s + b) * tau)


class Response(NamedTuple):
    """Frequency responses of a device at its handle: alone, R, t, tau t, Y and A e of the module of the port."""

    alone: ComplexArray
    loss: FloatArray
    sensor: ComplexArray
    through: ComplexArray
    admittance: ComplexArray
    force: ComplexArray


def response(device: Device, frequency_hz: FloatArray) -> Response:
    """Return the frequency responses of a device that is known exactly, at frequencies above 0."""
    mechanics = Mechanics(device)
    s = np.asarray(2j * np.pi * frequency_hz, dtype=np.complex128)
    tau, admittance, loss = mechanics.transmission(s)
    sensor, admittance = (np.ones_like(tau), np.zeros_like(tau)) if mechanics.at_handle else (tau, admittance)
    force = mechanics.amplifier(s) * np.exp(-s * device.delay_samples * device.sample_time_s)
    return Response(mechanics.alone(s), loss, sensor, tau * sensor, admittance, force)


def wave(
    parts: Fractions, contact_damping_ns_per_m: FloatArray, turns: FloatArray, model: Model = "sampled-data"
) -> ComplexArray:
    """W = H (Z_eavc + b_p), H = 1/z or the paper's (z + 1)/(2 z), without the device's delay."""
    half = np.pi * turns
    sine, cosine = np.sin(half), np.sin(np.pi * (0.5 - turns))
    z = np.exp(2j * half)
    hold = cosine * np.exp(-1j * half) if model == "paper" else 1 / z
    # H w/(1 - w): its real part, small beside a large number at low frequency, is written out.
    steps = 2 if model == "paper" else 3
    integral = (-np.sin(steps * half) - 1j * np.cos(steps * half)) / (2 * sine)
    integral = integral * cosine if model == "paper" else integral
    distance = parts.pole_gap + 2 * parts.pole * sine * (sine + 1j * cosine)
    decaying = parts.decaying / np.where(distance == 0, np.finfo(np.float64).tiny, distance)
    return np.asarray(hold * (parts.direct + contact_damping_ns_per_m + decaying / z) + parts.integral * integral)


class PortWorst(NamedTuple):
    """The worst of all frequencies and devices for n rows, each of shape (n,)."""

    passed: BoolArray
    margin_ns_per_m: FloatArray
    frequency_hz: FloatArray
    tolerance_ns_per_m: FloatArray


def real_impedance(
    device: Device, parts: Fractions, contact_damping_ns_per_m: FloatArray, frequency_hz: FloatArray, model: Model
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Re Z_h, Z_h = Z_d + tau t A e W/(1 + A e W Y), of renderings at frequencies above 0."""
    port = response(device, frequency_hz)
    w = wave(parts, contact_damping_ns_per_m, frequency_hz * device.sample_time_s, model) * port.force
    closed = 1 + w * port.admittance
    share = np.abs(closed) ** 2
    coupling = (port.through * w * closed.conj()).real
    real = port.loss + coupling / np.where(share > 0, share, np.finfo(np.float64).tiny)
    return np.asarray(real), np.asarray(port.loss * share + coupling), np.asarray(port.loss + np.abs(w))


def handle_impedance(
    device: Device, force_n_per_m: complex | ComplexArray, frequency_hz: FloatArray
) -> tuple[ComplexArray, ComplexArray]:
    """Return Z_h, N.s/m, and the measured position over the handle's, for a sampled force over the measured one."""
    port, turns = response(device, frequency_hz), frequency_hz * device.sample_time_s
    # Held for a sample, over a velocity.
    rendered = force_n_per_m * device.sample_time_s / np.expm1(2j * np.pi * turns)
    force = rendered * np.sinc(turns) ** 2 * port.force
    closed = 1 + force * port.admittance
    return np.asarray(port.alone + port.through * force / closed), np.asarray(port.sensor / closed)


def worst_real_impedance(
    devices: Sequence[Device],
    parts: Fractions,
    contact_damping_ns_per_m: FloatArray,
    low_hz: FloatArray,
    high_hz: FloatArray,
    model: Model,
) -> PortWorst:
    """Find the smallest Re Z_h over a band of each row and over devices, by a scan with refinement."""
    rows, found = np.arange(len(low_hz)), []
    column, contact = parts.pick((slice(None), None)), contact_damping_ns_per_m[:, None]
    for device in devices:

        def value(frequency: FloatArray, which: int, device: Device = device) -> FloatArray:
            return real_impedance(device, column, contact, frequency, model)[which]

        low, high = (np.minimum(end, 0.5 / device.sample_time_s) for end in (low_hz, high_hz))
        points = low[:, None]
        if (high > low).any():
            points = np.clip(np.geomspace(low, high, 400, axis=1), low[:, None], high[:, None])
            points = np.hstack([refine_minima(partial(value, which=one), points, 1) for one in (0, 1)])
        values, _, size = real_impedance(device, column, contact, points, model)
        place = np.argmin(values, axis=1)
        found.append([values[rows, place], points[rows, place], 1e-12 * size[rows, place]])
    margin, at, rounding = lowest_of(found)
    return PortWorst(margin >= -rounding, margin, at, rounding)


def stiffness_at_handle(device: Device, stiffness_n_per_m: float) -> float:
    """Return a stiffness at rest at the handle: with an encoder at the motor, the structure's compliance adds."""
    mechanics = Mechanics(device)
    if mechanics.rigid or mechanics.at_handle:
        return stiffness_n_per_m
    _, spring, _ = mechanics.motor
    return stiffness_n_per_m * spring / (stiffness_n_per_m + spring)


PRESS_N = 10.0
"""A firm press of a hand. The handle is excited about half of it, or half the force limit if that is less."""


@dataclass(frozen=True)
class Excitation:
    """A sinusoidal motion in the wall."""

    depth_m: float
    amplitude_m: float

    @classmethod
    def of(cls, device: Device, stiffness_n_per_m: float) -> Excitation:
        """Return the excitation about half of a firm press, or of the force limit, which never leaves the wall."""
        press_n = PRESS_N * device.metres_per_unit
        mean_n = min(press_n, press_n if device.max_force_n is None else device.max_force_n) / 2
        depth = mean_n / stiffness_n_per_m if stiffness_n_per_m > 0 else 0.01 / device.metres_per_unit
        return cls(depth, 0.5 * depth)


def below_quarter_rate(device: Device, frequency_hz: FloatArray) -> FloatArray:
    """Return the frequencies below a quarter of the sample rate; that itself where none remain."""
    quarter_hz = 0.25 / device.sample_time_s
    return np.array([hz for hz in frequency_hz if hz < quarter_hz] or [quarter_hz])


def target_impedance(problem: Problem, frequency_hz: FloatArray) -> tuple[ComplexArray, FloatArray]:
    """Return the impedance of device and continuous wall as one body, and the larger of it and the wall's own."""
    device, wall, s = problem.device, problem.environment, 2j * np.pi * frequency_hz
    own = wall.damping_ns_per_m + wall.stiffness_n_per_m / s
    target = device.mass_kg * s + device.damping_ns_per_m + own
    return target, np.maximum(np.abs(target), np.abs(own))


def rendered(problem: Problem, force_n_per_m: ComplexArray, frequency_hz: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the stiffness that a transfer from measured position to force renders at the handle, and its error."""
    device, s = problem.device, 2j * np.pi * frequency_hz
    alone = device.mass_kg * s + device.damping_ns_per_m
    impedance, _ = handle_impedance(device, force_n_per_m, frequency_hz)
    target, size = target_impedance(problem, frequency_hz)
    return np.abs((impedance - alone) * s), np.asarray(np.abs(impedance - target) / size)
