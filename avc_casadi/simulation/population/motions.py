"""Motions of a trial and their duration: until the free response of hand and device would have decayed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from avc_casadi.model.device import Device
from avc_casadi.model.hands import hand_corners
from avc_casadi.model.problem import Problem
from avc_casadi.model.scene import Free, Hold, Motion, Press, Stroke
from avc_casadi.simulation.judge import AT_REST_M_PER_S

_TAP = Stroke(frequency_hz=2.0, amplitude_m=0.015, rest_s=2.0)
_TOUCH_M_PER_S = 0.03
MOTIONS: dict[str, Motion] = {
    "free": Free(frequency_hz=2.0, amplitude_m=0.008, rest_s=1.5),
    "press": Press(),
    # Leaves the wall and strikes it again twice a second, and ends in contact: in free space every coupling settles.
    "tap": _TAP,
    "hold": Hold(),
    "drag": Stroke(),
    # A hard impact may saturate the actuator and end in a limit cycle.
    "strike": Press(speed_m_per_s=0.3),
    "hit": Press(speed_m_per_s=0.6),
    "slam": Press(speed_m_per_s=1.0),
    # Under a light touch of a loose grip an observer may hop across its dead zone for ever.
    "touch": Press(end_m=5e-4, speed_m_per_s=_TOUCH_M_PER_S),
    # So light that dry friction mostly carries it; without any the device may bounce on the wall for ever.
    "graze": Press(end_m=2e-4, speed_m_per_s=_TOUCH_M_PER_S),
}
AT_WALL = ("press", "tap", "hold")
TRIAL_S = 4.25
"""Shortest duration of a motion.

Settling is judged two seconds after the last tap, which tells a decaying response from a sustained one."""
LONGEST_S = 30.0
"""Longest duration of a motion."""
LONGER_S = 12.0
"""Additional duration for hands that still move: a slow decay ends, a limit cycle does not."""
_DURATION_STEP_S = 0.25
"""Durations are whole multiples of it, so that similar devices share a scene."""
_TAP_ADDS = 1.25
"""Speed of an oscillation over that of its first tap: another tap may add to one that has not decayed."""


class Course(NamedTuple):
    """The motions of a trial, in the device's units, and their duration, at whose end settling is judged."""

    motions: dict[str, Motion]
    duration_s: float


def course_of(problem: Problem, more_s: float = 0.0) -> Course:
    """Return the motions with a device and their duration, s, with a longer rest where device and hand swing, and more.

    The rest is longer by the decay time of device and hand; `more_s` is added.
    """
    longer_s = float(np.clip(_decay_time_s(problem) - _TAP.rest_s, 0.0, LONGEST_S - TRIAL_S)) + more_s
    longer_s = _DURATION_STEP_S * float(np.ceil(longer_s / _DURATION_STEP_S))
    motions = {
        name: motion.model_copy(update={"rest_s": motion.rest_s + longer_s})
        if isinstance(motion, Free | Stroke)
        else motion
        for name, motion in motions_at(problem.device).items()
    }
    return Course(motions, TRIAL_S + longer_s)


def motions_at(device: Device) -> dict[str, Motion]:
    """Return the same motions of the hand at the handle of a rotary device, as angles."""
    return {name: at_handle(motion, device) for name, motion in MOTIONS.items()}


def at_handle(motion: Motion, device: Device) -> Motion:
    """Return a motion of the hand in the device's units."""
    radius = device.metres_per_unit
    lengths = {"start_m", "end_m", "speed_m_per_s", "amplitude_m"}
    return type(motion).model_validate(
        {key: value / radius if key in lengths else value for key, value in motion.model_dump().items()}
    )


def _decay_time_s(problem: Problem) -> float:
    """Return the longest time in which the speed of hand and device decays to rest after a tap, s, by their poles."""
    device, corners = problem.device, hand_corners(problem.hands)
    hand = corners.pick(np.flatnonzero(corners.stiffness_n_per_m > 0))  # no oscillation without a spring
    mass = device.mass_kg + hand.mass_kg
    damping = device.damping_ns_per_m + hand.damping_ns_per_m
    tap, way_m = 2 * np.pi * _TAP.frequency_hz, _TAP.amplitude_m + abs(_TAP.end_m - _TAP.start_m)
    with np.errstate(divide="ignore", invalid="ignore"):
        driving = hand.stiffness_n_per_m + 1j * tap * hand.damping_ns_per_m
        more = np.maximum(1.0, np.abs(driving / (hand.stiffness_n_per_m - mass * tap**2 + 1j * tap * damping)))
        half, square = damping / (2 * mass), hand.stiffness_n_per_m / mass
        spread = np.sqrt(np.maximum(half**2 - square, 0.0))
        fast, slow = half + spread, np.where(spread > 0, square / (half + spread), half)
        times_s = []
        for decay in (fast, slow):
            frequency = np.where(spread > 0, decay, np.sqrt(square))
            speed = _TAP_ADDS * more * np.minimum(tap * _TAP.amplitude_m, frequency * way_m)
            # Not a number where there is no such pole; below 0 where the speed never exceeds the threshold of settling.
            times_s.append(np.fmax(np.log(speed / AT_REST_M_PER_S) / decay, 0.0))
    return float(np.max(times_s, initial=0.0))
