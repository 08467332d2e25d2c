"""The excitation signal in the integer arithmetic of the device: the same bits everywhere.

The device sums sines whose phases are integers in turns of 2^32, so that a few numbers describe any duration without
drift. `Signal.units` repeats its arithmetic.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from avc_casadi._util.arrays import FloatArray

Integers = NDArray[np.int64]

FULL = 32767
"""Units of the largest force."""
KNOTS = 33
WHOLE = 1 << 15
"""An envelope of 1."""
_TURN, _QUARTER = 1 << 32, 1 << 30
_POLYNOMIAL = (1686624950, 693528462, 85303417, 4658781)


@dataclass(frozen=True)
class Signal:
    """Sines under an envelope, in the integers of the device."""

    step: tuple[int, ...]
    phase: tuple[int, ...]
    amplitude: tuple[int, ...]
    growth: int = 0
    knots: tuple[int, ...] = (WHOLE,) * KNOTS

    @classmethod
    def of(
        cls,
        frequency_hz: Sequence[float] | FloatArray,
        amplitude: Sequence[float] | FloatArray,
        phase_rad: Sequence[float] | FloatArray,
        sample_time_s: float,
        *,
        growth_per_tick: float = 0.0,
        knots: Sequence[float] | FloatArray = (1.0,) * KNOTS,
    ) -> Signal:
        """Round to the integers of the device: amplitudes as shares of the largest force, knots from 0 to 1."""
        return cls(
            step=tuple(round(float(one) * _TURN) for one in np.asarray(frequency_hz) * sample_time_s),
            phase=tuple(round(float(one) / (2 * np.pi) * 65536) % 65536 for one in phase_rad),
            amplitude=tuple(round(float(one) * FULL) for one in amplitude),
            growth=round(growth_per_tick * _TURN),
            knots=tuple(round(float(one) * WHOLE) for one in knots),
        )

    def units(self, ticks: int) -> Integers:
        """Return the signal under its envelope, in units, shape (ticks,)."""
        total = np.zeros(ticks, dtype=np.int64)
        for step, phase, amplitude in zip(self.step, self.phase, self.amplitude, strict=True):
            total += amplitude * _sine(_phases(step, phase, self.growth, ticks))
        at = np.arange(ticks, dtype=np.int64) * ((_TURN - 1) // ticks)
        knots = np.array(self.knots, dtype=np.int64)
        low, high = knots[at >> 27], knots[(at >> 27) + 1]
        envelope = low + _over((high - low) * (at >> 12 & 0x7FFF), WHOLE)
        return _over(_over(total, FULL) * envelope, WHOLE)

    def frequency_hz(self, ticks: int, sample_time_s: float) -> tuple[float, float]:
        """Return the lowest and the highest frequency played."""
        hertz = [step / _TURN / sample_time_s for step in self.step]
        return min(hertz), max(hertz) * (1.0 + self.growth / _TURN) ** ticks


def _phases(step: int, phase: int, growth: int, ticks: int) -> Integers:
    start = phase << 16
    if not growth:
        return (start + np.arange(ticks, dtype=np.uint64) * np.uint64(step)).astype(np.int64) & (_TURN - 1)
    phases = np.empty(ticks, dtype=np.int64)
    fine = step << 32
    for tick in range(ticks):
        phases[tick] = start
        whole = fine >> 32
        start = (start + whole) & (_TURN - 1)
        fine = (fine + whole * growth) & ((1 << 64) - 1)
    return phases


def _sine(phase: Integers) -> Integers:
    within = phase & (_QUARTER - 1)
    x = np.where(phase & _QUARTER, _QUARTER - within, within)
    c = _POLYNOMIAL
    square = x * x >> 30
    inner = c[1] - (square * (c[2] - (square * c[3] >> 30)) >> 30)
    value = x * (c[0] - (square * inner >> 30)) >> 30
    rounded = (value * FULL + (_QUARTER >> 1)) >> 30
    return np.asarray(np.where(phase >> 31, -rounded, rounded), dtype=np.int64)


def _over(value: Integers, by: int) -> Integers:
    """Divide towards zero, as C does."""
    return np.asarray(np.sign(value) * (np.abs(value) // by), dtype=np.int64)


def ramp(ticks: int, ramp_ticks: int) -> Integers:
    """Return the ramp in and out that the device applies, of 2^15, shape (ticks,)."""
    gone = np.arange(1, ticks + 1, dtype=np.int64)
    near = np.minimum(gone, gone[::-1])
    return np.asarray(np.where(near < ramp_ticks, (near << 15) // ramp_ticks, WHOLE), dtype=np.int64)


def low_crest_phases(frequency_hz: FloatArray, amplitude: FloatArray, time_s: FloatArray) -> FloatArray:
    """Return phases of a multisine with a low crest factor: Schroeder's (1970), refined by norms of rising order."""
    share = amplitude**2 / np.sum(amplitude**2)
    turns = np.outer(time_s, 2 * np.pi * frequency_hz)
    cosine, sine = np.cos(turns) * np.sqrt(2 * share), np.sin(turns) * np.sqrt(2 * share)

    def norm(phase: FloatArray, order: int) -> tuple[float, FloatArray]:
        wave = sine @ np.cos(phase) + cosine @ np.sin(phase)
        size = np.abs(wave)
        top = float(size.max())
        relative = (size / top) ** (order - 1)
        mean = float(np.mean(relative * size / top))
        pull = np.sign(wave) * relative / (wave.size * mean)
        slope = (pull @ cosine) * np.cos(phase) - (pull @ sine) * np.sin(phase)
        return float(np.log(top) + np.log(mean) / order), np.asarray(slope / top, dtype=np.float64)

    phase = np.asarray(-2 * np.pi * np.cumsum(np.concatenate([[0.0], np.cumsum(share)[:-1]])), dtype=np.float64)
    for order in (4, 8, 16, 32):
        found = minimize(norm, phase, args=(order,), jac=True, method="L-BFGS-B", options={"maxiter": 60})
        phase = np.asarray(found.x, dtype=np.float64)
    return phase
