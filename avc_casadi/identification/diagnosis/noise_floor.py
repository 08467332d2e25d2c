"""Where in a log to look how device and hand answered, and what a right structure may leave there (the noise floor)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import signal

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi.identification.diagnosis.log import Log
from avc_casadi.identification.diagnosis.oscillation import Swing

LONGEST_DELAY = 14.0
"""Samples of delay that are looked for at most."""
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


def windows_of(log: Log, swing: Swing) -> list[Window]:
    """Choose where to look: the end of the oscillation, its beginning, and the strongest motion before it if small."""
    period, found = log.ticks.period_s, swing.found
    hertz = found.frequency_hz
    size = int(min(max(_WINDOW_S, _CYCLES / hertz) / period, log.position_m.size - LONGEST_DELAY - 2))
    # What lets go of the device does so before it swings.
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


# What an encoder leaves is never fresh noise in every sample.
_LEAST_ALIKE = 3.0
# Share of what an encoder leaves that a fit takes for motion: the root of unknowns over samples.
_TAKEN = 0.2


@dataclass(frozen=True, eq=False)
class Level:
    """What may be left of each window where a structure is right.

    Attributes:
        rms_m: root mean square of one sample, times the root of how many samples say the same, shape (windows,).
        beyond_m: the same of what goes beyond half a step; infinite without an encoder, shape (windows,).
    """

    rms_m: FloatArray
    beyond_m: FloatArray

    @classmethod
    def of(cls, left: Mapping[int, FloatArray], windows: int, noise_m: float, encoder_m: float) -> Level:
        """Judge by what the best structure leaves: what that does not explain is noise to all of them.

        Rounding to the steps of an encoder leaves at most half a step, evenly spread: steps / sqrt(12). Only what a
        fit takes of that for motion, and what is no rounding, may lie beyond.

        Args:
            left: residual of some windows by index, m.
            windows: how many there are; nothing is expected of the others.
            noise_m: what encoder and noise leave, root mean square.
            encoder_m: step of the encoder, 0 for none.
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
    """Return how many samples say what one says: 1 + 2 sum rho^2 over the lags (Bartlett), of rho the correlation.

    A residual that is alike from cycle to cycle, and a slow one of a hand that moved, tells far less than its samples.
    """
    n = residual.size
    power = np.abs(np.fft.rfft(residual - residual.mean(), 2 * n)) ** 2
    correlation = np.fft.irfft(power)[: n // 2]
    if not correlation[0] > 0:
        return _LEAST_ALIKE
    # The estimate itself scatters by 1/n.
    squares = (correlation[1:] / correlation[0]) ** 2 - 1 / n
    return max(_LEAST_ALIKE, 1 + 2 * float(np.sum(squares)))
