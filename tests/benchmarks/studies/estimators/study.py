"""What the estimators are worth: settling, bias, noise, drift, harmonics, encoder, rest, and the Cramer-Rao bound.

Every signal is a position in metres, sampled; the estimators see its backward difference. The tone has an amplitude of
1 mm. Phases are spread evenly over a turn, and each figure is over all phases.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi.simulation.runtime.estimators import ESTIMATORS, estimator_step
from avc_casadi.simulation.runtime.step import Step

AMPLITUDE_M = 1e-3
NOISE_RMS_M = 1e-5
ENCODER_M = 2e-5
DRIFT_M, DRIFT_HZ = 5e-3, 0.3
THIRD_HARMONIC = 0.3
LOW_HZ, HIGH_HZ = 3.0, 12.0
TONES_HZ = (1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0, 30.0, 50.0)
WITHIN = 0.1


@dataclass(frozen=True)
class EstimatorRow:
    """Figures of one estimator; relative errors are shares of the true frequency, shape () unless stated.

    Attributes:
        method: its name.
        states: number of its states.
        instructions: number of its instructions a tick.
        settling_up_s: from 3 to 12 Hz, until the error stays below 10 %, the slowest phase.
        settling_down_s: from 12 to 3 Hz.
        first_s: from rest to the first valid estimate at 3 Hz.
        rest_s: from the end of a motion at 3 Hz until the estimate is undefined.
        bias: mean relative error of each of `TONES_HZ`.
        noise: standard deviation with white noise of 10 um rms on the position at 3 Hz.
        bound: Cramer-Rao bound of that for a window as long as the settling time.
        drift: largest error beside 5 mm at 0.3 Hz.
        harmonic: largest error with 30 % third harmonic in the position.
        encoder: largest error with an encoder of 20 um.
        valid_at_rest: share of valid estimates at rest with noise of one encoder step.
    """

    method: str
    states: int
    instructions: int
    settling_up_s: float
    settling_down_s: float
    first_s: float
    rest_s: float
    bias: FloatArray
    noise: float
    bound: float
    drift: float
    harmonic: float
    encoder: float
    valid_at_rest: float

    def document(self) -> dict[str, Any]:
        """Return the figures as plain numbers."""
        return {
            name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in vars(self).items()
        } | {"tones_hz": list(TONES_HZ)}


@dataclass(frozen=True)
class EstimatorTraces:
    """Estimates over time of one signal, for the figure.

    Attributes:
        time_s: shape (ticks,).
        truth_hz: the true frequency, not a number at rest.
        estimates_hz: estimate of each method, not a number where not valid.
    """

    time_s: FloatArray
    truth_hz: FloatArray
    estimates_hz: dict[str, FloatArray]


def cramer_rao_hz(amplitude_m: float, noise_rms_m: float, window_s: float, sample_time_s: float) -> float:
    """Return the least standard deviation of a frequency from a sine in white noise (Rife and Boorstyn 1974).

    Args:
        amplitude_m: amplitude of the sine.
        noise_rms_m: standard deviation of each sample's noise.
        window_s: length of the observation.
        sample_time_s: T.
    """
    n = max(3.0, window_s / sample_time_s)
    variance = 24 * noise_rms_m**2 / (amplitude_m**2 * n * (n * n - 1))
    return math.sqrt(variance) / (math.tau * sample_time_s)


def study_estimators(sample_time_s: float = 1e-3, phases: int = 6, seed: int = 0) -> tuple[EstimatorRow, ...]:
    """Measure every estimator.

    Args:
        sample_time_s: T.
        phases: phases of each signal.
        seed: of the noise.
    """
    return tuple(_row(method, sample_time_s, phases, seed) for method in ESTIMATORS)


def trace_estimators(sample_time_s: float = 1e-3, seed: int = 0) -> EstimatorTraces:
    """Follow a motion that rests, moves at 3 Hz, at 12 Hz, at 3 Hz with a harmonic, and rests, on an encoder."""
    time = _time(7.0, sample_time_s)
    truth = np.select([time < 0.5, time < 2.0, time < 3.0, time < 5.5], [np.nan, LOW_HZ, HIGH_HZ, LOW_HZ], np.nan)
    phase = math.tau * sample_time_s * np.cumsum(np.nan_to_num(truth))
    moving = np.isfinite(truth)
    position = AMPLITUDE_M * np.sin(phase) + np.where(time >= 3.0, THIRD_HARMONIC * AMPLITUDE_M, 0) * np.sin(3 * phase)
    last = int(np.flatnonzero(moving)[-1])
    position = np.where(time > time[last], position[last], position)
    noise = np.random.default_rng(seed).normal(0, 0.1 * ENCODER_M, len(time))
    counted = ENCODER_M * np.round((position + noise) / ENCODER_M)
    estimates = {}
    for method in ESTIMATORS:
        frequency, valid = _estimate(estimator_step(method, sample_time_s), counted, sample_time_s)
        estimates[method] = np.where(valid, frequency, np.nan)
    return EstimatorTraces(time, truth, estimates)


def _time(duration_s: float, sample_time_s: float) -> FloatArray:
    return np.arange(round(duration_s / sample_time_s), dtype=np.float64) * np.float64(sample_time_s)


def _estimate(step: Step, position: NDArray[np.floating[Any]], sample_time_s: float) -> tuple[FloatArray, BoolArray]:
    found = step.run(np.diff(position, prepend=position[0])[None] / sample_time_s)
    return found["frequency_hz"], found["valid"] > 0


def _row(method: str, sample_time_s: float, phases: int, seed: int) -> EstimatorRow:
    step = estimator_step(method, sample_time_s)
    rng = np.random.default_rng(seed)
    shifts = np.arange(phases, dtype=np.float64) * np.float64(math.tau / phases)
    time = _time(6.0, sample_time_s)
    late = time > 3.0

    def run(position: NDArray[np.floating[Any]]) -> tuple[FloatArray, BoolArray]:
        return _estimate(step, position, sample_time_s)

    def tone(hz: float, shift: float) -> FloatArray:
        return AMPLITUDE_M * np.sin(math.tau * hz * time + shift)

    def settling(first: float, second: float) -> float:
        truth = np.where(late, second, first)
        longest = 0.0
        for shift in shifts:
            frequency, valid = run(AMPLITUDE_M * np.sin(math.tau * sample_time_s * np.cumsum(truth) + shift))
            wrong = late & ~(valid & (np.abs(frequency / truth - 1) < WITHIN))
            longest = max(longest, time[np.flatnonzero(wrong)[-1]] - 3.0) if wrong.any() else longest
        return float(longest)

    def errors(position: FloatArray, hz: float) -> FloatArray:
        frequency, valid = run(position)
        error: FloatArray = frequency[late & valid] / hz - 1
        return error

    def largest(extra: FloatArray, *, counted: bool = False) -> float:
        worst = 0.0
        for shift in shifts:
            position = tone(LOW_HZ, shift) + extra
            if counted:
                position = ENCODER_M * np.round(position / ENCODER_M)
            worst = max(worst, float(np.abs(errors(position, LOW_HZ)).max(initial=0.0)))
        return worst

    first, rest = [], []
    for shift in shifts:
        stopped = np.where(late, tone(LOW_HZ, shift)[int(late.argmax())], tone(LOW_HZ, shift))
        _, valid = run(stopped)
        first.append(time[int(valid.argmax())])
        still = np.flatnonzero(valid & late)
        rest.append(time[still[-1]] - 3.0 if len(still) else 0.0)
    up, down = settling(LOW_HZ, HIGH_HZ), settling(HIGH_HZ, LOW_HZ)
    noisy = [errors(tone(LOW_HZ, shift) + rng.normal(0, NOISE_RMS_M, len(time)), LOW_HZ) for shift in shifts]
    harmonic = max(
        float(np.abs(errors(tone(LOW_HZ, 0.0) + THIRD_HARMONIC * tone(3 * LOW_HZ, shift), LOW_HZ)).max(initial=0.0))
        for shift in shifts
    )
    _, at_rest = run(ENCODER_M * (rng.random(len(time)) < 0.02))
    return EstimatorRow(
        method=method,
        states=len(step.states),
        instructions=step.instructions,
        settling_up_s=up,
        settling_down_s=down,
        first_s=float(max(first)),
        rest_s=float(max(rest)),
        bias=np.array([np.mean([errors(tone(hz, shift), hz).mean() for shift in shifts]) for hz in TONES_HZ]),
        noise=float(np.std(np.concatenate(noisy))),
        bound=cramer_rao_hz(AMPLITUDE_M, NOISE_RMS_M, down, sample_time_s) / LOW_HZ,
        drift=largest(DRIFT_M * np.sin(math.tau * DRIFT_HZ * time)),
        harmonic=harmonic,
        encoder=largest(np.zeros(len(time)), counted=True),
        valid_at_rest=float(at_rest.mean()),
    )
