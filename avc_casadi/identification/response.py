"""The frequency response of a log and of a model, and the resonances that would explain it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize, signal

from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray
from avc_casadi.identification.linear_step import linear_steps, taps_of
from avc_casadi.identification.log import Record
from avc_casadi.identification.terms import HIGHEST_RESONANCE, MASS_RATIO, ModelStructure

_EXCITED_POWER = 1e-4
"""Share of the largest power of the force from which on it excites the device."""
_COHERENT = 0.6
"""Coherence of the frequencies of a response's band."""
_FEWEST_COHERENT = 3
"""Fewest frequencies of a band."""
_TINY = 1e-300
"""Stands for 0 in a divisor."""


@dataclass(frozen=True, eq=False)
class Response:
    """Velocity of the measured position over commanded force, (m/s)/N; all of shape (frequencies,).

    `power` is that of the force, as a share of its largest.
    """

    frequency_hz: FloatArray
    velocity_per_force: ComplexArray
    coherence: FloatArray
    power: FloatArray

    @property
    def excites(self) -> BoolArray:
        """Whether the force excites the device, shape (frequencies,)."""
        return np.asarray(self.power > _EXCITED_POWER)

    @property
    def band_hz(self) -> tuple[float, float] | None:
        """Lowest and highest coherent frequency, or None."""
        coherent = self.frequency_hz[(self.coherence > _COHERENT) & self.excites]
        return (float(coherent[0]), float(coherent[-1])) if coherent.size >= _FEWEST_COHERENT else None


