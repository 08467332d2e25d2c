"""Where in a log to look how device and hand answered the commanded force."""

from __future__ import annotations

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
