"""The perceived impedance at one frequency on the device as declared, its aliases left out as the paper leaves them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.passivity._handle_port import response
from avc_casadi.passivity._port_worst import PortWorst, wave
from avc_casadi.passivity._roots import refine_minima
from avc_casadi.support import ComplexArray, FloatArray, IndexArray

if TYPE_CHECKING:
    from avc_casadi.passivity._sampled import Fractions
    from avc_casadi.problem import Device, Model

_POINTS = 400
_TOLERANCE = 1e-12


def perceived_real(
    device: Device, parts: Fractions, contact_damping_ns_per_m: FloatArray, frequency_hz: FloatArray, model: Model
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Re Z_h, Z_h = Z_d + tau t A e W/(1 + A e W Y), of renderings at frequencies above 0.

    Args:
        device: known exactly.
        parts: partial fractions of the renderings in that model; all arguments broadcast.
        contact_damping_ns_per_m: b_p.
        frequency_hz: up to Nyquist.
        model: hold and discretisation of the wall.

    Returns:
        Re Z_h (N.s/m); the same times |1 + A e W Y|^2, which has no sharp peak where the motor oscillates against a
        handle that is held; and the size of the terms.
    """
    port = response(device, frequency_hz)
    w = wave(parts, contact_damping_ns_per_m, frequency_hz * device.sample_time_s, model) * port.force
    closed = 1 + w * port.admittance
    share = np.abs(closed) ** 2
    added = (port.sent * port.seen * w * closed.conj()).real
    real = port.loss + added / np.where(share > 0, share, np.finfo(np.float64).tiny)
    return np.asarray(real), np.asarray(port.loss * share + added), np.asarray(port.loss + np.abs(w))


def impedance_at_handle(device: Device, rendered: ComplexArray, frequency_hz: FloatArray) -> ComplexArray:
    """Z_h of the device as declared, at its handle, for a rendering of the model 'sampled-data', N.s/m.

    The model's W counts the force and the velocity in samples; at the frequency itself, which the aliases leave out, it
    is kappa = (sin(omega T/2)/(omega T/2))^2 times that.

    Args:
        device: known exactly.
        rendered: W without the delay, N.s/m, shape (n,).
        frequency_hz: above 0, shape (n,).
    """
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
    """Find the smallest Re Z_h over a band of each row and over devices, by a scan with refinement.

    Args:
        devices: corners of a device, each known exactly.
        parts: partial fractions of n renderings in that model.
        contact_damping_ns_per_m: b_p, shape (n,).
        low_hz: lower ends, above 0, shape (n,); equal to the upper ones for a single frequency.
        high_hz: upper ends, cut at Nyquist.
        model: hold and discretisation of the wall.
    """
    rows = len(low_hz)
    every = np.arange(rows)
    column = parts.pick((slice(None), None))
    contact = contact_damping_ns_per_m[:, None]
    least, rounding, at = np.full(rows, np.inf), np.zeros(rows), np.array(low_hz, dtype=np.float64)
    which: IndexArray = np.zeros(rows, dtype=np.intp)
    for index, device in enumerate(devices):
        nyquist = 0.5 / device.sample_time_s

        def real(frequency: FloatArray, device: Device = device) -> FloatArray:
            return perceived_real(device, column, contact, frequency, model)[0]

        def smooth(frequency: FloatArray, device: Device = device) -> FloatArray:
            return perceived_real(device, column, contact, frequency, model)[1]

        low, high = np.minimum(low_hz, nyquist), np.minimum(high_hz, nyquist)
        points = low[:, None]
        if (high > low).any():
            points = np.clip(np.geomspace(low, high, _POINTS, axis=1), low[:, None], high[:, None])
            points = np.concatenate([refine_minima(real, points, 1), refine_minima(smooth, points, 1)], axis=1)
        found, _, size = perceived_real(device, column, contact, points, model)
        lowest = np.argmin(found, axis=1)
        value = found[every, lowest]
        worse = value < least
        least = np.where(worse, value, least)
        at = np.where(worse, points[every, lowest], at)
        rounding = np.where(worse, _TOLERANCE * size[every, lowest], rounding)
        which = np.where(worse, index, which)
    return PortWorst(least >= -rounding, least, at, which, rounding)
