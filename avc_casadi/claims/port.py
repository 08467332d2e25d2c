"""The port between hand and device as declared, with a sampled rendering behind it.

The hand moves at all frequencies omega_n = omega + n omega_s at once, which the sampler aliases. With

    tau = Z_r/(Z_1 + Z_r)     motor velocity over handle velocity; Z_1 = m_1 s + b_d, Z_r = k_r/s + c_r; rigid: 1
    Y = 1/(Z_1 + Z_r)         motor admittance, the handle held (0 where the encoder sits at the handle, or rigid)
    R = b_d |tau|^2 + c_r |1 - tau|^2     real part of the impedance of the device alone
    A, e                      amplifier, exp(-j omega_n delay)
    kappa_n = (sin(omega T/2)/(omega_n T/2))^2     hold and sampler
    W = (Z_eavc + b_p)/z      the rendering

the impedance at the port is a diagonal matrix over n and one of rank 1, passive if and only if |1 + W X| >= |W| U,

    X = sum kappa A e (Y + tau t/(2R)),    U^2 = sum kappa |A|^2 |tau|^2/(2R) sum kappa |t|^2/(2R),

t being tau, or 1 for an encoder at the handle: stability with any passive hand, given that it is stable with one. Of a
rigid device with an ideal amplifier that is the condition of Colgate and Schenkel (1997): b_d + Re(z^-d W) >= 0.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray, IndexArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.claims.impedance import Mechanics, PortWorst, wave
from avc_casadi.loops.spectrum import lowest
from avc_casadi.loops.wall import RIGID, Fractions
from avc_casadi.model.device import Device
from avc_casadi.model.hands import Hand


@dataclass(frozen=True)
class HandlePort:
    """X, U and U^2 - |X|^2 of a device, each of the shape of the frequencies."""

    turns: FloatArray
    centre: ComplexArray
    spread: FloatArray
    excess: FloatArray
    damped: BoolArray


def handle_port(device: Device, frequency_hz: FloatArray, removal_ns_per_m: FloatArray | float = 0.0) -> HandlePort:
    """Return the port of a device at frequencies above 0, each with all its aliases."""
    turns, removal = np.broadcast_arrays(np.asarray(frequency_hz) * device.sample_time_s, removal_ns_per_m)
    mechanics = Mechanics(device)
    if mechanics.rigid and device.amplifier_bandwidth_hz is None:
        return HandlePort(turns, *_ideal(device, turns, removal))
    number, weight, last = _aliases(mechanics)
    at_once = max(1, 1_000_000 // len(number))
    some = [slice(begin, begin + at_once) for begin in range(0, turns.size, at_once)]
    parts = [_alias_sum(mechanics, number, weight, last, turns.ravel()[one], removal.ravel()[one]) for one in some]
    return HandlePort(turns, *(np.concatenate(each).reshape(turns.shape) for each in zip(*parts, strict=True)))


_Part = tuple[ComplexArray, FloatArray, FloatArray, BoolArray]


def _ideal(device: Device, turns: FloatArray, removal: FloatArray) -> _Part:
    """Return the port of a rigid, ideal device: closed sums over aliases, linear in a fraction f of a sample."""
    left = device.damping_ns_per_m - removal
    damped = left > 0
    half = np.where(damped, 0.5 / np.where(damped, left, 1.0), 0.0)
    whole = int(device.delay_samples)
    late = device.delay_samples - whole
    centre = half * (1 - late + late * np.exp(-2j * np.pi * turns)) * np.exp(-2j * np.pi * whole * turns)
    return centre, half, half**2 * 4 * late * (1 - late) * np.sin(np.pi * turns) ** 2, damped


def _aliases(mechanics: Mechanics) -> tuple[FloatArray, FloatArray, int]:
    """Return the indices n, 0 first, their weights, and the last plain one."""
    # A fraction of a sample leaves an oscillating tail, which is faded out.
    least = 400 if mechanics.device.delay_samples % 1 else 40
    last = max(least, math.ceil(4 * mechanics.fastest_turns))
    plain = np.arange(1.0, last + 2)
    plain_weight = np.ones(last + 1)
    plain_weight[-2:] = 23 / 24, 1 / 24
    node, share = np.polynomial.legendre.leggauss(12)
    node, share = (node + 1) / 2, share / 2
    far, far_weight = (last + 0.5) / node, (last + 0.5) * share / node**2
    number = np.concatenate([[0.0], plain, -plain, far, -far])
    return number, np.concatenate([[1.0], plain_weight, plain_weight, far_weight, far_weight]), last


def _alias_sum(
    mechanics: Mechanics, number: FloatArray, weight: FloatArray, last: int, turns: FloatArray, removal: FloatArray
) -> _Part:
    device = mechanics.device
    of = turns[:, None] + number
    s = np.asarray(2j * np.pi * of / device.sample_time_s, dtype=np.complex128)
    kappa = weight * (np.sin(np.pi * turns)[:, None] / (np.pi * of)) ** 2
    tau, admittance, loss = mechanics.transmission(s)
    left = loss - removal[:, None]
    damped: BoolArray = np.asarray((left > 0).all(axis=1))
    half = 0.5 / np.where(left > 0, left, 1.0)
    amplifier = mechanics.amplifier(s)
    late = device.delay_samples % 1
    delay = np.exp(-2j * np.pi * (int(device.delay_samples) * turns[:, None] + late * of))
    if late:
        delay *= np.cos(np.pi / 2 * np.clip(2 * np.abs(number) / last - 1, 0.0, 1.0)) ** 2
    force_gain = np.abs(amplifier) ** 2
    if mechanics.at_handle:
        centre, drive, sense = tau * half, np.abs(tau) ** 2 * half, half
        own = np.zeros_like(half[:, 0])
    else:
        centre = admittance + tau**2 * half
        drive = sense = np.abs(tau) ** 2 * half
        own = -(np.abs(admittance[:, 0]) ** 2) - 2 * half[:, 0] * (admittance[:, 0].conj() * tau[:, 0] ** 2).real
    x, u, v = kappa * amplifier * delay * centre, kappa * force_gain * drive, kappa * sense
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


@dataclass(frozen=True)
class RenderingSlack:
    """|1 + W X|^2 - |W|^2 U^2 of n renderings: on a rigid device without delay Re Z_h/b_d."""

    parts: Fractions
    contact_damping_ns_per_m: FloatArray

    def __call__(self, port: HandlePort, rows: IndexArray) -> tuple[FloatArray, FloatArray]:
        """Return the slack of some rows."""
        column = (rows, None)
        w = wave(self.parts.pick(column), self.contact_damping_ns_per_m[column], port.turns)
        size = np.abs(w)
        loss = size**2 * port.excess
        left = 1 + 2 * (w.real * port.centre.real - w.imag * port.centre.imag) - loss
        rounding = 1e-9 + 1e-12 * size * port.spread + 1e-8 * np.abs(loss)
        return np.where(port.damped, left, np.where(size == 0, 1.0, -np.inf)), np.where(port.damped, rounding, 0.0)


@dataclass(frozen=True)
class CouplingSlack:
    """The same for n couplings with every passive wall: the smallest slack over Z_e.

    Coupling and wall in series are (1 + e)/(2 Re(1/Z_c)), |e| <= 1, so that W lies in a disk of radius rho = 1/(2
    Re(1/Z_c)) about w_0 = (rho + b_p)/z; that of the passive renderings is another disk, or the outside of one. The
    first lies within where

        1 + 2 Re(w_0 X) - 2 U rho - (U^2 - |X|^2)(|w_0|^2 - rho^2) >= 0    and    U >= rho (U^2 - |X|^2).
    """

    damping_ns_per_m: FloatArray
    stiffness_n_per_m: FloatArray
    contact_damping_ns_per_m: FloatArray
    sample_time_s: float

    @property
    def valid(self) -> BoolArray:
        """Which couplings are passive themselves and not rigid, shape (n,)."""
        b, k = self.damping_ns_per_m, self.stiffness_n_per_m
        finite = (np.abs(b) <= RIGID) & (np.abs(k) <= RIGID)
        with np.errstate(over="ignore"):
            return np.asarray(finite & ((b + k * self.sample_time_s / 2 > 0) | ((b == 0) & (k == 0))))

    def __call__(self, port: HandlePort, rows: IndexArray) -> tuple[FloatArray, FloatArray]:
        """Return the slack of some rows."""
        column, valid = (rows, None), self.valid
        b, k = (np.where(valid, gain, 0.0)[column] for gain in (self.damping_ns_per_m, self.stiffness_n_per_m))
        contact = self.contact_damping_ns_per_m[column]
        half = k * self.sample_time_s / 2
        lead = b + half
        cotangent = np.sin(np.pi * (0.5 - port.turns)) / np.sin(np.pi * port.turns)
        rho = (lead + half * (half / np.where(lead > 0, lead, 1.0)) * cotangent**2) / 2
        x = port.centre * np.exp(-2j * np.pi * port.turns)
        size = np.abs(x)
        # U - Re x, which vanishes at low frequency while rho grows.
        lag = port.excess / np.where(port.spread > 0, port.spread + size, 1.0) + 2 * size * np.sin(np.angle(x) / 2) ** 2
        loss = 2 * rho * lag + port.excess * contact * (contact + 2 * rho)
        left = 1 + 2 * contact * x.real - loss
        left = np.where(port.damped & (port.spread >= rho * port.excess), left, -np.inf)
        left = np.where((rho == 0) & (contact == 0), 1.0, left)
        rounding = 1e-9 + 1e-12 * contact * size + 1e-8 * np.abs(loss)
        return np.where(valid[column], left, -np.inf), np.where(port.damped, rounding, 0.0)


Slack = RenderingSlack | CouplingSlack
"""Slack of some rows at a port of shape (m,) or (rows, m), not negative where passive, and its rounding error."""


def frequencies_hz(device: Device) -> FloatArray:
    """Return frequencies, shape (m,), that resolve every pole of a port, the delay, and the end at Nyquist."""
    # Below a hundredth of the sampling frequency the device hardly changes, and poles of a coupling are real.
    low, high = np.geomspace(1e-8, 0.01, 360), np.geomspace(0.01, 0.5, round(150 * np.log10(50)))
    even = np.linspace(0.0, 0.5, 1 + round(24 * (device.delay_samples + 3)))[1:]
    return np.unique(np.concatenate([low, high, even, 0.5 - low[::4]])) / device.sample_time_s


def port_worst(devices: Sequence[Device], slack: Slack, rows: int, progress: Progress = SILENT) -> PortWorst:
    """Return the smallest slack over all frequencies and devices, by a scan: the port has no lightly damped pole."""
    every, passed, scans = np.arange(rows), np.ones(rows, dtype=bool), []
    for index, device in enumerate(devices):
        progress.advance(index, len(devices), "passivity at the handle")
        left, near = slack(handle_port(device, frequencies_hz(device)), every)
        passed &= (left >= -near).all(axis=1)
        scans.append((left.min(axis=1), left.argmin(axis=1)))
    which = np.argmin([least for least, _ in scans], axis=0)
    margin, at, tolerance = np.full((3, rows), np.nan)
    for index, device in enumerate(devices):
        own = np.flatnonzero(which == index)
        if len(own) == 0:
            continue
        hz, found = frequencies_hz(device), scans[index][1][own]
        around = (hz[np.clip(found + side, 0, len(hz) - 1)] for side in (-1, 0, 1))

        def left_at(hz: FloatArray, device: Device = device, own: IndexArray = own) -> FloatArray:
            return slack(handle_port(device, hz[:, None]), own)[0][:, 0]

        at[own] = lowest(left_at, *around)
        left, near = slack(handle_port(device, at[own, None]), own)
        passed[own] &= left[:, 0] >= -near[:, 0]
        margin[own] = _margin(device, slack, at[own], own, left[:, 0])
        tolerance[own] = near[:, 0] * (1e-12 + abs(Mechanics(device).least_loss))
    return PortWorst(passed, margin, at, tolerance)


def _margin(device: Device, slack: Slack, frequency: FloatArray, rows: IndexArray, values: FloatArray) -> FloatArray:
    """Return the largest damping that can be removed from the handle at one frequency a row, N.s/m, by bisection."""

    def meets(removal: FloatArray) -> BoolArray:
        return np.asarray(slack(handle_port(device, frequency[:, None], removal[:, None]), rows)[0][:, 0] >= 0)

    most = np.full(len(rows), Mechanics(device).least_loss)
    reach = 1e-3 * (1.0 + most)
    inside = np.where(values >= 0, 0.0, -reach)
    waiting = ~meets(inside)
    while waiting.any() and reach[0] < 1e12:
        reach = 4 * reach
        inside = np.where(waiting, -reach, inside)
        waiting = ~meets(inside)
    outside = np.where(values >= 0, most, 0.0)
    for _ in range(44):
        middle = (inside + outside) / 2
        fits = meets(middle)
        inside, outside = np.where(fits, middle, inside), np.where(fits, outside, middle)
    return np.where(waiting, -np.inf, inside)


def passive_hand(device: Device) -> Hand:
    """Return one passive hand: what is passive at the port and stable with it is stable with any."""
    mass, ten = max(device.mass_kg, device.damping_ns_per_m * device.sample_time_s, 1e-6), 10 * device.sample_time_s
    return Hand(*(np.array([value]) for value in (mass, mass / ten, mass / ten**2)))
