"""Ways to read a gain table between its rows; all work over ln(frequency) and in the precision of the rows."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from avc_casadi.model.gains import interpolate, single_ln

Precision = TypeVar("Precision", np.float32, np.float64)
Rows = NDArray[Any]


def _ln(rows: Rows) -> Callable[[Any], Any]:
    """The logarithm of a device for rows in single precision."""
    return single_ln if rows.dtype == np.float32 else np.log


def linear(rows: Rows, frequency_hz: Rows) -> Rows:
    """What the device does: b, k, b_p linear between rows."""
    return interpolate(rows, frequency_hz, _ln(rows))


def nearest(rows: Rows, frequency_hz: Rows) -> Rows:
    """The gains of the nearest row."""
    x, at = _ln(rows)(rows[:, 0]), _ln(rows)(frequency_hz)
    middle = (x[1:] + x[:-1]) / 2
    taken: Rows = rows[np.searchsorted(middle, at), 1:]
    return taken


def pchip(rows: Rows, frequency_hz: Rows) -> Rows:
    """Monotone cubic Hermite pieces: smooth, without overshoot.

    Fritsch and Butland, SIAM J. Sci. Stat. Comput. 5 (1984) 300-304.
    """
    if len(rows) < 3:
        return linear(rows, frequency_hz)
    x, at, y = _ln(rows)(rows[:, 0]), _ln(rows)(frequency_hz), rows[:, 1:]
    step = np.diff(x)[:, None]
    chord = np.diff(y, axis=0) / step
    slope = np.concatenate((chord[:1], _inner_slopes(step, chord), chord[-1:]))
    low = np.clip(np.searchsorted(x, at, side="right") - 1, 0, len(x) - 2)
    h = step[low]
    t = np.clip((at - x[low])[:, None] / h, 0, 1)
    one = t.dtype.type(1)
    bend = t * (one - t)
    straight = y[low] + t * (y[low + 1] - y[low])
    curved = (one - t) * (slope[low] - chord[low]) - t * (slope[low + 1] - chord[low])
    between: Rows = straight + h * bend * curved
    return between


def _inner_slopes(step: Rows, chord: Rows) -> Rows:
    """Weighted harmonic mean of neighbouring chords; 0 where they differ in sign."""
    before, after = chord[:-1], chord[1:]
    w1, w2 = 2 * step[1:] + step[:-1], step[1:] + 2 * step[:-1]
    same = before * after > 0
    with np.errstate(divide="ignore", invalid="ignore", over="ignore", under="ignore"):
        mean = (w1 + w2) / (w1 / before + w2 / after)
    slopes: Rows = np.where(same, mean, before.dtype.type(0))
    return slopes


INTERPOLATIONS: dict[str, Callable[[Rows, Rows], Rows]] = {"linear": linear, "pchip": pchip, "nearest": nearest}
