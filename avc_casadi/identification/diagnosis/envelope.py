"""Amplitude, frequency and growth rate of an oscillating signal."""

from __future__ import annotations

import math

import numpy as np
from scipy import signal

from avc_casadi._util.arrays import FloatArray

LOWEST_HZ = 4.0
"""Slower motion is the hand's own."""
# Over so long, or so many cycles, the logarithm of a constant amplitude changes by less than this.
_LEVEL_S, _LEVEL_CYCLES, _LEVEL = 0.35, 10.0, 0.25


def cycle_samples(hertz: float, period: float) -> int:
    """Return the samples of a cycle at a frequency, Hz, with a sample time, s; an envelope is smoothed over them."""
    return max(3, round(1.0 / hertz / period))


def envelope_of(fast: FloatArray, hertz: float, period: float) -> FloatArray:
    """Return the amplitude of a signal, shape (n,), about a frequency, Hz, with a sample time, s; shape (n,)."""
    ends = (max(0.6 * hertz, LOWEST_HZ), min(1.6 * hertz, 0.49 / period))
    band = signal.butter(2, ends, "bandpass", fs=1 / period, output="sos")
    envelope = np.abs(signal.hilbert(signal.sosfiltfilt(band, fast)))
    smooth = cycle_samples(hertz, period)
    return np.asarray(np.convolve(envelope, np.ones(smooth) / smooth, mode="same"))


def line_of(part: FloatArray, period: float) -> tuple[float, float, float]:
    """Return amplitude and frequency, Hz, of the strongest line, and its share of the power with its harmonics."""
    n = part.size
    window = np.hanning(n)
    spectrum = np.abs(np.fft.rfft(part * window)) ** 2
    hertz = np.fft.rfftfreq(n, period)
    spectrum[hertz < LOWEST_HZ] = 0.0
    total = float(spectrum.sum())
    if total <= 0:
        return 0.0, LOWEST_HZ, 0.0
    peak = int(np.argmax(spectrum))
    near = slice(max(peak - 2, 0), peak + 3)
    power = float(spectrum[near].sum())
    harmonics = sum(
        float(spectrum[max(turn * peak - 2, 0) : turn * peak + 3].sum())
        for turn in range(2, 6)
        if turn * peak < spectrum.size and turn * peak - 2 > peak + 2
    )
    # Hann's window spreads a line over three bins: power in them is a quarter of n times its energy times the square.
    amplitude = 2 * math.sqrt(power / (n * float(np.sum(window**2))))
    exact = float(np.sum(hertz[near] * spectrum[near]) / power)
    return amplitude, exact, (power + harmonics) / total


def level_from(envelope: FloatArray, first: int, last: int, smooth: int, period: float, hertz: float) -> int | None:
    """Return the sample from which a decaying oscillation is constant in amplitude, or None.

    Args:
        envelope: its amplitude, shape (n,).
        first: sample at which it begins.
        last: sample at which it ends.
        smooth: samples over which the envelope is smoothed.
        period: sample time, s.
        hertz: its frequency.
    """
    size = round(max(_LEVEL_S, _LEVEL_CYCLES / hertz) / period)
    end = last - smooth
    if end - first < size:
        return None
    slope, _ = growth_of(envelope, end - size, end, period, hertz)
    if not abs(slope) * size * period < _LEVEL:
        return None
    level = float(np.mean(envelope[end - size : end]))
    away = np.flatnonzero(np.abs(np.log(envelope[first:end] / level)) > 2 * _LEVEL)
    return first + (int(away[-1]) + 1 if away.size else 0)


def growth_of(envelope: FloatArray, begins: int, ends: int, period: float, hertz: float) -> tuple[float, float]:
    """Return the slope of the logarithm of an envelope between two samples, and its standard error, 1/s."""
    cycle = max(2, round(0.5 / hertz / period))
    values = np.log(np.maximum(envelope[begins:ends:cycle], 1e-12))
    if values.size < 4:
        return math.nan, math.nan
    time = np.arange(values.size) * cycle * period
    (slope, _), covariance = np.polyfit(time, values, 1, cov=True)
    return float(slope), float(math.sqrt(covariance[0, 0]))


def travel_of_cycles(position: FloatArray, period: float, hertz: float) -> float:
    """Return the travel in two cycles as measured: a filter overshoots where a position toggles between two steps."""
    size = max(3, math.ceil(2 / hertz / period))
    if position.size < size:
        return math.inf
    windows = np.lib.stride_tricks.sliding_window_view(position, size)[:: max(1, size // 2)]
    return float(np.quantile(np.ptp(windows, axis=1), 0.9))