def frequency_response(records: Sequence[Record]) -> Response:
    """Return the response by Welch averaging over all records."""
    period_s = records[0].sample_time_s
    shortest = min(record.position_m.size for record in records)
    length = int(min(1 / period_s, shortest // 4))  # of a second
    rate_hz = 1 / period_s
    sums: list[ComplexArray] = []
    for record in records:
        velocity = np.diff(record.position_m, prepend=record.position_m[0]) / period_s
        _, cross_power = signal.csd(record.force_n, velocity, fs=rate_hz, nperseg=length)
        _, force_power = signal.welch(record.force_n, fs=rate_hz, nperseg=length)
        _, velocity_power = signal.welch(velocity, fs=rate_hz, nperseg=length)
        sums.append(record.position_m.size * np.array([cross_power, force_power, velocity_power]))
    cross, of_force, of_velocity = np.sum(sums, axis=0)
    # Without the mean.
    frequency = np.asarray(np.fft.rfftfreq(length, period_s), dtype=np.float64)
    return Response(
        frequency_hz=frequency[1:],
        velocity_per_force=(cross / (of_force + _TINY))[1:],
        coherence=(np.abs(cross) ** 2 / (of_force.real * of_velocity.real + _TINY))[1:],
        power=(of_force.real / (of_force.real.max() + _TINY))[1:],
    )


def model_response(
    values: Mapping[str, float], structure: ModelStructure, sample_time_s: float, frequency_hz: FloatArray
) -> ComplexArray:
    """Return the response of a model without its dry friction, (m/s)/N, shape (frequencies,).

    With z = e^(2 pi i f T) it is c'(z - A)^-1 B [z^-tap] (1 - 1/z)/T, the difference of the position as its velocity.
    """
    (step,) = linear_steps([values], structure, sample_time_s, taps_of(values), parts=0)
    z = np.exp(2j * np.pi * frequency_hz * sample_time_s)
    forces = step.force @ np.stack([z**-tap for tap in step.taps])
    identity = np.eye(step.matrix.shape[0])
    states = np.linalg.solve(z[:, None, None] * identity - step.matrix, forces.T[..., None])[..., 0]
    return np.asarray(states[:, step.output] * (1 - 1 / z) / sample_time_s)


_LEAST_COHERENCE = 0.3
"""Coherence from which on a frequency takes part in the match of a resonance."""
_LOWEST_MATCHED_HZ = 5.0
"""Frequencies below this one take no part in the match of a resonance."""
_FEWEST_MATCHED = 10
"""Fewest frequencies of a match."""
_LEAST_INCOHERENCE = 0.1
"""Coherence counts as no nearer to 1 than this in the weights of a match."""
_LATEST_SAMPLES = 1.01
"""A delay may be longer by a sample than that of the model without resonance, ..."""
_DELAY_STEP_SAMPLES = 0.25
"""... in steps of this."""
BEYOND_BAND = 1.3
"""A resonance may stand so many times as high as the highest frequency that the log excites."""
_LOWEST_START_HZ = 15.0
"""Lowest frequency of a resonance from which its search starts, ..."""
_START_FREQUENCIES = 30
"""... the number of these frequencies, evenly spread over the logarithm, ..."""
_START_DAMPING_RATIO = 0.06
"""... and its damping ratio there."""
_START_MASS_LOGITS = (-1.7, -0.6, 0.4)
"""Logits of the mass ratio: 0.15, 0.35 and 0.6."""
_APART = 0.25
"""Difference in the logarithm of frequency from which on a second start is another one."""
_LOWEST_RESONANCE_HZ = 10.0
"""Lowest frequency of a match."""
_HIGHEST_MATCHED = 0.49
"""Highest frequency of a match, as a share of the sample rate."""
_LEAST_DAMPING_RATIO = 2e-3
"""Least damping ratio of a match; the largest is 1."""
_WIDEST_MASS_LOGIT = 4.0
"""Largest logit of the mass ratio of a match, either way: 0.018 to 0.982."""
_MATCH_STEPS = 8
"""Most evaluations of the search from a start."""


@dataclass(frozen=True, eq=False)
class ResonanceStart:
    """Values from which the search for a resonance starts, and how badly their response matches the measured one."""

    misfit: float
    values: dict[str, float]


@dataclass(frozen=True, eq=False)
class _Match:
    """Match of a model with a resonance to the measured response, up to a factor and a delay.

    A point of the search holds the logarithms of the resonance's frequency and damping ratio, and the logit of its mass
    ratio. Arrays have the shape (frequencies,), `delays_s` (delays,).
    """

    values: Mapping[str, float]
    structure: ModelStructure
    sample_time_s: float
    frequency_hz: FloatArray
    measured: ComplexArray
    weight: FloatArray
    delays_s: FloatArray

    def misfit(self, point: FloatArray) -> FloatArray:
        """Return the weighted misfit of the logarithm of size and of phase, shape (2 frequencies,)."""
        ratio = self._ratio(point)
        weight = np.sqrt(self.weight / self.weight.sum())
        phases = self._phases(ratio)
        phase = phases[self._best_delay(phases)]
        return np.concatenate([weight * np.log(np.abs(ratio) / self._factor(ratio)), weight * phase])

    def start(self, point: FloatArray) -> dict[str, float]:
        """Return the values of all parameters at a point, with the factor taken by the mass and the delay added."""
        ratio = self._ratio(point)
        delay_samples = float(self.delays_s[self._best_delay(self._phases(ratio))]) / self.sample_time_s
        return {
            **self.values,
            **self._mode(point),
            "mass_kg": self.values["mass_kg"] / self._factor(ratio),
            "delay_samples": max(self.values["delay_samples"] + delay_samples, 0.0),
        }

    def _mode(self, point: FloatArray) -> dict[str, float]:
        log_frequency, log_damping_ratio, mass_logit = point
        return {
            "resonance.frequency_hz": math.exp(log_frequency),
            "resonance.damping_ratio": math.exp(log_damping_ratio),
            MASS_RATIO: 1 / (1 + math.exp(-mass_logit)),
        }

    def _ratio(self, point: FloatArray) -> ComplexArray:
        """Return the measured response over the model's."""
        values = {**self.values, **self._mode(point)}
        return self.measured / model_response(values, self.structure, self.sample_time_s, self.frequency_hz)

    def _factor(self, ratio: ComplexArray) -> float:
        """Return the weighted geometric mean of the ratio's size."""
        return float(np.exp(np.average(np.log(np.abs(ratio)), weights=self.weight)))

    def _phases(self, ratio: ComplexArray) -> FloatArray:
        """Return the phase that each delay leaves, shape (delays, frequencies)."""
        return np.asarray(np.angle(ratio * np.exp(2j * np.pi * self.frequency_hz * self.delays_s[:, None])))

    def _best_delay(self, phases: FloatArray) -> int:
        """Return the index of the delay that leaves the least phase."""
        return int(np.argmin(np.sum(self.weight * phases**2, axis=1)))


def likely_resonances(
    response: Response, values: Mapping[str, float], structure: ModelStructure, sample_time_s: float
) -> list[ResonanceStart]:
    """Return the resonances that would explain the response best, up to a factor and a delay, the best first."""
    used = (response.coherence > _LEAST_COHERENCE) & (response.frequency_hz > _LOWEST_MATCHED_HZ) & response.excites
    if used.sum() < _FEWEST_MATCHED:
        return []
    frequency, coherence = response.frequency_hz[used], response.coherence[used]
    match = _Match(
        values=values,
        structure=structure,
        sample_time_s=sample_time_s,
        frequency_hz=frequency,
        measured=response.velocity_per_force[used],
        weight=coherence / np.maximum(1 - coherence, _LEAST_INCOHERENCE) / frequency,
        # The model without resonance has put part of its lag into the delay.
        delays_s=sample_time_s * np.arange(-values["delay_samples"], _LATEST_SAMPLES, _DELAY_STEP_SAMPLES),
    )
    highest = min(HIGHEST_RESONANCE / sample_time_s, BEYOND_BAND * frequency[-1])
    frequencies = np.log(np.geomspace(_LOWEST_START_HZ, highest, _START_FREQUENCIES))
    grid = itertools.product(frequencies, [math.log(_START_DAMPING_RATIO)], _START_MASS_LOGITS)
    points = sorted(map(np.array, grid), key=lambda point: float(np.sum(match.misfit(point) ** 2)))
    best = points[0]
    starts = [best, *[point for point in points if abs(point[0] - best[0]) > _APART][:1]]
    lowest_point = (math.log(_LOWEST_RESONANCE_HZ), math.log(_LEAST_DAMPING_RATIO), -_WIDEST_MASS_LOGIT)
    highest_point = (math.log(_HIGHEST_MATCHED / sample_time_s), 0.0, _WIDEST_MASS_LOGIT)
    bounds = lowest_point, highest_point
    results = [
        optimize.least_squares(match.misfit, start, bounds=bounds, max_nfev=_MATCH_STEPS, loss="soft_l1")
        for start in starts
    ]
    found_starts = [ResonanceStart(float(result.cost), match.start(result.x)) for result in results]
    return sorted(found_starts, key=lambda start: start.misfit)
