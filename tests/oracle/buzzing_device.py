"""Logs of loops that buzz, by a simulator in C that shares no code with the project."""

import ctypes
from dataclasses import asdict, dataclass, fields

import numpy as np
from simulator_in_c import doubles, pointers, simulator

from avc_casadi.model.device import Device


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


def logged(loop, seconds=1.5):
    """Return time, measured position and commanded force at every tick."""
    samples = round(seconds / loop.period)
    noise, missed, position, force, hand = np.zeros((5, samples))
    simulator("buzzing_device")(
        ctypes.byref(_Device(**asdict(loop))), samples, *pointers(noise, missed, position, force, hand)
    )
    return np.arange(samples) * loop.period, position, force


def declared_of(loop):
    """What the file of the device says: the healthy loop."""
    numbers = {
        "mass_kg": loop.mass,
        "damping_ns_per_m": loop.damping,
        "sample_time_s": loop.period,
        "delay_samples": round(loop.delay, 3),
        "coulomb_friction_n": loop.friction,
        "encoder_resolution_m": loop.encoder,
        "max_force_n": loop.limit,
    }
    return Device.model_validate(numbers)
