"""Table of the frequency estimators: python tests/benchmarks/estimators.py

Settling, bias, noise, drift, harmonics, encoder, rest, and the Cramer-Rao bound. Every signal is a position in metres,
sampled; the estimators see its backward difference. The tone has an amplitude of 1 mm. Phases are spread evenly over a
turn, and each figure is over all phases. Overwrites RESULTS_estimators.md beside this file.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from run_step import run_step
from script_arguments import script_arguments
from studied import about, made_by, table

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi.simulation.runtime.estimators import ESTIMATORS, estimator_step

HERE = Path(__file__).parent
AMPLITUDE_M = 1e-3
NOISE_RMS_M = 1e-5
ENCODER_M = 2e-5
DRIFT_M, DRIFT_HZ = 5e-3, 0.3
THIRD_HARMONIC = 0.3
LOW_HZ, HIGH_HZ = 3.0, 12.0
TONES_HZ = (1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0, 30.0, 50.0)
WITHIN = 0.1


def cramer_rao_hz(amplitude_m: float, noise_rms_m: float, window_s: float, sample_time_s: float) -> float:
    """Return the least standard deviation of a frequency from a sine in white noise (Rife and Boorstyn 1974)."""
    n = max(3.0, window_s / sample_time_s)
    variance = 24 * noise_rms_m**2 / (amplitude_m**2 * n * (n * n - 1))
    return math.sqrt(variance) / (math.tau * sample_time_s)


def row(method: str, sample_time_s: float = 1e-3, phases: int = 6, seed: int = 0) -> dict[str, str]:
    """Measure an estimator: each column of the table."""
    step = estimator_step(method, sample_time_s)
    rng = np.random.default_rng(seed)
    shifts = np.arange(phases, dtype=np.float64) * np.float64(math.tau / phases)
    time = np.arange(round(6.0 / sample_time_s)) * sample_time_s
    late = time > 3.0

    def run(position: NDArray[np.floating[Any]]) -> tuple[FloatArray, BoolArray]:
        found = run_step(step, np.diff(position, prepend=position[0])[None] / sample_time_s)
        return found["frequency_hz"], found["valid"] > 0

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
    bias = np.array([np.mean([errors(tone(hz, shift), hz).mean() for shift in shifts]) for hz in TONES_HZ])
    bound = cramer_rao_hz(AMPLITUDE_M, NOISE_RMS_M, down, sample_time_s) / LOW_HZ
    return {
        "estimator": method,
        "states": f"{len(step.states)}",
        "instructions": f"{step.function.n_instructions()}",
        "3 to 12 Hz, s": f"{up:.3f}",
        "12 to 3 Hz, s": f"{down:.3f}",
        "first, s": f"{max(first):.3f}",
        "rest, s": f"{max(rest):.3f}",
        "bias 1-50 Hz": f"{np.abs(bias).max():.2%}",
        "noise": f"{np.std(np.concatenate(noisy)):.2%}",
        "bound": f"{bound:.3%}",
        "drift": f"{largest(DRIFT_M * np.sin(math.tau * DRIFT_HZ * time)):.1%}",
        "harmonic": f"{harmonic:.1%}",
        "encoder": f"{largest(np.zeros(len(time)), counted=True):.1%}",
        "valid at rest": f"{at_rest.mean():.0%}",
    }


def main() -> None:
    rows = [row(method) for method in ESTIMATORS]
    text = f"""# Estimators of the interaction frequency

{made_by(about("python tests/benchmarks/estimators.py", 0))}

T = 1 ms, a tone of 1 mm, backward difference of the position; the worst of six phases, errors as shares of the true
frequency.

{table(rows[0], (one.values() for one in rows))}

- 3 to 12 Hz, 12 to 3 Hz: until the error stays below 10 %. First: from rest to the first valid estimate at 3 Hz.
  Rest: from the end of the motion until the estimate is undefined.
- Bias: largest of nine tones, 1 to 50 Hz. Noise: standard deviation with 10 um rms of white noise on the position at
  3 Hz; bound: the Cramer-Rao bound for a window as long as the settling time (12 to 3 Hz).
- Drift: largest error with 5 mm at 0.3 Hz added. Harmonic: 30 % third harmonic in the position, which is 90 % in the
  velocity. Encoder: steps of 20 um. Valid at rest: share of valid estimates at rest with a count that flickers.
"""
    (HERE / "RESULTS_estimators.md").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    script_arguments(__doc__)
    main()
