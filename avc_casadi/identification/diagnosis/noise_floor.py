"""The windows of a log that identify device and hand, and the noise floor of a correct structure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import signal

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi.identification.diagnosis.log import Log
from avc_casadi.identification.diagnosis.oscillation import TracedOscillation

LONGEST_DELAY = 14.0
"""Longest delay that is searched, samples."""
_WINDOW_S = 0.4
_CYCLES = 6.0
_LATER_CYCLES = 2.0


@dataclass(frozen=True, eq=False)
class Window:
    """A part of a log."""

    position: FloatArray
    past: FloatArray  # force, from `LONGEST_DELAY` samples before
    rub: FloatArray  # sign of the velocity, smoothed
    use: BoolArray
    before: bool  # whether it lies before the oscillation, when a hand may still have held the device


def windows_of(log: Log, swing: TracedOscillation) -> list[Window]:
    """Choose the windows: end and beginning of the oscillation, and the strongest motion before it if small."""
    period, found = log.ticks.period_s, swing.found
    hertz = found.frequency_hz
    size = int(min(max(_WINDOW_S, _CYCLES / hertz) / period, log.position_m.size - LONGEST_DELAY - 2))
    # The device is released before it oscillates.
    places = [swing.last - size, swing.first + round(_LATER_CYCLES / hertz / period)]
    if not found.steps > 12:
        power = np.convolve(swing.fast_m**2, np.ones(size), mode="valid")
        places.append(int(np.argmax(power)))
    lead = int(LONGEST_DELAY) + 2
    chosen: list[int] = []
    for place in places:
        start = int(np.clip(place, lead, log.position_m.size - size))
        if all(abs(start - other) > size // 3 for other in chosen):
            chosen.append(start)
    smooth = signal.savgol_filter(log.position_m, 9, 2, deriv=1)
    least = 0.05 * max(log.encoder_m, 1e-9 / log.reach_m)
    rub = np.tanh(smooth / least)
    return [
        Window(
            log.position_m[start : start + size] - log.position_m[start],
            log.force_n[start - lead : start + size],
            np.asarray(rub[start : start + size]),
            log.seen[start : start + size],
            start < swing.first,
        )
        for start in chosen
    ]


# Quantisation error is never independent in every sample.
_LEAST_ALIKE = 3.0
# Share of the quantisation error that a fit takes for motion: the root of unknowns over samples.
_TAKEN = 0.2


@dataclass(frozen=True, eq=False)
class Level:
    """Residual of each window to be expected of a correct structure.

    Attributes:
        rms_m: root mean square of one sample, times the root of the number of correlated samples, shape (windows,).
        beyond_m: the same of the part beyond half a step; infinite without an encoder, shape (windows,).
    """

    rms_m: FloatArray
    beyond_m: FloatArray

    @classmethod
    def of(cls, left: Mapping[int, FloatArray], windows: int, noise_m: float, encoder_m: float) -> Level:
        """Take the residual of the best structure as noise to all of them.

        Rounding to encoder steps leaves at most half a step, uniformly distributed: steps / sqrt(12). Only the part of
        it that a fit takes for motion, and other noise, may lie beyond.

        Args:
            left: residual of some windows by index, m.
            windows: number of windows; nothing is expected of the others.
            noise_m: encoder and noise, root mean square.
            encoder_m: encoder resolution, 0 for none.
        """
        rms, beyond = np.full(windows, noise_m), np.full(windows, np.inf)
        rounding = encoder_m / math.sqrt(12)
        for index, residual in left.items():
            size = max(noise_m, rms_of(residual))
            same = math.sqrt(_alike(residual))
            rms[index] = size * same
            if encoder_m:
                beyond[index] = math.sqrt(max(size**2 - rounding**2, (_TAKEN * rounding) ** 2)) * same
        return cls(rms, beyond)


def rms_of(residual: FloatArray) -> float:
    """Return the root mean square."""
    return math.sqrt(float(np.mean(residual**2)))


def _alike(residual: FloatArray) -> float:
    """Return the correlated samples per independent one: 1 + 2 sum rho^2 over the lags (Bartlett), rho the correlation.

    A residual that repeats from cycle to cycle, and a slow one of a moving hand, carries far less information than its
    number of samples.
    """
    n = residual.size
    power = np.abs(np.fft.rfft(residual - residual.mean(), 2 * n)) ** 2
    correlation = np.fft.irfft(power)[: n // 2]
    if not correlation[0] > 0:
        return _LEAST_ALIKE
    # The estimate itself scatters by 1/n.
    squares = (correlation[1:] / correlation[0]) ** 2 - 1 / n
    return max(_LEAST_ALIKE, 1 + 2 * float(np.sum(squares)))
