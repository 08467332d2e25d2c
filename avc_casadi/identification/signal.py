"""The signal of an excitation in the integer arithmetic of the device.

It sums sines whose phases are integers in turns of 2^32, so that a few numbers describe any duration without drift, and
the same bits everywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from avc_casadi._util.arrays import ComplexArray, FloatArray

Kind = Literal["multisine", "chirp"]

Integers = NDArray[np.int64]

FULL = 32767
"""Units of the largest force."""
KNOTS = 33
WHOLE = 1 << 15
"""An envelope of 1."""
TURN = 1 << 32
"""A turn of a phase, in the integers of the device."""
QUARTER = 1 << 30
"""A quarter of a turn."""
HAIR = 1e-9
"""Share by which the points where a whole number changes over lie off the natural values, such as 2 or a half, so that
last bits do not decide between two whole numbers."""


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
        """Round to the integers of the device.

        Amplitudes are shares of the largest force. Every tick the frequency grows by the share `growth_per_tick`.
        `knots` from 0 to 1 are the envelope, equally spaced over the motion.
        """
        return cls(
            step=tuple(round(float(turns) * TURN) for turns in np.asarray(frequency_hz) * sample_time_s),
            phase=tuple(round(float(angle_rad) / (2 * np.pi) * 65536) % 65536 for angle_rad in phase_rad),
            amplitude=tuple(round(float(share) * FULL) for share in amplitude),
            growth=round(growth_per_tick * TURN),
            knots=tuple(round(float(share) * WHOLE) for share in knots),
        )

    def units(self, ticks: int) -> Integers:
        """Return the signal under its envelope, in units, shape (ticks,)."""
        total = np.zeros(ticks, dtype=np.int64)
        for step, phase, amplitude in zip(self.step, self.phase, self.amplitude, strict=True):
            total += amplitude * _sine(_phases(step, phase, self.growth, ticks))
        place = np.arange(ticks, dtype=np.int64) * ((TURN - 1) // ticks)
        knots = np.array(self.knots, dtype=np.int64)
        low, high = knots[place >> 27], knots[(place >> 27) + 1]
        envelope = low + _over((high - low) * (place >> 12 & 0x7FFF), WHOLE)
        return _over(_over(total, FULL) * envelope, WHOLE)

    def frequency_hz(self, ticks: int, sample_time_s: float) -> tuple[float, float]:
        """Return the lowest and the highest frequency played."""
        hertz = [step / TURN / sample_time_s for step in self.step]
        return min(hertz), max(hertz) * (1.0 + self.growth / TURN) ** ticks


def _phases(step: int, phase: int, growth: int, ticks: int) -> Integers:
    """Return the phases of a tone in each tick, in integers of a turn, as the firmware adds them up; exact.

    `step` is the phase of a tick, which grows by the share `growth`, as in a chirp.
    """
    start = phase << 16
    if not growth:
        return (start + np.arange(ticks, dtype=np.uint64) * np.uint64(step)).astype(np.int64) & (TURN - 1)
    phases = np.empty(ticks, dtype=np.int64)
    fine = step << 32
    for tick in range(ticks):
        phases[tick] = start
        whole = fine >> 32
        start = (start + whole) & (TURN - 1)
        fine = (fine + whole * growth) & ((1 << 64) - 1)
    return phases


_SINE = (1686624950, 693528462, 85303417, 4658781)
"""Coefficients of sin(pi x/2) = c1 x - c3 x^3 + c5 x^5 - c7 x^7 over a quarter of a turn, times 2^30."""


def _sine(phase: Integers) -> Integers:
    """Return the sine of phases in the integer arithmetic of the device, times `FULL`."""
    within = phase & (QUARTER - 1)
    x = np.where(phase & QUARTER, QUARTER - within, within)
    first, third, fifth, seventh = _SINE
    square = x * x >> 30
    inner = third - (square * (fifth - (square * seventh >> 30)) >> 30)
    value = x * (first - (square * inner >> 30)) >> 30
    units = (value * FULL + (QUARTER >> 1)) >> 30
    return np.asarray(np.where(phase >> 31, -units, units), dtype=np.int64)


def _over(value: Integers, by: int) -> Integers:
    """Divide towards zero, as C does."""
    return np.asarray(np.sign(value) * (np.abs(value) // by), dtype=np.int64)


def ramp(ticks: int, ramp_ticks: int) -> Integers:
    """Return the ramp in and out that the device applies, of 2^15, shape (ticks,)."""
    tick = np.arange(1, ticks + 1, dtype=np.int64)
    near = np.minimum(tick, tick[::-1])
    return np.asarray(np.where(near < ramp_ticks, (near << 15) // ramp_ticks, WHOLE), dtype=np.int64)


_DESCENT_STEPS = 200
"""Steps of the descent to a low crest factor: 400 lower it by less than 1 per cent more."""
_FIRST_ORDER = 4.0
_LAST_ORDER = 32.0
"""Order of the norm at the last step: a higher one is nearer to the peak, and has more local minima."""
_INERTIA = 0.8
"""Share of a step that the next one repeats (Nesterov 1983)."""
_LEAST_SHARE = 0.1
"""Tones of less power than this share of the mean move as if they had it. Without that a step turns the phase of a weak
tone by whole turns, and every step enlarges the last bits."""


_SPEED_WEIGHT = 0.3
"""Weight of the peak of the speed, that of the force being 1. Most devices reach the limit of speed first: within the
same limits the signal of 10 s has 39 per cent more force (rms, median of 15 devices) than without any weight, at a
crest factor 4 per cent higher."""


def low_crest_phases(
    frequency_hz: FloatArray, amplitude: FloatArray, time_s: FloatArray, speed_per_force: ComplexArray | None = None
) -> FloatArray:
    """Return phases of a multisine with a low crest factor, and a low peak of the speed where its response is given.

    Schroeder's phases (1970) are refined as Guillaume et al. (1991) do, by norms ||w||_p of rising order p of the force
    w = sum a_k sin(2 pi f_k t + phi_k), and of the speed with a weight. Such a norm has many minima. A search that
    compares values takes another one for another last bit, so the steps here are fixed:

        psi = phi + 0.8 (phi - phi before),    phi_k <- psi_k - d(sum of weight log ||w||_p)/d(phi_k) / (p s_k)

    with s_k the share of the power, which is in proportion to the curvature. Phases are then a smooth function of the
    amplitudes: a small relative change of these becomes at most 3 000 times as large, rad (15 devices, 2 and 10 s).
    """
    responses = [np.ones(frequency_hz.size, dtype=np.complex128)]
    weight = np.ones(1)
    if speed_per_force is not None:
        responses.append(speed_per_force)
        weight = np.array([1.0, _SPEED_WEIGHT])
    phasors = amplitude[:, None] * np.stack(responses, axis=1)
    power = np.abs(phasors) ** 2 / np.sum(np.abs(phasors) ** 2, axis=0)
    share = power @ weight
    curvature = np.maximum(share, _LEAST_SHARE * np.mean(share))
    turns = np.outer(time_s, 2 * np.pi * frequency_hz)
    sine, cosine = np.sin(turns), np.cos(turns)
    phase = np.asarray(-2 * np.pi * np.cumsum(np.concatenate([[0.0], np.cumsum(power[:-1, 0])])), dtype=np.float64)
    before = phase
    for order in np.geomspace(_FIRST_ORDER, _LAST_ORDER, _DESCENT_STEPS):
        ahead = phase + _INERTIA * (phase - before)
        tones = phasors * np.exp(1j * ahead)[:, None]
        waves = sine @ tones.real + cosine @ tones.imag
        top = np.abs(waves).max(axis=0)  # against overflow; it cancels
        relative = np.abs(waves) / top
        pull = np.sign(waves) * relative ** (order - 1)
        pull /= top * np.sum(np.abs(pull) * relative, axis=0)
        slope = tones.real * (cosine.T @ pull) - tones.imag * (sine.T @ pull)
        before, phase = phase, ahead - slope @ weight / (order * curvature)
    return phase
