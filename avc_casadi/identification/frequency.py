"""Frequency response of a log with its coherence, that of a model, and candidate resonances."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize, signal

from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray
from avc_casadi.identification.linear import linear_step, taps_of
from avc_casadi.identification.record import Record
from avc_casadi.identification.terms import Structure

_WINDOW_S = 1.0
_COHERENT = 0.6
_DRIVEN = 1e-4
_BELOW_STRUCTURE_HZ = 50.0


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
    step = linear_step(values, structure, sample_time_s, taps_of(values), parts=0)
    z = np.exp(2j * np.pi * frequency_hz * sample_time_s)
    forces = step.force @ np.stack([z**-tap for tap in step.taps])
    identity = np.eye(step.matrix.shape[0])
    states = np.linalg.solve(z[:, None, None] * identity - step.matrix, forces.T[..., None])[..., 0]
    return np.asarray(states[:, step.measured] * (1 - 1 / z) / sample_time_s)


def spring_start(response: Response, delay_s: float) -> dict[str, float] | None:
    """Return mass, damping and stiffness of a device on a spring from its response below its modes, or None."""
    use = (response.coherence > _COHERENT) & response.driven & (response.frequency_hz < _BELOW_STRUCTURE_HZ)
    if use.sum() < 5:
        return None
    omega = 2 * np.pi * response.frequency_hz[use]
    answer = response.velocity_per_force[use] * np.exp(1j * omega * delay_s)
    # Relative to each response: Y (b + j omega m + k/(j omega)) = 1.
    sides = answer[:, None] * np.stack([1j * omega, np.ones_like(omega), 1 / (1j * omega)], axis=1)
    columns, ones = np.concatenate([sides.real, sides.imag]), np.concatenate([np.ones_like(omega), 0 * omega])
    mass, damping, stiffness = (float(one) for one in np.linalg.lstsq(columns, ones, rcond=None)[0])
    if mass <= 0 or stiffness <= 0:
        return None
    return {"mass_kg": mass, "damping_ns_per_m": max(damping, 0.0), "stiffness_n_per_m": stiffness}


def likely_resonances(
    response: Response, values: Mapping[str, float], structure: Structure, sample_time_s: float, most: int = 2
) -> list[tuple[float, dict[str, float]]]:
    """Return the resonances that would explain the response best: misfit, and start of the search.

    Magnitudes are compared up to a factor, phases up to a delay, with those of the model without resonance.
    """
    use = (response.coherence > 0.3) & (response.frequency_hz > 5.0) & response.driven
    if use.sum() < 10:
        return []
    frequency, measured = response.frequency_hz[use], response.velocity_per_force[use]
    weight = response.coherence[use] / np.maximum(1 - response.coherence[use], 0.1) / frequency
    top = min(0.45 / sample_time_s, 1.3 * frequency[-1])
    grid = np.geomspace(15.0, top, 30)
    # The model without resonance has put part of its lag into the delay.
    turns = sample_time_s * np.arange(-values["delay_samples"], 1.01, 0.25)
    found = []
    for hertz, share in itertools.product(grid, (0.15, 0.35, 0.6)):
        guess = {"resonance.frequency_hz": hertz, "resonance.damping_ratio": 0.06, "resonance.mass_ratio": share}
        model = model_response({**values, **guess}, structure, sample_time_s, frequency)
        found.append((float(np.sum(_gap(measured / model, frequency, weight, turns) ** 2)), guess))
    found.sort(key=lambda one: one[0])
    best: list[dict[str, float]] = []
    for _, guess in found:
        apart = [abs(np.log(guess["resonance.frequency_hz"] / one["resonance.frequency_hz"])) > 0.25 for one in best]
        if all(apart):
            best.append(guess)
        if len(best) == most:
            break
    names = tuple(best[0])
    ends = np.array([[np.log(10.0), np.log(2e-3), -4.0], [np.log(0.49 / sample_time_s), np.log(1.0), 4.0]])

    def values_at(point: FloatArray) -> dict[str, float]:
        return dict(zip(names, (np.exp(point[0]), np.exp(point[1]), 1 / (1 + np.exp(-point[2]))), strict=True))

    def gap_at(point: FloatArray) -> FloatArray:
        model = model_response({**values, **values_at(point)}, structure, sample_time_s, frequency)
        return _gap(measured / model, frequency, weight, turns)

    polished = []
    for guess in best:
        hertz, ratio, share = guess.values()
        begin = np.clip([np.log(hertz), np.log(ratio), np.log(share / (1 - share))], ends[0] + 1e-6, ends[1] - 1e-6)
        solved = optimize.least_squares(gap_at, begin, bounds=(ends[0], ends[1]), max_nfev=8, loss="soft_l1")
        model = model_response({**values, **values_at(solved.x)}, structure, sample_time_s, frequency)
        factor, delay = _factor_and_delay(measured / model, frequency, weight, turns)
        begun = {
            **values_at(solved.x),
            "mass_kg": values["mass_kg"] / factor,
            "delay_samples": max(values["delay_samples"] + delay / sample_time_s, 0.0),
        }
        polished.append((float(solved.cost), begun))
    return sorted(polished, key=lambda one: one[0])


def _factor_and_delay(
    ratio: ComplexArray, frequency: FloatArray, weight: FloatArray, turns: FloatArray
) -> tuple[float, float]:
    """Return the factor and the delay (s, out of the candidates) between a measured response and a model."""
    factor = np.exp(np.average(np.log(np.abs(ratio)), weights=weight))
    phases = np.angle(ratio[None] * np.exp(2j * np.pi * frequency * turns[:, None]))
    return float(factor), float(turns[np.argmin(np.sum(weight * phases**2, axis=1))])


def _gap(ratio: ComplexArray, frequency: FloatArray, weight: FloatArray, turns: FloatArray) -> FloatArray:
    """Return the weighted misfit of magnitudes up to a factor and of phases up to a delay."""
    root = np.sqrt(weight / weight.sum())
    factor, delay = _factor_and_delay(ratio, frequency, weight, turns)
    phase = np.angle(ratio * np.exp(2j * np.pi * frequency * delay))
    return np.concatenate([root * np.log(np.abs(ratio) / factor), root * phase])
