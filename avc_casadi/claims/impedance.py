"""Impedance at the handle of a device as declared: alone, with a rendering, and against that of the wall itself."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray
from avc_casadi.claims.worst_frequency import lowest_of, refine_minima
from avc_casadi.loops.wall import PartialFractions
from avc_casadi.model.corners import device_with
from avc_casadi.model.device import Device
from avc_casadi.model.plant import DEVICE, device_plant
from avc_casadi.model.problem import Model, Problem

_STEEPEST = 0.25
"""Power of the ratio of dampings in the highest corner frequency of a resonance."""
_SCAN_POINTS = 400
"""Frequencies of a scan over a band, before its lowest minima are refined."""
_ROUNDING = 1e-12
"""Rounding of Re Z_h, relative to the size of its terms."""


@dataclass(frozen=True)
class Motor:
    """The motor's side of a device with a resonance.

    Attributes:
        mass_kg: m_1.
        stiffness_n_per_m: k_r, between motor and handle.
        damping_ns_per_m: c_r, between motor and handle.
    """

    mass_kg: float
    stiffness_n_per_m: float
    damping_ns_per_m: float


@dataclass(frozen=True)
class Transmission:
    """How a device passes motion and force between handle and motor, at n frequencies.

    Attributes:
        tau: motor velocity over handle velocity.
        admittance: admittance of the motor with the handle held, m/(N.s).
        loss: R, real part of the impedance of the device alone, N.s/m.
    """

    tau: ComplexArray
    admittance: ComplexArray
    loss: FloatArray


@dataclass(frozen=True)
class PortMechanics:
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
    def motor(self) -> Motor:
        """m_1, k_r and c_r."""
        plant = device_plant(self.device)
        mass = float(plant.mass_kg(DEVICE))
        acceleration = plant.linear().matrix[1]
        return Motor(mass, mass * float(acceleration[2]), mass * float(acceleration[3]))

    @cached_property
    def least_loss(self) -> float:
        """R towards infinite frequency."""
        return self.device.damping_ns_per_m if self.rigid else self.motor.damping_ns_per_m

    @cached_property
    def fastest_turns(self) -> float:
        """The highest corner frequency of amplifier, resonance and motor, in turns a sample, f T."""
        fastest = self.device.amplifier_bandwidth_hz or 0.0
        if not self.rigid:
            motor = self.motor
            damping = motor.damping_ns_per_m
            ratio = self.device.damping_ns_per_m / damping if damping else 1.0
            resonance = math.sqrt(motor.stiffness_n_per_m / motor.mass_kg)
            fastest = max(fastest, resonance * max(1.0, ratio**_STEEPEST) / (2 * math.pi))
        return fastest * self.device.sample_time_s

    def amplifier(self, s: ComplexArray) -> ComplexArray:
        """Return force over commanded force at s, rad/s: 1, or a low pass of first or second order; without delay."""
        if self.device.amplifier_bandwidth_hz is None:
            return np.ones_like(s)
        plant = device_plant(device_with(self.device, {"mass_kg": self.device.mass_kg or 1.0})).linear()
        rates = plant.matrix[-1]
        drive = plant.force[-1]
        if self.device.amplifier_order == 1:
            return np.asarray(drive / (s - rates[-1]))
        return np.asarray(drive / (s**2 - rates[-1] * s - rates[-2]))

    def transmission(self, s: ComplexArray) -> Transmission:
        """Return tau = (k_r + c_r s)/D, Y = s/D and R = b_d |tau|^2 + c_r |1 - tau|^2 at s = j omega.

        D = m_1 s^2 + (c_r + b_d) s + k_r; a rigid device has tau = 1, Y = 0 and R = b_d.
        """
        b = self.device.damping_ns_per_m
        if self.rigid:
            return Transmission(np.ones_like(s), np.zeros_like(s), np.full(s.shape, b))
        mass = self.motor.mass_kg
        stiffness = self.motor.stiffness_n_per_m
        damping = self.motor.damping_ns_per_m
        denominator = stiffness + (damping + b) * s + mass * s**2
        tau = (stiffness + damping * s) / denominator
        slip = (b + mass * s) * s / denominator
        loss = b * np.abs(tau) ** 2 + damping * np.abs(slip) ** 2
        return Transmission(tau, s / denominator, np.asarray(loss))

    def alone(self, s: ComplexArray) -> ComplexArray:
        """Return the impedance of the device at its handle, without a force."""
        mass = self.device.mass_kg
        b = self.device.damping_ns_per_m
        if self.rigid:
            return mass * s + b
        motor_mass = self.motor.mass_kg
        return np.asarray((mass - motor_mass) * s + (motor_mass * s + b) * self.transmission(s).tau)


class HandleResponse(NamedTuple):
    """Frequency responses of a device at its handle, in the symbols of the module `port`.

    Attributes:
        alone: impedance of the device alone, N.s/m.
        loss: R, its real part, N.s/m.
        sensor: t, measured velocity over handle velocity.
        through: tau t.
        admittance: Y, m/(N.s); 0 where the encoder sits at the handle.
        force: A e, force over command with the delay.
    """

    alone: ComplexArray
    loss: FloatArray
    sensor: ComplexArray
    through: ComplexArray
    admittance: ComplexArray
    force: ComplexArray


def response(device: Device, frequency_hz: FloatArray) -> HandleResponse:
    """Return how handle, transmission, amplifier and sensor of an exactly known device answer, at frequencies above 0.

    The fields are its impedance alone, N.s/m, and the factors from command to force, from motor to handle and sensor.
    """
    mechanics = PortMechanics(device)
    s = np.asarray(2j * np.pi * frequency_hz, dtype=np.complex128)
    transmission = mechanics.transmission(s)
    tau = transmission.tau
    sensor = np.ones_like(tau) if mechanics.at_handle else tau
    return HandleResponse(
        alone=mechanics.alone(s),
        loss=transmission.loss,
        sensor=sensor,
        through=tau * sensor,
        admittance=np.zeros_like(tau) if mechanics.at_handle else transmission.admittance,
        force=mechanics.amplifier(s) * np.exp(-s * device.delay_samples * device.sample_time_s),
    )


def wave(
    parts: PartialFractions, contact_damping_ns_per_m: FloatArray, turns: FloatArray, model: Model = "sampled-data"
) -> ComplexArray:
    """Return W = H (Z_eavc + b_p), N.s/m, at turns f T, H = 1/z or the paper's (z + 1)/(2 z), without the delay.

    Z_eavc, coupling and environment in series, is given by its partial fractions `parts`, b_p is the contact damping.
    Small differences of large terms at low frequencies are written out.
    """
    half = np.pi * turns
    sine = np.sin(half)
    cosine = np.sin(np.pi * (0.5 - turns))
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
    """The worst of all frequencies and devices for n rows, each of shape (n,).

    Attributes:
        passed: whether it is passive.
        margin_ns_per_m: the smallest Re Z_h, or the damping to spare at the port.
        frequency_hz: the frequency of that.
        tolerance_ns_per_m: its rounding.
    """

    passed: BoolArray
    margin_ns_per_m: FloatArray
    frequency_hz: FloatArray
    tolerance_ns_per_m: FloatArray


@dataclass(frozen=True)
class RealImpedance:
    """Re Z_h at frequencies, N.s/m.

    Attributes:
        value: Re Z_h.
        undivided: Re Z_h |1 + A e W Y|^2, of the same sign, which a pole of the quotient does not blow up.
        size: magnitude of the terms: rounding is a multiple of it.
    """

    value: FloatArray
    undivided: FloatArray
    size: FloatArray


def real_impedance(
    device: Device,
    parts: PartialFractions,
    contact_damping_ns_per_m: FloatArray,
    frequency_hz: FloatArray,
    model: Model,
) -> RealImpedance:
    """Return Re Z_h, N.s/m, Z_h = Z_d + tau t A e W/(1 + A e W Y), of renderings at frequencies above 0.

    Z_d is the device alone, A the amplifier, e the delay, W the held rendering (`wave`), Y the admittance from motor to
    sensor; tau and t lead from the motor to the handle and to the sensor.
    """
    port = response(device, frequency_hz)
    w = wave(parts, contact_damping_ns_per_m, frequency_hz * device.sample_time_s, model) * port.force
    closed = 1 + w * port.admittance
    share = np.abs(closed) ** 2
    coupling = (port.through * w * closed.conj()).real
    real = port.loss + coupling / np.where(share > 0, share, np.finfo(np.float64).tiny)
    return RealImpedance(
        value=np.asarray(real),
        undivided=np.asarray(port.loss * share + coupling),
        size=np.asarray(port.loss + np.abs(w)),
    )


def handle_impedance(
    device: Device, force_n_per_m: complex | ComplexArray, frequency_hz: FloatArray
) -> tuple[ComplexArray, ComplexArray]:
    """Return Z_h at the handle, N.s/m, and the measured position over the handle's, of a sampled law.

    `force_n_per_m` is its force over the measured position, N/m, at each frequency, Hz; the force is held for a sample.
    """
    port = response(device, frequency_hz)
    turns = frequency_hz * device.sample_time_s
    # Held for a sample, over a velocity.
    rendered = force_n_per_m * device.sample_time_s / np.expm1(2j * np.pi * turns)
    force = rendered * np.sinc(turns) ** 2 * port.force
    closed = 1 + force * port.admittance
    return np.asarray(port.alone + port.through * force / closed), np.asarray(port.sensor / closed)


def worst_real_impedance(
    devices: Sequence[Device],
    parts: PartialFractions,
    contact_damping_ns_per_m: FloatArray,
    low_hz: FloatArray,
    high_hz: FloatArray,
    model: Model,
) -> PortWorst:
    """Return the least Re Z_h of each row over its band and over devices, N.s/m, and where, by a refined scan."""
    rows = np.arange(len(low_hz))
    worst_of_devices = []
    column = parts.pick((slice(None), None))
    contact = contact_damping_ns_per_m[:, None]
    for device in devices:
        real = partial(real_impedance, device, column, contact, model=model)
        low, high = (np.minimum(end, 0.5 / device.sample_time_s) for end in (low_hz, high_hz))
        points = low[:, None]
        if (high > low).any():
            points = np.clip(np.geomspace(low, high, _SCAN_POINTS, axis=1), low[:, None], high[:, None])
            points = _with_minima(real, points)
        impedance = real(points)
        place = np.argmin(impedance.value, axis=1)
        rounding = _ROUNDING * impedance.size[rows, place]
        worst_of_devices.append([impedance.value[rows, place], points[rows, place], rounding])
    margin, frequency_hz, rounding = lowest_of(worst_of_devices)
    return PortWorst(margin >= -rounding, margin, frequency_hz, rounding)


def _with_minima(real: Callable[[FloatArray], RealImpedance], points: FloatArray) -> FloatArray:
    """Return sorted points (n, m) with the refined minima of Re Z_h and of its undivided form beside them."""
    of_value = refine_minima(lambda frequency_hz: real(frequency_hz).value, points, 1)
    of_undivided = refine_minima(lambda frequency_hz: real(frequency_hz).undivided, points, 1)
    return np.hstack([of_value, of_undivided])


def stiffness_at_handle(device: Device, stiffness_n_per_m: float) -> float:
    """Return a stiffness at rest at the handle: with an encoder at the motor, the structure's compliance adds."""
    mechanics = PortMechanics(device)
    if mechanics.rigid or mechanics.at_handle:
        return stiffness_n_per_m
    spring = mechanics.motor.stiffness_n_per_m
    return stiffness_n_per_m * spring / (stiffness_n_per_m + spring)


