"""The mass that the force of a log moves, from the motion up to its largest speed."""

from __future__ import annotations

import itertools
import math

import numpy as np
from scipy import ndimage

from avc_casadi.diagnose.oscillation import Log
from avc_casadi.identification.regression import regression
from avc_casadi.model.device import Device

_AT_REST_SHARE = 0.03
"""Share of the largest speed below which a motion begins."""

_FEWEST_MOVING = 8
"""Samples of a motion below which its mass is not told."""

_MOVED_BY_FORCE_SHARE = 0.05
"""Share of the motion that a force leaves unexplained at most, where it moves the device."""


def apparent_mass_kg(log: Log, device: Device, *, known: bool) -> float:
    """Return the mass that the force moves up to the largest speed; negative along the motion, infinite for none.

    x(t) = -(1/m) (double integral of F + drag) + a start, a speed and, in a second trial, a constant push. The force is
    summed twice as a held one acts. Drag and friction are those of a known device, against the motion or with it. Of
    an unknown device the drag is a part of the fit, c/m times the integral of x.
    """
    sample_time = log.sample_time_s
    force = log.held_force_n()
    speed = np.abs(ndimage.uniform_filter1d(np.gradient(log.samples_m), 5))
    peak = int(np.argmax(speed))
    delay = round(device.delay_samples * device.sample_time_s / sample_time)
    first = int(np.flatnonzero(np.append(True, speed[:peak] < _AT_REST_SHARE * speed[peak]))[-1])
    # Of a motion that is fastest within the delay of the log's start, no force is in the log.
    force = force[max(first - delay, 0) : max(peak - delay + 1, 0)]
    if force.size < _FEWEST_MOVING or not force.any():
        return math.inf
    x = log.samples_m[peak + 1 - force.size : peak + 1]
    time = sample_time * np.arange(force.size)
    twice = np.append(0.0, np.cumsum(np.cumsum(force) - force / 2)[:-1]) * sample_time**2
    path = np.cumsum(x - x[:1]) * sample_time
    drag = known * device.damping_ns_per_m * path
    drag += known * device.coulomb_friction_n * time**2 / 2 * np.sign(x[-1:] - x[:1])
    for powers, sign in itertools.product((2, 3), (1, -1)):
        start = np.vander(time / time[-1], powers)
        if not known:
            start = np.column_stack([start, path])
        fit = regression(np.column_stack([twice + sign * drag, start]), x)
        without_force = regression(start, x)
        if fit is None or without_force is None:
            continue
        factors, residual = fit
        _, moved = without_force
        clear = residual < max(_MOVED_BY_FORCE_SHARE * moved, 0.5 * log.encoder_m) and moved > 2 * log.encoder_m
        if clear and factors[0] * sign < 0:
            return -1 / float(factors[0])
    return math.inf
