"""A gain table between its rows: linear in ln(frequency), as the device does it, in double or single precision."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from avc_casadi._errors import InputError
from avc_casadi.support import FloatArray

if TYPE_CHECKING:
    from avc_casadi.coupling._schedule import GainSchedule

Precision = TypeVar("Precision", np.float32, np.float64)

_LN_2 = np.float32(0.693147182)
_SERIES = tuple(map(np.float32, (0.142857149, 0.2, 0.333333343, 1.0)))


def gain_rows(gains: GainSchedule) -> FloatArray:
    """Rows of a schedule that carry gains, rising in frequency.

    Returns:
        Shape (n, 4): frequency_hz, b (N.s/m), k (N/m), b_p (N.s/m).

    Raises:
        InputError: no row carries gains.
    """
    if not gains.usable.any():
        raise InputError.of(
            f"{gains.problem} by {gains.method} has no row with gains; choose another method or widen [coupling]",
            key="status",
        )
    columns = (
        gains.frequency_hz,
        gains.damping_ns_per_m,
        gains.stiffness_n_per_m,
        gains.contact_damping_ns_per_m,
    )
    rows = np.stack(columns, axis=1)[gains.usable]
    return np.asarray(rows[np.argsort(rows[:, 0], kind="stable")])


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


def row_slopes(rows: FloatArray) -> FloatArray:
    """Slopes d ln(gain)/d ln(frequency) between neighbouring rows.

    Args:
        rows: shape (n, 4): frequency_hz, b, k, b_p.

    Returns:
        Shape (n - 1, 3): of b, k and b_p; not a number where one of the two gains is 0.
    """
    gains = np.where(rows[:, 1:] > 0, rows[:, 1:], np.nan)
    return np.asarray(np.diff(np.log(gains), axis=0) / np.diff(np.log(rows[:, :1]), axis=0))
