"""The firmware's look-up once more in numpy single precision: bit for bit what the device computes."""

from __future__ import annotations

from numpy.typing import ArrayLike

from avc_casadi._util.arrays import Float32Array
from avc_casadi.model.gains import interpolate
from avc_casadi.model.gains import single_ln as ln

__all__ = ["ln", "lookup"]


def lookup(rows: Float32Array, frequency_hz: ArrayLike) -> Float32Array:
    """Gains at frequencies: linear in ln(frequency), the end rows beyond the ends, the first row where undefined (NaN).

    Args:
        rows: shape (n, 4), single precision: frequency_hz, b, k, b_p, rising in frequency.
        frequency_hz: any shape.

    Returns:
        b, k, b_p along a last axis of 3, single precision.
    """
    return interpolate(rows, frequency_hz, ln)