def moving_stiffness_at_handle(device: Device, force_n_per_m: ComplexArray, frequency_hz: FloatArray) -> FloatArray:
    """Return force over position at the handle for a sampled force over the measured position, without the device.

    It is |s (Z_h - m s - b)|, with the mass m and the damper b of the device as a rigid body. A stiff device, or an
    encoder at the handle, has no structure between both: there it is the size of the sampled force over the position.
    """
    mechanics = PortMechanics(device)
    if mechanics.rigid or mechanics.at_handle:
        return np.abs(force_n_per_m)
    s = 2j * np.pi * frequency_hz
    with_force = handle_impedance(device, force_n_per_m, frequency_hz)[0]
    return np.asarray(np.abs(s * (with_force - device.mass_kg * s - device.damping_ns_per_m)))


PRESS_N = 10.0
"""A firm press of a hand, N. The handle is excited about half of it, or half the force limit if that is less."""
FREE_DEPTH_M = 0.01
"""Depth of the motion where there is no stiffness to press against, m."""


@dataclass(frozen=True)
class HandExcitation:
    """A sinusoidal motion in the wall.

    Attributes:
        depth_m: its mean depth, m.
        amplitude_m: its amplitude, m: half of the depth, so that it never leaves the wall.
    """

    depth_m: float
    amplitude_m: float

    @classmethod
    def of(cls, device: Device, stiffness_n_per_m: float) -> HandExcitation:
        """Return the excitation about half of a firm press, or of the force limit, which never leaves the wall."""
        press_n = PRESS_N * device.metres_per_unit
        mean_n = min(press_n, press_n if device.max_force_n is None else device.max_force_n) / 2
        depth = mean_n / stiffness_n_per_m if stiffness_n_per_m > 0 else FREE_DEPTH_M / device.metres_per_unit
        return cls(depth, 0.5 * depth)


