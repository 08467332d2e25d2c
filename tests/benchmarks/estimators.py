"""Table and figure of the frequency estimators: python tests/benchmarks/estimators.py

Settling, bias, noise, drift, harmonics, encoder, rest, and the Cramer-Rao bound. Every signal is a position in metres,
sampled; the estimators see its backward difference. The tone has an amplitude of 1 mm. Phases are spread evenly over a
turn, and each figure is over all phases. Overwrites RESULTS_estimators.md and figures/estimators.png beside this file.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from run_step import run_step
from script_arguments import script_arguments

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi.present.figures.style import Line, Panels, save_figure, styled
from avc_casadi.simulation.runtime.estimators import ESTIMATORS, estimator_step
from avc_casadi.simulation.tick import Step

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HERE = Path(__file__).parent
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
    """Figures of one estimator; relative errors are shares of the true frequency."""

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


@dataclass(frozen=True)
class EstimatorTraces:
    """Estimates over time of one signal, for the figure; not a number where there is none."""

    time_s: FloatArray
    truth_hz: FloatArray
    estimates_hz: dict[str, FloatArray]


def cramer_rao_hz(amplitude_m: float, noise_rms_m: float, window_s: float, sample_time_s: float) -> float:
    """Return the least standard deviation of a frequency from a sine in white noise (Rife and Boorstyn 1974)."""
    n = max(3.0, window_s / sample_time_s)
    variance = 24 * noise_rms_m**2 / (amplitude_m**2 * n * (n * n - 1))
    return math.sqrt(variance) / (math.tau * sample_time_s)


def study_estimators(sample_time_s: float = 1e-3, phases: int = 6, seed: int = 0) -> tuple[EstimatorRow, ...]:
    """Measure every estimator."""
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
    found = run_step(step, np.diff(position, prepend=position[0])[None] / sample_time_s)
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


_TRUTH = Line("true frequency", "0.72", "-", "", 4.5, 2, 0.0)
_LINES = (
    Line("zero crossing", "#d1600a", "-", "", 1.3, 5, 0.0),
    Line("spectral peak", "#00517a", "-", "", 1.3, 5, 0.0),
    Line("adaptive notch", "#5a5a00", "-", "", 1.3, 5, 0.0),
    Line("fused", "#08306b", "-", "", 1.3, 5, 0.0),
)
_LIMITS_HZ = (0.9, 40.0)


@styled
def draw_estimators(traces: EstimatorTraces) -> Figure:
    """Draw each estimate below the other, with the truth behind it."""
    titles = [line.label for line in _LINES[: len(traces.estimates_hz)]]
    panels = Panels.of(
        None, titles, 6.4, lambda figure: figure.subplots(len(titles), 1, squeeze=False, sharex=True, sharey=True)[:, 0]
    )
    handles: list[Any] = []
    for panel, line, estimate in zip(panels.axes, _LINES, traces.estimates_hz.values(), strict=True):
        _TRUTH.draw(panel, traces.time_s, traces.truth_hz)
        line.draw(panel, traces.time_s, np.clip(estimate, *_LIMITS_HZ))
        panel.set_yscale("log")
        panel.set_xlim(traces.time_s[0], traces.time_s[-1])
        panel.set_ylim(*_LIMITS_HZ)
        panel.set_yticks([1, 3, 12, 30], ["1", "3", "12", "30"])
        panel.minorticks_off()
        panel.set_ylabel("frequency (Hz)")
        handles = panel.get_lines()[:2]
    for at, text in (
        (0.02, "rest"),
        (0.52, "3 Hz"),
        (2.02, "12 Hz"),
        (3.02, "3 Hz with 30 % third harmonic"),
        (5.52, "rest"),
    ):
        panels.axes[0].text(at, 21.0, text, fontsize=8, color="0.25")
    for panel in panels.axes:
        for at in (0.5, 2.0, 3.0, 5.5):
            panel.axvline(at, color="0.6", linewidth=0.7, zorder=1)
    panels.axes[-1].set_xlabel("time (s)")
    panels.legend(dict(zip(("true frequency", "estimate; a gap where it is undefined"), handles, strict=True)), 2)
    return panels.figure


COLUMNS = (
    ("estimator", lambda row: row.method),
    ("states", lambda row: f"{row.states}"),
    ("instructions", lambda row: f"{row.instructions}"),
    ("3 to 12 Hz, s", lambda row: f"{row.settling_up_s:.3f}"),
    ("12 to 3 Hz, s", lambda row: f"{row.settling_down_s:.3f}"),
    ("first, s", lambda row: f"{row.first_s:.3f}"),
    ("rest, s", lambda row: f"{row.rest_s:.3f}"),
    ("bias 1-50 Hz", lambda row: f"{np.abs(row.bias).max():.2%}"),
    ("noise", lambda row: f"{row.noise:.2%}"),
    ("bound", lambda row: f"{row.bound:.3%}"),
    ("drift", lambda row: f"{row.drift:.1%}"),
    ("harmonic", lambda row: f"{row.harmonic:.1%}"),
    ("encoder", lambda row: f"{row.encoder:.1%}"),
    ("valid at rest", lambda row: f"{row.valid_at_rest:.0%}"),
)


def table(rows: tuple[EstimatorRow, ...]) -> str:
    lines = [" | ".join(name for name, _ in COLUMNS), " | ".join("---" for _ in COLUMNS)]
    lines += [" | ".join(text(row) for _, text in COLUMNS) for row in rows]
    return "\n".join(f"| {line} |" for line in lines)


def main() -> None:
    text = f"""# Estimators of the interaction frequency

Made by `python tests/benchmarks/estimators.py`. T = 1 ms, a tone of 1 mm, backward difference of the position; the
worst of six phases, errors as shares of the true frequency.

{table(study_estimators())}

- 3 to 12 Hz, 12 to 3 Hz: until the error stays below 10 %. First: from rest to the first valid estimate at 3 Hz.
  Rest: from the end of the motion until the estimate is undefined.
- Bias: largest of nine tones, 1 to 50 Hz. Noise: standard deviation with 10 um rms of white noise on the position at
  3 Hz; bound: the Cramer-Rao bound for a window as long as the settling time (12 to 3 Hz).
- Drift: largest error beside 5 mm at 0.3 Hz. Harmonic: with 30 % third harmonic in the position, which is 90 % in the
  velocity. Encoder: steps of 20 um. Valid at rest: share of valid estimates at rest with a count that flickers.

![estimates over time](figures/estimators.png)
"""
    (HERE / "RESULTS_estimators.md").write_text(text, encoding="utf-8")
    print(text)
    save_figure(draw_estimators(trace_estimators()), HERE / "figures" / "estimators.png")


if __name__ == "__main__":
    script_arguments(__doc__)
    main()
