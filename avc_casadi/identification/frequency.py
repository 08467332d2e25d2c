"""Frequency response of a log with its coherence, that of a model, and candidate resonances."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize, signal

from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray
from avc_casadi.identification.linear import linear_steps, taps_of
from avc_casadi.identification.log import Record
from avc_casadi.identification.terms import HIGHEST_SEEN, RUNGS, Structure

_WINDOW_S = 1.0
_COHERENT = 0.6
_DRIVEN = 1e-4


@dataclass(frozen=True, eq=False)
class Response:
    """Velocity of the measured position over commanded force."""

    frequency_hz: FloatArray
    velocity_per_force: ComplexArray
    coherence: FloatArray
    power: FloatArray

    @property
    def driven(self) -> BoolArray:
        """Whether the force excites the device, shape (frequencies,)."""
        return np.asarray(self.power > _DRIVEN)

    @property
    def excited_hz(self) -> tuple[float, float] | None:
        """Lowest and highest coherent frequency, or None."""
        some = self.frequency_hz[(self.coherence > _COHERENT) & self.driven]
        return (float(some[0]), float(some[-1])) if some.size >= 3 else None


def measured_response(records: Sequence[Record]) -> Response:
    """Return the response by Welch averaging over all records."""
    period = records[0].sample_time_s
    shortest = min(record.position_m.size for record in records)
    length = int(min(_WINDOW_S / period, shortest // 4))
    sums: list[ComplexArray] = []
    for record in records:
        velocity = np.diff(record.position_m, prepend=record.position_m[0]) / period
        weight = record.position_m.size
        across = signal.csd(record.force_n, velocity, fs=1 / period, nperseg=length)[1]
        powers = [signal.welch(values, fs=1 / period, nperseg=length)[1] for values in (record.force_n, velocity)]
        sums.append(weight * np.array([across, *powers]))
    cross, force, velocity_power = np.sum(sums, axis=0)
    frequency = np.asarray(np.fft.rfftfreq(length, period), dtype=np.float64)
    tiny = 1e-300
    return Response(
        frequency[1:],
        (cross / (force + tiny))[1:],
        (np.abs(cross) ** 2 / (force.real * velocity_power.real + tiny))[1:],
        (force.real / (force.real.max() + tiny))[1:],
    )


def model_response(
    values: Mapping[str, float], structure: Structure, sample_time_s: float, frequency_hz: FloatArray
) -> ComplexArray:
    """Return the response of a model without its dry friction."""
    (step,) = linear_steps([values], structure, sample_time_s, taps_of(values), parts=0)
    z = np.exp(2j * np.pi * frequency_hz * sample_time_s)
    forces = step.force @ np.stack([z**-tap for tap in step.taps])
    identity = np.eye(step.matrix.shape[0])
    states = np.linalg.solve(z[:, None, None] * identity - step.matrix, forces.T[..., None])[..., 0]
    return np.asarray(states[:, step.measured] * (1 - 1 / z) / sample_time_s)


def likely_resonances(
    response: Response, values: Mapping[str, float], structure: Structure, sample_time_s: float
) -> list[tuple[float, dict[str, float]]]:
    """Return the resonances that would explain the response best: misfit, and start of the search.

    Magnitudes are compared up to a factor, phases up to a delay, with those of the model without resonance.
    """
    use = (response.coherence > 0.3) & (response.frequency_hz > 5.0) & response.driven
    if use.sum() < 10:
        return []
    frequency, measured = response.frequency_hz[use], response.velocity_per_force[use]
    weight = response.coherence[use] / np.maximum(1 - response.coherence[use], 0.1) / frequency
    root = np.sqrt(weight / weight.sum())
    # The model without resonance has put part of its lag into the delay.
    turns = sample_time_s * np.arange(-values["delay_samples"], 1.01, 0.25)

    def gap(point: FloatArray) -> tuple[FloatArray, dict[str, float]]:
        """Return the misfit at logarithms of frequency and damping ratio and the logit of the mass ratio."""
        mode = (math.exp(point[0]), math.exp(point[1]), 1 / (1 + math.exp(-point[2])))
        start = dict(zip(RUNGS["resonance"], mode, strict=True))
        ratio = measured / model_response({**values, **start}, structure, sample_time_s, frequency)
        factor = float(np.exp(np.average(np.log(np.abs(ratio)), weights=weight)))
        phases = np.angle(ratio * np.exp(2j * np.pi * frequency * turns[:, None]))
        at = int(np.argmin(np.sum(weight * phases**2, axis=1)))
        start["mass_kg"] = values["mass_kg"] / factor
        start["delay_samples"] = max(values["delay_samples"] + float(turns[at]) / sample_time_s, 0.0)
        return np.concatenate([root * np.log(np.abs(ratio) / factor), root * phases[at]]), start

    def misfit(point: FloatArray) -> FloatArray:
        return gap(point)[0]

    top = min(HIGHEST_SEEN / sample_time_s, 1.3 * frequency[-1])
    grid = itertools.product(np.log(np.geomspace(15.0, top, 30)), [math.log(0.06)], (-1.7, -0.6, 0.4))
    points = sorted(map(np.array, grid), key=lambda point: float(np.sum(misfit(point) ** 2)))
    best = [points[0]]
    best += [point for point in points if abs(point[0] - points[0][0]) > 0.25][:1]
    ends = (math.log(10.0), math.log(2e-3), -4.0), (math.log(0.49 / sample_time_s), 0.0, 4.0)
    solved = [optimize.least_squares(misfit, point, bounds=ends, max_nfev=8, loss="soft_l1") for point in best]
    return sorted(((float(one.cost), gap(one.x)[1]) for one in solved), key=lambda one: one[0])
