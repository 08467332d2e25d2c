"""A gain table between its rows: linear in ln(frequency), as the device does it, in double or single precision."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

Precision = TypeVar("Precision", np.float32, np.float64)


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


@dataclass(frozen=True)
class DeviceLn:
    """Natural logarithm of normal positive numbers as a device computes it, operation by operation.

    The exponent times ln 2, plus 2 artanh((m - 1)/(m + 1)) of the mantissa m, 2^-1/2 to 2^1/2, by its series.

    Attributes:
        dtype: precision of every operation.
        bits: unsigned integers of its size.
        mantissa_bits: of a number, without the leading one.
        terms: of the series; what is left out is below a rounding of the first.
    """

    dtype: type[Any]
    bits: type[Any]
    mantissa_bits: int
    terms: int

    @property
    def coefficients(self) -> list[float]:
        """1/(2 j + 1), the smallest first."""
        return [1.0 / (2 * j + 1) for j in reversed(range(self.terms))]

    def __call__(self, x: ArrayLike) -> Any:
        """Return ln x, any shape, in this precision."""
        number, whole = self.dtype, self.bits
        bits = np.asarray(x, dtype=number).view(whole)
        one = number(1)
        fraction = whole((1 << self.mantissa_bits) - 1)
        above_one = bits >> whole(self.mantissa_bits)
        bias = np.asarray(one).view(whole) >> whole(self.mantissa_bits)
        exponent = above_one.astype(np.int32) - np.int32(bias)
        m = ((bits & fraction) | np.asarray(one).view(whole)).view(number)
        large = m > number(np.sqrt(2.0))
        m = np.where(large, m * number(0.5), m)
        exponent = exponent + large
        s = (m - one) / (m + one)
        z = s * s
        first, *others = self.coefficients
        series = np.full_like(z, first)
        for coefficient in others:
            series = series * z + number(coefficient)
        return exponent.astype(number) * number(np.log(2.0)) + (s + s) * series


single_ln = DeviceLn(np.float32, np.uint32, 23, 5)
double_ln = DeviceLn(np.float64, np.uint64, 52, 12)