def below_quarter_rate(device: Device, frequency_hz: FloatArray) -> FloatArray:
    """Return the frequencies below a quarter of the sample rate; that itself where none remain."""
    quarter_hz = 0.25 / device.sample_time_s
    return np.array([hz for hz in frequency_hz if hz < quarter_hz] or [quarter_hz])


def target_impedance(problem: Problem, frequency_hz: FloatArray) -> tuple[ComplexArray, FloatArray]:
    """Return the impedance Z of device and continuous wall as one body, N.s/m, and max(|Z|, |Z_e|), Z_e the wall's own.

    Z_e = b_e + k_e/s and Z = m s + b_d + Z_e, m and b_d of the device, s = j 2 pi f.
    """
    device = problem.device
    wall = problem.environment
    s = 2j * np.pi * frequency_hz
    wall_impedance = wall.damping_ns_per_m + wall.stiffness_n_per_m / s
    target = device.mass_kg * s + device.damping_ns_per_m + wall_impedance
    return target, np.maximum(np.abs(target), np.abs(wall_impedance))


def rendered(problem: Problem, force_n_per_m: ComplexArray, frequency_hz: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the stiffness that a law renders at the handle, N/m, and its error, at each frequency.

    The law is its transfer from measured position to force. With Z_h the impedance at the handle, m and b_d of the
    device and Z of `target_impedance`, they are |(Z_h - m s - b_d) s| and |Z_h - Z|/max(|Z|, |Z_e|).
    """
    device = problem.device
    s = 2j * np.pi * frequency_hz
    alone = device.mass_kg * s + device.damping_ns_per_m
    impedance, _ = handle_impedance(device, force_n_per_m, frequency_hz)
    target, size = target_impedance(problem, frequency_hz)
    return np.abs((impedance - alone) * s), np.asarray(np.abs(impedance - target) / size)
