"""The excitation signal in the integer arithmetic of the device: the same bits everywhere.

The device sums sines whose phases are integers in turns of 2^32, so that a few numbers describe any duration without
drift. `Signal.units` repeats its arithmetic. Phases for a low crest factor are Schroeder's, refined by norms of rising
order (Guillaume et al. 1991).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from avc_casadi._util.arrays import FloatArray

Shape = Literal["sine", "release"]
Units = NDArray[np.int64]

FULL = 32767
"""Units of the largest force."""
KNOTS = 33
WHOLE = 1 << 15
"""An envelope of 1."""
_TURN = 1 << 32
_QUARTER = 1 << 30
_POLYNOMIAL = (1686624950, 693528462, 85303417, 4658781)


@dataclass(frozen=True)
class Signal:
    """Sines, or pulls and releases, under an envelope.

    Attributes:
        step: of each phase in a tick, in turns of 2^32.
        phase: at the beginning, in turns of 2^16.
        amplitude: units, FULL being the largest force.
        growth: of every step in a tick, in 2^-32: a chirp whose frequency grows by a constant factor.
        knots: envelope at 33 times evenly spread over the time played, of 2^15.
        shape: sine; or release: slow pull and release, in alternating directions.
    """

    step: tuple[int, ...]
    phase: tuple[int, ...]
    amplitude: tuple[int, ...]
    growth: int = 0
    knots: tuple[int, ...] = (WHOLE,) * KNOTS
    shape: Shape = "sine"

    @classmethod
    def of(
        cls,
        frequency_hz: Sequence[float] | FloatArray,
        amplitude: Sequence[float] | FloatArray,
        phase_rad: Sequence[float] | FloatArray,
        sample_time_s: float,
        *,
        growth_per_tick: float = 0.0,
        knots: Sequence[float] | FloatArray | None = None,
        shape: Shape = "sine",
    ) -> Signal:
        """Round to the device's integers.

        Args:
            frequency_hz: of each tone, at the beginning.
            amplitude: of each tone as a share of the largest force.
            phase_rad: of each sine at the beginning.
            sample_time_s: T.
            growth_per_tick: relative growth of the frequencies.
            knots: envelope, 0 to 1, shape (33,); None is 1 throughout.
            shape: of the tones.
        """
        turns = np.asarray(frequency_hz) * sample_time_s
        return cls(
            step=tuple(round(float(one) * _TURN) for one in turns),
            phase=tuple(round(float(one) / (2 * np.pi) * 65536) % 65536 for one in np.asarray(phase_rad)),
            amplitude=tuple(round(float(one) * FULL) for one in np.asarray(amplitude)),
            growth=round(growth_per_tick * _TURN),
            knots=(WHOLE,) * KNOTS if knots is None else tuple(round(float(one) * WHOLE) for one in np.asarray(knots)),
            shape=shape,
        )

    def units(self, ticks: int) -> Units:
        """Return the signal under its envelope, in units, shape (ticks,)."""
        total = np.zeros(ticks, dtype=np.int64)
        make = _sine if self.shape == "sine" else _release
        for step, phase, amplitude in zip(self.step, self.phase, self.amplitude, strict=True):
            total += amplitude * make(_phases(step, phase, self.growth, ticks))
        return _over(_over(total, FULL) * self._envelope(ticks), WHOLE)

    def frequency_hz(self, ticks: int, sample_time_s: float) -> tuple[float, float]:
        """Return the lowest and the highest frequency played."""
        last = 1.0 + self.growth / _TURN
        found = [step / _TURN / sample_time_s for step in self.step]
        return min(found), max(found) * last**ticks

    def _envelope(self, ticks: int) -> Units:
        at = np.arange(ticks, dtype=np.int64) * ((_TURN - 1) // ticks)
        knots = np.array(self.knots, dtype=np.int64)
        low, high = knots[at >> 27], knots[(at >> 27) + 1]
        return np.asarray(low + _over((high - low) * (at >> 12 & 0x7FFF), WHOLE), dtype=np.int64)


def ramp(ticks: int, ramp_ticks: int) -> Units:
    """Return the ramp in and out that the device applies, of 2^15, shape (ticks,)."""
    gone = np.arange(1, ticks + 1, dtype=np.int64)
    near = np.minimum(gone, gone[::-1])
    return np.asarray(np.where(near < ramp_ticks, (near << 15) // ramp_ticks, WHOLE), dtype=np.int64)


def _phases(step: int, phase: int, growth: int, ticks: int) -> Units:
    start = phase << 16
    if not growth:
        return (start + np.arange(ticks, dtype=np.uint64) * np.uint64(step)).astype(np.int64) & (_TURN - 1)
    found = np.empty(ticks, dtype=np.int64)
    fine = step << 32
    for tick in range(ticks):
        found[tick] = start
        whole = fine >> 32
        start = (start + whole) & (_TURN - 1)
        fine = (fine + whole * growth) & ((1 << 64) - 1)
    return found


def _sine(phase: Units) -> Units:
    within = phase & (_QUARTER - 1)
    x = np.where(phase & _QUARTER, _QUARTER - within, within)
    c = _POLYNOMIAL
    square = x * x >> 30
    inner = c[1] - (square * (c[2] - (square * c[3] >> 30)) >> 30)
    value = x * (c[0] - (square * inner >> 30)) >> 30
    rounded = (value * FULL + (_QUARTER >> 1)) >> 30
    return np.asarray(np.where(phase >> 31, -rounded, rounded), dtype=np.int64)


def _release(phase: Units) -> Units:
    pulled, quadrant = (phase & (_QUARTER - 1)) >> 15, phase >> 30
    return np.asarray(np.where(quadrant == 0, pulled, np.where(quadrant == 2, -pulled, 0)), dtype=np.int64)


def _over(value: Units, by: int) -> Units:
    """Divide towards zero, as C does."""
    return np.asarray(np.sign(value) * (np.abs(value) // by), dtype=np.int64)


_ORDERS = (4, 8, 16, 32)
_STEPS = 60


def schroeder_phases(power: FloatArray) -> FloatArray:
    """Return Schroeder's phases (1970) of tones in order of frequency, rad, shape (tones,).

    Args:
        power: of each tone, in any unit.
    """
    share = power / power.sum()
    return np.asarray(-2 * np.pi * np.cumsum(np.concatenate([[0.0], np.cumsum(share)[:-1]])), dtype=np.float64)


def low_crest_phases(frequency_hz: FloatArray, power: FloatArray, time_s: FloatArray) -> FloatArray:
    """Return phases of a multisine with a low crest factor, rad, shape (tones,).

    Args:
        frequency_hz: of the tones, rising, shape (tones,).
        power: of each, shape (tones,).
        time_s: instants at which the force is evaluated, shape (samples,).
    """
    amplitude = np.sqrt(2 * power / power.sum())
    turns = np.outer(time_s, 2 * np.pi * frequency_hz)
    cosine, sine = np.cos(turns) * amplitude, np.sin(turns) * amplitude

    def norm(phase: FloatArray, order: int) -> tuple[float, FloatArray]:
        wave = sine @ np.cos(phase) + cosine @ np.sin(phase)
        size = np.abs(wave)
        top = float(size.max())
        relative = (size / top) ** (order - 1)
        mean = float(np.mean(relative * size / top))
        pull = np.sign(wave) * relative / (wave.size * mean)
        slope = (pull @ cosine) * np.cos(phase) - (pull @ sine) * np.sin(phase)
        return float(np.log(top) + np.log(mean) / order), np.asarray(slope / top, dtype=np.float64)

    phase = schroeder_phases(power)
    for order in _ORDERS:
        found = minimize(norm, phase, args=(order,), jac=True, method="L-BFGS-B", options={"maxiter": _STEPS})
        phase = np.asarray(found.x, dtype=np.float64)
    return phase


def crest_factor(wave: FloatArray) -> float:
    """Return the crest factor."""
    return float(np.abs(wave).max() / np.sqrt(np.mean(wave**2)))
