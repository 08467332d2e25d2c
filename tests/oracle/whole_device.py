"""The exported C of a coupling in a simulator of its own: the whole device by its equations, nothing of the project.

Only the numbers of the device are the problem's.
"""

import ctypes
import itertools
import math
from pathlib import Path

import numpy as np
from simulator_in_c import doubles, with_exported

_SOURCE = Path(__file__).with_name("whole_device.c")
_DEVICE, _DEED, _FOUND = map(
    str.split,
    (
        "mass damping time delay friction encoder bandwidth limit resonance ratio share dropped",
        "mass damping stiffness weight start velocity speed end centre swing frequency until",
        "motor_speed handle_speed force motor handle most",
    ),
)
_LENGTHS = {"start", "velocity", "speed", "end", "centre", "swing"}
SECONDS, TAIL_S, REST = 3.0, 0.5, 5e-3
TRIAL_SECONDS = 3.25

_Device, _Deed, _Found = doubles(_DEVICE), doubles(_DEED), doubles(_FOUND)


def declared(device, **changed):
    """The numbers of a problem's device, as they stand in its file."""
    mode = device.resonance
    numbers = {
        "mass": device.mass_kg,
        "damping": device.damping_ns_per_m,
        "time": device.sample_time_s,
        "delay": device.delay_samples,
        "friction": device.coulomb_friction_n,
        "encoder": device.encoder_resolution_m,
        "bandwidth": device.amplifier_bandwidth_hz or math.inf,
        "limit": device.max_force_n or math.inf,
        "resonance": mode.frequency_hz if mode else 0.0,
        "ratio": mode.damping_ratio if mode else 0.0,
        "share": mode.mass_ratio if mode else 0.0,
    }
    return _Device(**(numbers | changed))


def held(hand, speed):
    """A hand that reaches from 10 mm before the wall to 10 mm behind its face."""
    return _Deed(*hand, start=-0.01, speed=speed, end=0.01)


def tapping(hand):
    """A hand that strikes twice a second from 20 mm before the wall, and stays in it at the third time."""
    return _Deed(*hand, start=-0.005, centre=-0.005, swing=0.015, frequency=2.0, until=1.125, end=0.01)


def striking_again(hand):
    """A hand that reaches in like `held`, then leaves the wall and strikes it twice a second, three times."""
    goes = {"start": -0.01, "speed": 0.07, "end": 0.01, "centre": 0.01, "swing": 0.015, "frequency": 2.0}
    return _Deed(*hand, until=0.02 / 0.07 + 1.5, **goes)


def grasped(hand):
    """A device that rests at the face of the wall, and a hand that aims 10 mm behind it from the beginning."""
    return _Deed(*hand, end=0.01)


def thrown(velocity):
    """Let go, and flying at the wall."""
    return _Deed(start=-0.01, velocity=velocity)


def leaning(weight):
    """Let go, and lying on the wall by a weight."""
    return _Deed(weight=weight, start=-0.001)


def people(hands, drawn, seed):
    """The corners of [hands], then some of its inside."""
    box = np.array([hands.mass_kg, hands.damping_ns_per_m, hands.stiffness_n_per_m])
    inside = np.random.default_rng(seed).uniform(box[:, 0], box[:, 1], (drawn, 3))
    return [*itertools.product(*box), *map(tuple, inside)]


class WholeDevice:
    """A device that runs the exported files, by name."""

    def __init__(self, device, files):
        self.device, self._c = device, with_exported(files, _SOURCE)

    def meets(self, deed, seconds=SECONDS, tail_s=TAIL_S, **changed):
        """What is found over the last half second; `changed` are other numbers of the device."""
        device, found = declared(self.device, **changed), _Found()
        counts = (round(seconds / device.time), round(tail_s / device.time))
        self._c.whole_device(ctypes.byref(device), ctypes.byref(deed), *counts, ctypes.byref(found))
        return found


def rests_as_tried(bench, device, hands, friction=None, longest_s=TRIAL_SECONDS, **others):
    """Whether each hand, motor and handle rest in the three motions of a trial of `recommend`, shape (hands,).

    The device may be another one than that of the bench's exported files; one that turns goes as far at its rim. Who
    still moves is watched for so long. `others` are numbers that a problem's device does not have.
    """
    changed = {name: getattr(declared(device), name) for name in _DEVICE}
    changed |= others | ({} if friction is None else {"friction": friction})
    motions, radius = (lambda hand: held(hand, 0.07), striking_again, grasped), device.metres_per_unit

    def rests(deed):
        goes = {name: getattr(deed, name) / (radius if name in _LENGTHS else 1.0) for name in _DEED}
        watched = dict.fromkeys((TRIAL_SECONDS, longest_s))
        found = (bench.meets(_Deed(**goes), seconds, **changed) for seconds in watched)
        return any(max(one.motor_speed, one.handle_speed) * radius < REST for one in found)

    return np.array([all(rests(motion(hand)) for motion in motions) for hand in hands])
