"""The port between hand and device as declared, with a sampled rendering behind it.

The hand moves at all frequencies omega_n = omega + n omega_s at once, which the sampler aliases. With

    tau = Z_r/(Z_1 + Z_r)     motor velocity over handle velocity; Z_1 = m_1 s + b_d, Z_r = k_r/s + c_r; rigid: 1
    Y = 1/(Z_1 + Z_r)         motor admittance, the handle held (0 where the encoder sits at the handle, or rigid)
    R = b_d |tau|^2 + c_r |1 - tau|^2     real part of the impedance of the device alone
    A, e                      amplifier, exp(-j omega_n delay)
    kappa_n = (sin(omega T/2)/(omega_n T/2))^2     hold and sampler; their sum over n is 1
    W = (Z_eavc + b_p)/z      the rendering

the impedance at the port is a diagonal matrix over n and one of rank 1. The Hermitian part of such a matrix is not
negative, by the two eigenvalues that may be, if and only if

    |1 + W X| >= |W| U,    X = sum kappa A e (Y + tau t/(2R)),
                           U^2 = sum kappa |A|^2 |tau|^2/(2R) sum kappa |t|^2/(2R),

t being tau, or 1 for an encoder at the handle. That is passivity of the sampled system at all these frequencies
together, and so stability with any passive hand, given that it is stable with one. For a rigid device with an ideal
amplifier and d samples of delay X = z^-d/(2 b_d), U = 1/(2 b_d), and the condition is that of Colgate and Schenkel
(1997): b_d + Re(z^-d W) >= 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray
from avc_casadi.model.corners import device_with
from avc_casadi.model.plant import DEVICE, device_plant

if TYPE_CHECKING:
    from avc_casadi.model.device import Device

_ALIASES = 40
# A fraction of a sample leaves an oscillating tail, which is faded out.
_ALIASES_OF_A_FRACTION = 400
_TAIL_NODES = 12
_NUMBERS_AT_ONCE = 1_000_000


@dataclass(frozen=True)
class HandlePort:
    """X, U and U^2 - |X|^2 of a device, each of the shape of the frequencies."""

    turns: FloatArray
    centre: ComplexArray
    spread: FloatArray
    excess: FloatArray
    damped: BoolArray


@dataclass(frozen=True)
class _Mechanics:
    """Parameters of a device alone; a rigid device has infinite k_r."""

    device: Device

    @cached_property
    def rigid(self) -> bool:
        return self.device.resonance is None

    @cached_property
    def at_handle(self) -> bool:
        return not self.rigid and self.device.encoder_at == "handle"

    @cached_property
    def _motor(self) -> tuple[float, float, float]:
        """m_1, k_r and c_r."""
        plant = device_plant(self.device)
        mass, row = float(plant.mass_kg(DEVICE)), plant.linear().matrix[1]
        return mass, mass * float(row[2]), mass * float(row[3])

    @cached_property
    def least_loss(self) -> float:
        """R towards infinite frequency."""
        return self.device.damping_ns_per_m if self.rigid else self._motor[2]

    @cached_property
    def fastest_turns(self) -> float:
        """The highest corner frequency, in turns a sample."""
        fastest = self.device.amplifier_bandwidth_hz or 0.0
        if not self.rigid:
            mass, stiffness, damping = self._motor
            ratio = self.device.damping_ns_per_m / damping if damping else 1.0
            fastest = max(fastest, math.sqrt(stiffness / mass) * max(1.0, ratio**0.25) / (2 * math.pi))
        return fastest * self.device.sample_time_s

    def amplifier(self, s: ComplexArray) -> ComplexArray:
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
        mass, stiffness, damping = self._motor
        whole = stiffness + (damping + b) * s + mass * s**2
        tau, slip = (stiffness + damping * s) / whole, (b + mass * s) * s / whole
        return tau, s / whole, np.asarray(b * np.abs(tau) ** 2 + damping * np.abs(slip) ** 2)

    def alone(self, s: ComplexArray) -> ComplexArray:
        """Return the impedance of the device at its handle, without a force."""
        mass, b = self.device.mass_kg, self.device.damping_ns_per_m
        if self.rigid:
            return mass * s + b
        tau, (motor, _, _) = self.transmission(s)[0], self._motor
        return np.asarray((mass - motor) * s + (motor * s + b) * tau)


def least_loss_ns_per_m(device: Device) -> float:
    """Return R towards infinite frequency: the most damping that can be removed from the handle of a passive loop."""
    return _Mechanics(device).least_loss


@dataclass(frozen=True)
class Response:
    """Frequency responses of a device at its handle, each of the shape of the frequencies."""

    alone: ComplexArray
    loss: FloatArray
    sent: ComplexArray
    seen: ComplexArray
    admittance: ComplexArray
    force: ComplexArray


def response(device: Device, frequency_hz: FloatArray) -> Response:
    """Return the frequency responses of a device that is known exactly, at frequencies above 0."""
    mechanics = _Mechanics(device)
    s = np.asarray(2j * np.pi * frequency_hz, dtype=np.complex128)
    tau, admittance, loss = mechanics.transmission(s)
    seen, admittance = (np.ones_like(tau), np.zeros_like(tau)) if mechanics.at_handle else (tau, admittance)
    force = mechanics.amplifier(s) * np.exp(-s * device.delay_samples * device.sample_time_s)
    return Response(mechanics.alone(s), loss, tau, seen, admittance, force)


def handle_port(device: Device, frequency_hz: FloatArray, taken_ns_per_m: FloatArray | float = 0.0) -> HandlePort:
    """Return the port of a device at frequencies above 0, each with all its aliases."""
    turns, taken = np.broadcast_arrays(np.asarray(frequency_hz) * device.sample_time_s, taken_ns_per_m)
    shape, turns, taken = turns.shape, turns.ravel(), taken.ravel()
    mechanics = _Mechanics(device)
    if mechanics.rigid and device.amplifier_bandwidth_hz is None:
        parts = [_ideal(device, turns, taken)]
    else:
        number, weight, last = _aliases(mechanics)
        at_once = max(1, _NUMBERS_AT_ONCE // len(number))
        starts = range(0, len(turns), at_once)
        parts = [
            _summed(mechanics, number, weight, last, turns[i : i + at_once], taken[i : i + at_once]) for i in starts
        ] or [_ideal(device, turns, taken)]
    centre, spread, excess, damped = (
        np.concatenate([part[index] for part in parts]).reshape(shape) for index in range(4)
    )
    return HandlePort(turns.reshape(shape), centre, spread.real, excess.real, damped.astype(bool))


_Part = tuple[ComplexArray, FloatArray, FloatArray, BoolArray]


def _ideal(device: Device, turns: FloatArray, taken: FloatArray) -> _Part:
    """Return the port of a rigid, ideal device: closed sums over aliases, linear in a fraction f of a sample."""
    left = device.damping_ns_per_m - taken
    damped = left > 0
    half = np.where(damped, 0.5 / np.where(damped, left, 1.0), 0.0)
    whole = int(device.delay_samples)
    late = device.delay_samples - whole
    centre = half * (1 - late + late * np.exp(-2j * np.pi * turns)) * np.exp(-2j * np.pi * whole * turns)
    return centre, half, half**2 * 4 * late * (1 - late) * np.sin(np.pi * turns) ** 2, damped


def _aliases(mechanics: _Mechanics) -> tuple[FloatArray, FloatArray, int]:
    """Return the indices n, 0 first, their weights, and the last plain one."""
    least = _ALIASES_OF_A_FRACTION if mechanics.device.delay_samples % 1 else _ALIASES
    last = max(least, math.ceil(4 * mechanics.fastest_turns))
    plain = np.arange(1.0, last + 2)
    plain_weight = np.ones(last + 1)
    plain_weight[-2:] = 23 / 24, 1 / 24
    node, share = np.polynomial.legendre.leggauss(_TAIL_NODES)
    node, share = (node + 1) / 2, share / 2
    far, far_weight = (last + 0.5) / node, (last + 0.5) * share / node**2
    number = np.concatenate([[0.0], plain, -plain, far, -far])
    return number, np.concatenate([[1.0], plain_weight, plain_weight, far_weight, far_weight]), last


def _summed(
    mechanics: _Mechanics, number: FloatArray, weight: FloatArray, last: int, turns: FloatArray, taken: FloatArray
) -> _Part:
    device = mechanics.device
    of = turns[:, None] + number
    s = np.asarray(2j * np.pi * of / device.sample_time_s, dtype=np.complex128)
    kappa = weight * (np.sin(np.pi * turns)[:, None] / (np.pi * of)) ** 2
    tau, admittance, loss = mechanics.transmission(s)
    left = loss - taken[:, None]
    damped: BoolArray = np.asarray((left > 0).all(axis=1))
    half = 0.5 / np.where(left > 0, left, 1.0)
    amplifier = mechanics.amplifier(s)
    late = device.delay_samples % 1
    delayed = np.exp(-2j * np.pi * (int(device.delay_samples) * turns[:, None] + late * of))
    if late:
        delayed *= np.cos(np.pi / 2 * np.clip(2 * np.abs(number) / last - 1, 0.0, 1.0)) ** 2
    force_gain = np.abs(amplifier) ** 2
    if mechanics.at_handle:
        centre, sent, seen = tau * half, np.abs(tau) ** 2 * half, half
        own = np.zeros_like(half[:, 0])
    else:
        centre = admittance + tau**2 * half
        sent = seen = np.abs(tau) ** 2 * half
        own = -(np.abs(admittance[:, 0]) ** 2) - 2 * half[:, 0] * (admittance[:, 0].conj() * tau[:, 0] ** 2).real
    x, u, v = kappa * amplifier * delayed * centre, kappa * force_gain * sent, kappa * seen
    x_rest, u_rest, v_rest = (np.sum(term[:, 1:], axis=1) for term in (x, u, v))
    excess = (
        kappa[:, 0] ** 2 * force_gain[:, 0] * own
        + u[:, 0] * v_rest
        + v[:, 0] * u_rest
        + u_rest * v_rest
        - 2 * (x[:, 0].conj() * x_rest).real
        - np.abs(x_rest) ** 2
    )
    spread = np.sqrt((u[:, 0] + u_rest) * (v[:, 0] + v_rest))
    return np.asarray(x[:, 0] + x_rest), np.asarray(spread), np.asarray(excess), damped
