"""Motions of a trial and their durations: until the free response of hand and device would have decayed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.model.hands import hand_corners
from avc_casadi.model.scene import Hold, Motion, Press, Stroke
from avc_casadi.simulation.judge import AT_REST_M_PER_S

if TYPE_CHECKING:
    from avc_casadi.model.device import Device
    from avc_casadi.model.problem import Problem


# Peak displacement at the detection threshold of a hand in a pen-hold posture, approximately after Israr, Choi and Tan
# (IROS 2006, "Detection threshold and mechanical impedance of the hand in a pen-hold posture"); read off, indicative.
THRESHOLD_HZ = np.array([10.0, 20.0, 40.0, 80.0, 160.0, 320.0, 500.0])
THRESHOLD_M = np.array([20e-6, 12e-6, 5e-6, 1.6e-6, 0.5e-6, 0.25e-6, 0.7e-6])
JUDGED_S = 0.5
QUIET = 1.0
"""Multiple of the vibrotactile detection threshold below which a vibration is not detected."""
# Mean square of Hann's window over its squared mean.
_HANN_BANDWIDTH = 1.5


def felt_vibration(position_m: FloatArray, sample_time_s: float) -> FloatArray:
    """Return the vibration at the end of runs in multiples of the vibrotactile detection threshold.

    The peak displacement of each frequency from 10 to 500 Hz over its threshold; several add as the root of the sum of
    squares. The last half second counts, a straight drift taken out.
    """
    last = position_m[..., -max(8, round(JUDGED_S / sample_time_s)) :]
    n = last.shape[-1]
    time = np.linspace(-1.0, 1.0, n)
    with np.errstate(invalid="ignore", over="ignore"):
        slope = (last * time).sum(axis=-1, keepdims=True) / (time**2).sum()
        moved = last - last.mean(axis=-1, keepdims=True) - slope * time
        window = np.hanning(n)
        peak = 2 * np.abs(np.fft.rfft(moved * window, axis=-1)) / window.sum()
        frequency = np.fft.rfftfreq(n, sample_time_s)
        heard = (frequency >= THRESHOLD_HZ[0]) & (frequency <= THRESHOLD_HZ[-1])
        ratio = peak[..., heard] / threshold_m(frequency[heard])
        whole = np.sqrt((ratio**2).sum(axis=-1) / _HANN_BANDWIDTH)
    return np.asarray(np.where(np.isfinite(whole), whole, np.inf))


def threshold_m(frequency_hz: FloatArray) -> FloatArray:
    """Return the detection threshold (peak displacement, m), interpolated log-log, shape (n,)."""
    return np.asarray(np.exp(np.interp(np.log(frequency_hz), np.log(THRESHOLD_HZ), np.log(THRESHOLD_M))))


_TAP = Stroke(frequency_hz=2.0, amplitude_m=0.015)
# A tap leaves the wall and strikes it again twice a second, and ends in contact: in free space every coupling settles.
MOTIONS: dict[str, Motion] = {"press": Press(), "tap": _TAP, "hold": Hold()}
_TOUCH_M_PER_S = 0.03
BEYOND: tuple[Motion, ...] = (Press(speed_m_per_s=0.3), Press(end_m=5e-4, speed_m_per_s=_TOUCH_M_PER_S))
"""Beyond the reported motions. A hard impact may saturate the actuator and end in a limit cycle; under a light touch of
a loose grip an observer may hop across its dead zone for ever."""
LIGHTEST: Motion = Press(end_m=2e-4, speed_m_per_s=_TOUCH_M_PER_S)
"""A touch so light that declared dry friction mostly carries it, and always acts. Without any friction the device may
bounce on the wall for ever."""
# A quarter of a second more than the paper's experiment: settling is judged a second after the last tap, which tells a
# decaying response from a sustained one.
TRIAL_S = 3.25
"""Shortest duration of a motion."""
LONGEST_S = 30.0
"""Longest duration of a motion."""
# Margin on the initial speed: a tap may add to an oscillation that has not decayed.
_SURELY = 1.25
# Durations are rounded up to multiples of this, so that similar devices share a scene.
_STEP_S = 0.25

Watched: TypeAlias = tuple[Motion, float]
"""A motion with its duration, s, at whose end settling is judged."""


@dataclass(frozen=True)
class Course:
    """The motions of a trial, in the device's units."""

    motions: dict[str, Watched]
    beyond: tuple[Watched, ...]
    lightest: Watched

    @property
    def longest_s(self) -> float:
        """Duration of the longest motion."""
        return self.motions["press"][1]


def course_of(problem: Problem) -> Course:
    """Return the motions with a device, lengthened where device and hand alone oscillate for long.

    An oscillation that is there without the coupling is not the coupling's.
    """
    longer_s = float(np.clip(_swinging_s(problem) - _TAP.rest_s, 0.0, LONGEST_S - TRIAL_S))
    longer_s = _STEP_S * float(np.ceil(longer_s / _STEP_S))

    def watched(motion: Motion) -> Watched:
        return _resting(at_handle(motion, problem.device), longer_s), TRIAL_S + longer_s

    return Course(
        {name: watched(motion) for name, motion in MOTIONS.items()}, tuple(map(watched, BEYOND)), watched(LIGHTEST)
    )


def _resting(motion: Motion, longer_s: float) -> Motion:
    """Lengthen the pause at the end of an oscillating motion; the others pause for the time that is left."""
    if longer_s and isinstance(motion, Stroke):
        return motion.model_copy(update={"rest_s": motion.rest_s + longer_s})
    return motion


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


def _swinging_s(problem: Problem) -> float:
    """Return the longest decay time of hand and device alone after a tap, over the hands of the set.

    (m + m_h) s^2 + (b + b_h) s + k_h has the poles; each starts at the speed of the tap, or that of the hand's whole
    displacement at the pole's own frequency if slower, amplified by the resonance of hand and device at the frequency
    of the tap.
    """
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
        needed = []
        for decay in (fast, slow):
            frequency = np.where(spread > 0, decay, np.sqrt(square))
            speed = _SURELY * more * np.minimum(tap * _TAP.amplitude_m, frequency * way_m)
            # Not a number where there is no such pole; below 0 where the speed never exceeds the threshold of settling.
            needed.append(np.fmax(np.log(speed / AT_REST_M_PER_S) / decay, 0.0))
    return float(np.max(needed, initial=0.0))
