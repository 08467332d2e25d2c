"""Passivity of frozen renderings on the device as declared, over all frequencies up to Nyquist."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray, IndexArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.claims.passivity.handle_port import HandlePort, handle_port, least_loss_ns_per_m, response
from avc_casadi.claims.passivity.worst_frequency import lowest_of, refine_minima
from avc_casadi.loops.brackets import lowest
from avc_casadi.loops.sampled_loop import RIGID
from avc_casadi.model.hands import Hand

if TYPE_CHECKING:
    from avc_casadi.loops.sampled_loop import Fractions
    from avc_casadi.model.device import Device
    from avc_casadi.model.problem import Model


_LOWEST_TURNS = 1e-8
_A_DECADE = 150
# Below a hundredth of the sampling frequency the device hardly changes, and poles of a coupling are real.
_A_DECADE_BELOW = 60
_LOW_TURNS = 0.01
_A_HALF_WAVE = 24
_ZOOMS = 4
_HALVINGS = 44
_MOST_NS_PER_M = 1e12


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


class Slack(Protocol):
    """Slack of the passivity of some rows at a port of shape (m,) or (rows, m), and its rounding, shape (rows, m)."""

    def __call__(self, port: HandlePort, rows: IndexArray) -> tuple[FloatArray, FloatArray]:
        """Return the slack, not negative where the rows are passive, and its rounding error."""


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


class PortWorst(NamedTuple):
    """The worst of all frequencies and devices for n rows, each of shape (n,)."""

    passed: BoolArray
    margin_ns_per_m: FloatArray
    frequency_hz: FloatArray
    tolerance_ns_per_m: FloatArray


def frequencies_hz(device: Device) -> FloatArray:
    """Return frequencies, shape (m,), that resolve every pole of a port, the delay, and the end at Nyquist."""
    low = np.geomspace(_LOWEST_TURNS, _LOW_TURNS, round(_A_DECADE_BELOW * np.log10(_LOW_TURNS / _LOWEST_TURNS)))
    high = np.geomspace(_LOW_TURNS, 0.5, round(_A_DECADE * np.log10(0.5 / _LOW_TURNS)))
    even = np.linspace(0.0, 0.5, 1 + round(_A_HALF_WAVE * (device.delay_samples + 3)))[1:]
    return np.unique(np.concatenate([low, high, even, 0.5 - low[::4]])) / device.sample_time_s


def port_worst(devices: Sequence[Device], slack: Slack, rows: int, progress: Progress = SILENT) -> PortWorst:
    """Return the smallest slack over all frequencies and devices.

    A scan: the slack is a smooth function of the logarithm of the frequency, for the port has no lightly damped pole.
    """
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
        ends = hz[np.maximum(found - 1, 0)], hz[np.minimum(found + 1, len(hz) - 1)]
        at[own] = lowest(partial(_left, device, slack, own), *ends, _ZOOMS, hz[found])
        left, near = slack(handle_port(device, at[own, None]), own)
        passed[own] &= left[:, 0] >= -near[:, 0]
        margin[own] = _margin(device, slack, at[own], own, left[:, 0])
        tolerance[own] = near[:, 0] * (1e-12 + abs(least_loss_ns_per_m(device)))
    return PortWorst(passed, margin, at, tolerance)


def _left(device: Device, slack: Slack, rows: IndexArray, frequency_hz: FloatArray) -> FloatArray:
    return slack(handle_port(device, frequency_hz), rows)[0]


def _margin(device: Device, slack: Slack, frequency: FloatArray, rows: IndexArray, left: FloatArray) -> FloatArray:
    """Return the largest damping that can be removed from the handle at one frequency a row, N.s/m, by bisection."""

    def meets(taken: FloatArray) -> BoolArray:
        return np.asarray(slack(handle_port(device, frequency[:, None], taken[:, None]), rows)[0][:, 0] >= 0)

    most = np.full(len(rows), least_loss_ns_per_m(device))
    reach = 1e-3 * (1.0 + most)
    inside = np.where(left >= 0, 0.0, -reach)
    waiting = ~meets(inside)
    while waiting.any() and reach[0] < _MOST_NS_PER_M:
        reach = 4 * reach
        inside = np.where(waiting, -reach, inside)
        waiting = ~meets(inside)
    outside = np.where(left >= 0, most, 0.0)
    for _ in range(_HALVINGS):
        middle = (inside + outside) / 2
        fits = meets(middle)
        inside, outside = np.where(fits, middle, inside), np.where(fits, outside, middle)
    return np.where(waiting, -np.inf, inside)


def passive_hand(device: Device) -> Hand:
    """Return one passive hand: what is passive at the port and stable with it is stable with any."""
    mass, ten = max(device.mass_kg, device.damping_ns_per_m * device.sample_time_s, 1e-6), 10 * device.sample_time_s
    return Hand(*(np.array([value]) for value in (mass, mass / ten, mass / ten**2)))


_POINTS = 400
_TOLERANCE = 1e-12


def perceived_real(
    device: Device, parts: Fractions, contact_damping_ns_per_m: FloatArray, frequency_hz: FloatArray, model: Model
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Re Z_h, Z_h = Z_d + tau t A e W/(1 + A e W Y), of renderings at frequencies above 0."""
    port = response(device, frequency_hz)
    w = wave(parts, contact_damping_ns_per_m, frequency_hz * device.sample_time_s, model) * port.force
    closed = 1 + w * port.admittance
    share = np.abs(closed) ** 2
    added = (port.sent * port.seen * w * closed.conj()).real
    real = port.loss + added / np.where(share > 0, share, np.finfo(np.float64).tiny)
    return np.asarray(real), np.asarray(port.loss * share + added), np.asarray(port.loss + np.abs(w))


def impedance_at_handle(device: Device, rendered: ComplexArray, frequency_hz: FloatArray) -> ComplexArray:
    """Z_h of the device as declared, at its handle, for a rendering of the model 'sampled-data', N.s/m."""
    port = response(device, frequency_hz)
    force = rendered * np.sinc(frequency_hz * device.sample_time_s) ** 2 * port.force
    return np.asarray(port.alone + port.sent * port.seen * force / (1 + force * port.admittance))


def perceived_worst(
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

        def real(frequency: FloatArray, device: Device = device) -> FloatArray:
            return perceived_real(device, column, contact, frequency, model)[0]

        def smooth(frequency: FloatArray, device: Device = device) -> FloatArray:
            return perceived_real(device, column, contact, frequency, model)[1]

        low, high = (np.minimum(end, 0.5 / device.sample_time_s) for end in (low_hz, high_hz))
        points = low[:, None]
        if (high > low).any():
            points = np.clip(np.geomspace(low, high, _POINTS, axis=1), low[:, None], high[:, None])
            points = np.concatenate([refine_minima(real, points, 1), refine_minima(smooth, points, 1)], axis=1)
        values, _, size = perceived_real(device, column, contact, points, model)
        place = np.argmin(values, axis=1)
        found.append([values[rows, place], points[rows, place], _TOLERANCE * size[rows, place]])
    margin, at, rounding = lowest_of(found)
    return PortWorst(margin >= -rounding, margin, at, rounding)
