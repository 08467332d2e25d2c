"""Resolution of the encoder, from the lattice of its readings."""

from __future__ import annotations

import numpy as np

from avc_casadi._util.arrays import FloatArray

_MOST_VALUES = 4000
# Readings off the lattice by this share of a step, root mean square, are still on it: files and time stamps are
# rounded.
_OFF = 0.08
_FEWEST = 6
# A fast hand crosses many steps between two readings: the nearest two may be so many steps apart.
_APART = 6


def lattice_step(readings_m: FloatArray) -> float | None:
    """Return the resolution of the encoder, or None where the readings lie on no lattice."""
    values = np.unique(readings_m)
    if values.size < _FEWEST:
        return None
    gaps = np.diff(values)
    # Values that differ by rounding only are one.
    gaps = gaps[gaps > 1e-9 * (values[-1] - values[0])]
    usual = float(np.median(gaps[gaps < 1.5 * np.quantile(gaps, 0.1)]))
    guesses = {guess / apart for guess in (usual, float(gaps.min())) for apart in range(1, _APART + 1)}
    for guess in sorted(guesses, reverse=True):
        step = _refined(guess, gaps, values)
        steps = (values[:: max(1, values.size // _MOST_VALUES)] - values[0]) / step
        off = steps - np.round(steps)
        if steps.max() >= _FEWEST - 0.5 and float(np.sqrt(np.mean(off**2))) < _OFF:
            return step
    return None


def _refined(step: float, gaps: FloatArray, values: FloatArray) -> float:
    """Refine a step by counting steps over ever longer spans."""
    reach = 20 * step
    some = gaps[gaps <= reach]
    while True:
        counts = np.round(some / step)
        if counts.any():
            step = float(some @ counts / (counts @ counts))
        if reach > 4 * (values[-1] - values[0]):
            return step
        reach *= 3
        some = values[: np.searchsorted(values, values[0] + reach, side="right")] - values[0]
        some = some[:: max(1, some.size // _MOST_VALUES)]
