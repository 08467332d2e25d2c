"""The firmware's look-up once more in numpy single precision: bit for bit what the device computes."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from avc_hardware._table import Float32Array

_f = np.float32
_LN_2 = _f(0.693147182)
_SERIES = tuple(map(_f, (0.142857149, 0.2, 0.333333343, 1.0)))


def ln(x: ArrayLike) -> Float32Array:
    """Natural logarithm of normal positive numbers, any shape: exponent times ln 2, plus 2 artanh((m-1)/(m+1))."""
    bits = np.asarray(x, dtype=np.float32).view(np.uint32)
    exponent = (bits >> 23).astype(np.int32) - 127
    m = ((bits & np.uint32(0x007FFFFF)) | np.uint32(0x3F800000)).view(np.float32)
    large = m > _f(1.41421354)
    m = np.where(large, m * _f(0.5), m)
    exponent = exponent + large
    s = (m - _f(1)) / (m + _f(1))
    z = s * s
    series = np.full_like(z, 0.111111112)
    for coefficient in _SERIES:
        series = series * z + coefficient
    result: Float32Array = exponent.astype(np.float32) * _LN_2 + (s + s) * series
    return result


def lookup(rows: Float32Array, frequency_hz: ArrayLike) -> Float32Array:
    """Gains at frequencies: linear in ln(frequency), the end rows beyond the ends, the first row where undefined (NaN).

    Args:
        rows: shape (n, 4), single precision: frequency_hz, b, k, b_p, rising in frequency.
        frequency_hz: any shape.

    Returns:
        b, k, b_p along a last axis of 3, single precision.
    """
    at = np.asarray(frequency_hz, dtype=np.float32)
    frequency, gains = rows[:, 0], rows[:, 1:]
    inside = (at > frequency[0]) & (at < frequency[-1])
    safe = np.where(inside, at, frequency[0])
    low = np.clip(np.searchsorted(frequency, safe, side="right") - 1, 0, max(len(rows) - 2, 0))
    high = np.minimum(low + 1, len(rows) - 1)
    base = ln(frequency[low])
    span = ln(frequency[high]) - base
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (ln(safe) - base) / span
    share = np.where((share >= 0) & (share <= 1), share, _f(0))[..., None]
    between = gains[low] + share * (gains[high] - gains[low])
    ends = np.where((at >= frequency[-1])[..., None], gains[-1], gains[0])
    result: Float32Array = np.where(inside[..., None], between, ends)
    return result
