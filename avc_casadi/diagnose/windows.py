"""The stretches of a log to which device and hand are fitted: the end of a swing, and its begin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import signal

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi.diagnose.oscillation import Log, Oscillation
from avc_casadi.diagnose.priors import Grid

MOST_DELAY = 14.0
"""Longest delay that is searched, ticks of the law."""

_WINDOW_S = 0.4
"""Shortest time of a window, s."""

_WINDOW_CYCLES = 6
"""Fewest cycles in a window."""

_LEFT_OUT_CYCLES = 2
"""Cycles at the begin of a swing that are left out."""

_STEADY_SHARE = 0.05
"""Change of the size of a swing from then to its end, as a share of it, up to which it is steady."""

_WINDOW_MOST = 1500
"""Most ticks in a window."""

_SMOOTH_STEPS = 0.05
"""Encoder steps a tick below which friction has no full sign, as the position does not tell it."""

_SLOWER_THAN_SWING = 3
"""Frequency of the swing, per frequency up to which motion is slow."""

_SLOW_HZ = (2.5, 40.0)
"""Frequencies, Hz, between which that limit lies, if it is not above half of the swing's."""


@dataclass(frozen=True, eq=False)
class LogWindow:
    """A stretch of n ticks of a log to which structures are fitted."""

    start: float
    """Position at its first tick, m."""
    position: FloatArray
    """Position from the start, shape (n,), m."""
    past: FloatArray
    """Force, N, of these ticks and of those before it up to the longest delay."""
    rub: FloatArray
    """Sign of the velocity, smoothed, shape (n,)."""
    use: BoolArray
    """Whether each tick is in the log, shape (n,)."""
    slow: FloatArray
    """c cosines whose sums are the motion that is slow beside the swing, which may be of anything, shape (n, c)."""


def _begin_of(log: Log, swing: Oscillation) -> int:
    """Return the tick at which the first window of a swing begins.

    What the hand does at the begin of a swing is left out for two cycles. A swing that is steady by then shows only
    before how it came to its size, which tells a late force from travel stops.
    """
    cycle = max(round(1 / swing.frequency_hz / log.period_s), 2)
    later = swing.first + _LEFT_OUT_CYCLES * cycle

    def size_at(tick: int) -> float:
        return float(np.ptp(log.position_m[tick : tick + cycle]))

    if later + cycle > swing.last:
        return later
    steady = abs(size_at(later) - size_at(swing.last - cycle)) < _STEADY_SHARE * swing.peak_to_peak_m
    return swing.first if steady else later


def windows_of(log: Log, swing: Oscillation, grid: Grid) -> list[LogWindow]:
    """Return the stretches of a log that a plant is fitted to: end and beginning of the swing, where they are apart."""
    period, n, before = log.period_s, log.position_m.size, int(MOST_DELAY * grid.a_tick) + 2
    cycles_s = max(_WINDOW_S, _WINDOW_CYCLES / swing.frequency_hz)
    size = int(min(cycles_s / period, _WINDOW_MOST, n - before))
    last = int(np.clip(swing.last - size, before, n - size))
    first = int(np.clip(_begin_of(log, swing), before, n - size))
    begins = [last, first] if abs(first - last) > size // 3 else [last]
    speed = signal.savgol_filter(log.position_m, 5, 2, deriv=1)
    rub = np.tanh(speed / max(_SMOOTH_STEPS * log.encoder_m, 1e-3 * float(np.std(speed)), 1e-12))
    slow_hz = min(float(np.clip(swing.frequency_hz / _SLOWER_THAN_SWING, *_SLOW_HZ)), swing.frequency_hz / 2)
    orders = np.arange(int(2 * slow_hz * size * period) + 2)
    slow = np.cos(np.pi * np.outer(np.arange(size) + 0.5, orders) / size)
    windows = []
    for begin in begins:
        part = slice(begin, begin + size)
        start = log.position_m[begin]
        past = log.force_n[begin - before : begin + size]
        windows.append(LogWindow(float(start), log.position_m[part] - start, past, rub[part], log.ran[part], slow))
    return windows
