"""Logs of loops that buzz, by a simulator in C that shares no code with the project."""

import ctypes
from dataclasses import asdict, dataclass, fields

import numpy as np
from simulator_in_c import doubles, pointers, simulator


@dataclass(frozen=True)
class Buzzing:
    """A loop in SI units; `lag` delays the force before it is logged, `delay` after that, both in samples.

    From `grab` on (s) the spring holds the place where the device is then; from `bias_from` on a force of `bias` stands
    beside it while it touches. `notch` is a filter of the measured position (Hz, 0 none). With a grip the hand is a
    mass behind it, as on a stylus.
    """

    mass: float = 0.1
    damping: float = 2.0
    friction: float = 0.0
    delay: float = 1.0
    lag: float = 0.0
    bandwidth: float = 0.0
    resonance: float = 0.0
    ratio: float = 0.03
    share: float = 0.4
    encoder: float = 1e-6
    limit: float = 50.0
    period: float = 1e-3
    stiffness: float = 1000.0
    damper: float = 5.0
    keep: float = 0.0
    two_sided: float = 0.0
    hand_mass: float = 0.12
    hand_damping: float = 8.0
    hand_stiffness: float = 400.0
    release: float = 1e9
    weight: float = 0.0
    start: float = -0.005
    speed: float = 0.07
    end: float = 0.01
    sway: float = 0.0
    grab: float = 0.0
    bias: float = 0.0
    bias_from: float = 0.0
    notch: float = 0.0
    depth: float = 0.1
    width: float = 1.0
    grip_stiffness: float = 0.0
    grip_damping: float = 0.0


_Device = doubles(each.name for each in fields(Buzzing))


def played(loop, seconds=1.5, missed=None, noise_m=0.0, random=None):
    """Return time, measured position, commanded force and where the hand is, at every tick; `missed` marks some."""
    samples = round(seconds / loop.period)
    missed = np.zeros(samples) if missed is None else np.ascontiguousarray(missed, dtype=float)
    noise = np.zeros(samples) if random is None else noise_m * random.standard_normal(samples)
    position, force, hand = np.empty(samples), np.empty(samples), np.empty(samples)
    arrays = pointers(noise, missed, position, force, hand)
    simulator("buzzing_device")(ctypes.byref(_Device(**asdict(loop))), samples, *arrays)
    return np.arange(samples) * loop.period, position, force, hand


def logged(loop, seconds=1.5, missed=None, noise_m=0.0, random=None):
    """Return time, measured position and commanded force of the ticks that ran; `missed` marks those that did not."""
    columns = played(loop, seconds, missed, noise_m, random)[:3]
    return columns if missed is None else tuple(column[np.asarray(missed) == 0] for column in columns)
