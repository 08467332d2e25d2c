"""Logs of devices that never were, by a simulator in C that shares no code with the project."""

import ctypes
from dataclasses import asdict, dataclass, fields

import numpy as np
from simulator_in_c import doubles, pointers, simulator


@dataclass(frozen=True)
class Truth:
    """A device in SI units; 0 is what it does not have. The controller adds -spring*y - damper*dy/dt to the force.

    A spring to ground is `ground` at the handle, `rooted` at the motor. With a `loop_damping` ratio the amplifier is a
    current loop of the second order.
    """

    mass: float = 0.1
    damping: float = 2.0
    coulomb: float = 0.0
    asymmetry: float = 0.0
    breakaway: float = 0.0
    slow: float = 0.01
    delay: float = 1.0
    bandwidth: float = 0.0
    resonance: float = 0.0
    ratio: float = 0.05
    share: float = 0.4
    at_handle: float = 0.0
    encoder: float = 1e-6
    offset: float = 0.0
    drift: float = 0.0
    scale: float = 1.0
    ground: float = 0.0
    period: float = 1e-3
    spring: float = 0.0
    damper: float = 0.0
    rooted: float = 0.0
    loop_damping: float = 0.0


_Device = doubles(each.name for each in fields(Truth))


def multisine(random, seconds, period, low, high, rms, tones=60):
    """Sines of random phase, evenly spread over the logarithm of frequency."""
    time = np.arange(round(seconds / period)) * period
    frequencies = np.geomspace(low, high, tones)
    wave = np.sin(2 * np.pi * frequencies * time[:, None] + random.uniform(0, 2 * np.pi, tones)).sum(axis=1)
    return wave * rms / wave.std()


def measured(truth, wanted, random, noise=0.0, tremble=0.0):
    """Return time, measured position and commanded force; noise (m) and a trembling force (N) are white."""
    wanted = np.ascontiguousarray(wanted, dtype=float)
    size = wanted.size
    device = _Device(**asdict(truth))
    added = [np.ascontiguousarray(rms * random.standard_normal(size)) for rms in (noise, tremble)]
    position, force = np.empty(size), np.empty(size)
    simulator("measured_device")(ctypes.byref(device), size, *pointers(wanted, *added, position, force))
    return np.arange(size) * truth.period, position, force
