"""A gain table between its rows: linear in ln(frequency), as the device does it, in double or single precision."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    pass

Precision = TypeVar("Precision", np.float32, np.float64)

_LN_2 = np.float32(0.693147182)
_SERIES = tuple(map(np.float32, (0.142857149, 0.2, 0.333333343, 1.0)))


def interpolate(
    rows: NDArray[Precision], frequency_hz: ArrayLike, ln: Callable[[Any], Any] = np.log
) -> NDArray[Precision]:
    """Gains at frequencies: linear in ln(frequency), hence monotone between rows; the end rows hold beyond the ends.

    Args:
        rows: shape (n, 4): frequency_hz, b, k, b_p, rising in frequency; their precision is that of the arithmetic.
        frequency_hz: any shape; where it is not a number (undefined on a device at rest) the first row holds.
        ln: natural logarithm; `single_ln` together with rows in single precision gives the bits of a device.

    Returns:
        b, k, b_p along a last axis of 3, in the precision of the rows.
    """
    at = np.asarray(frequency_hz, dtype=rows.dtype)
    frequency, gains = rows[:, 0], rows[:, 1:]
    inside = (at > frequency[0]) & (at < frequency[-1])
    safe = np.where(inside, at, frequency[0])
    low = np.clip(np.searchsorted(frequency, safe, side="right") - 1, 0, max(len(rows) - 2, 0))
    high = np.minimum(low + 1, len(rows) - 1)
    base = ln(frequency[low])
    span = ln(frequency[high]) - base
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (ln(safe) - base) / span
    share = np.where((share >= 0) & (share <= 1), share, rows.dtype.type(0))[..., None]
    between = gains[low] + share * (gains[high] - gains[low])
    ends = np.where((at >= frequency[-1])[..., None], gains[-1], gains[0])
    return np.asarray(np.where(inside[..., None], between, ends))


def single_ln(x: ArrayLike) -> NDArray[np.float32]:
    """Natural logarithm of normal positive numbers in single precision, any shape, operation by operation as a device.

    The exponent times ln 2, plus 2 artanh((m - 1)/(m + 1)) of the mantissa m by its series.
    """
    one = np.float32(1)
    bits = np.asarray(x, dtype=np.float32).view(np.uint32)
    exponent = (bits >> 23).astype(np.int32) - 127
    m = ((bits & np.uint32(0x007FFFFF)) | np.uint32(0x3F800000)).view(np.float32)
    large = m > np.float32(1.41421354)
    m = np.where(large, m * np.float32(0.5), m)
    exponent = exponent + large
    s = (m - one) / (m + one)
    z = s * s
    series = np.full_like(z, 0.111111112)
    for coefficient in _SERIES:
        series = series * z + coefficient
    result: NDArray[np.float32] = exponent.astype(np.float32) * _LN_2 + (s + s) * series
    return result
