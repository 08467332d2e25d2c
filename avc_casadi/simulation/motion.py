"""The motion of the hand's target: the intended motion, known beforehand at every sample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.model.scene import Free, Motion, Stroke, Tap


@dataclass(frozen=True)
class Target:
    """The target at the samples; between two samples it moves at constant velocity."""

    position_m: FloatArray
    velocity_m_per_s: FloatArray
    device_start_m: float


def target_of(motion: Motion, samples: int, sample_time_s: float) -> Target:
    """Return the target of a motion; a held one begins with the device at rest at the surface, or before it."""
    time = np.arange(samples + 1, dtype=np.float64) * np.float64(sample_time_s)
    position = _position(motion, time)
    velocity = np.diff(position) / sample_time_s
    start = min(motion.end_m, 0.0) if motion.kind == "hold" else float(position[0])
    return Target(position[:-1], velocity, start)


def _position(motion: Motion, time: FloatArray) -> FloatArray:
    start, end = motion.start_m, motion.end_m
    if motion.kind == "hold":
        return np.full(time.shape, end)
    if motion.kind == "tap":
        phase = np.minimum(time, _resting_from(time[-1], 0.0, motion)) * motion.frequency_hz
        return start + (end - start) * np.sin(np.pi * phase) ** 2
    if motion.kind == "free":
        phase = np.minimum(time, _resting_from(time[-1], 0.0, motion)) * motion.frequency_hz
        return start + motion.amplitude_m * np.sin(2 * np.pi * phase)
    arrival = abs(end - start) / motion.speed_m_per_s
    ramp = start + (end - start) * np.clip(time / arrival, 0.0, 1.0) if arrival > 0 else np.full(time.shape, end)
    if motion.kind == "press":
        return ramp
    resting = _resting_from(time[-1], arrival, motion)
    phase = np.clip(time, arrival, max(arrival, resting)) - arrival
    return ramp + motion.amplitude_m * np.sin(2 * np.pi * motion.frequency_hz * phase)


def _resting_from(duration_s: float, begin_s: float, motion: Tap | Stroke | Free) -> float:
    """Return the end of the last whole period before the pause, in which settling is judged, or of the first one."""
    periods = max(1.0, np.floor((duration_s - motion.rest_s - begin_s) * motion.frequency_hz))
    return float(begin_s + periods / motion.frequency_hz)
