"""Stationary points of Re Z_h over frequency: roots of N'D - N D' in c = cos(omega T), in a Chebyshev basis.

Re Z_h = A(c) + c_0 M(c)/D(c) with deg A = delay + 1, deg M = delay + 2, D = 1 + rho^2 - 2 rho c; its derivative
vanishes where A' D^2 + c_0 (M' D + 2 rho M) does, a polynomial of degree delay + 2.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import chebyshev

from avc_casadi.passivity._roots import real_parts_of_roots
from avc_casadi.support import FloatArray

if TYPE_CHECKING:
    from avc_casadi.passivity._sampled import (
        Fractions,
        SampledLoop,
    )


def stationary_cosines(loop: SampledLoop, parts: Fractions, contact_damping_ns_per_m: FloatArray) -> FloatArray:
    """Return the real parts of all roots, clipped to [-1, 1].

    A root counts whether its imaginary part is small or not: the caller evaluates Re Z_h there, which costs little, and
    no double root is lost to rounding.

    Args:
        loop: the sampled loop.
        parts: partial fractions of n rows, each of shape (n,).
        contact_damping_ns_per_m: b_p, shape (n,).

    Returns:
        Shape (n, delay + 2); where a row has fewer roots, the rest is 1.
    """
    gain, integral, kernel = _shapes(loop)
    rho = parts.pole[:, None]
    gain_slope: FloatArray = np.asarray(chebyshev.chebder(gain), dtype=np.float64)
    integral_slope: FloatArray = np.asarray(chebyshev.chebder(integral), dtype=np.float64)
    smooth = (parts.direct + contact_damping_ns_per_m)[:, None] * gain_slope + parts.integral[:, None] * integral_slope
    # M(c) = kernel of w^n less rho times that of w^(n-1).
    decaying = parts.decaying[:, None] * (kernel[None, :] - rho * np.pad(gain, (0, 1))[None, :])
    degree = loop.whole_delay("the polynomial of stationary points") + 2
    polynomial = _fit(_times_distance(_times_distance(smooth, rho), rho), degree)
    slope: FloatArray = np.asarray(chebyshev.chebder(decaying, axis=1), dtype=np.float64)
    polynomial = polynomial + _fit(_times_distance(slope, rho) + 2 * rho * decaying, degree)
    return np.clip(real_parts_of_roots(polynomial), -1.0, 1.0)


def _shapes(loop: SampledLoop) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Re H, Re H w/(1 - w) and Re H w as Chebyshev coefficients."""
    d = loop.whole_delay("the polynomial of stationary points")
    unit = np.eye(d + 3)
    ramp = np.array([[-0.5, *([-1.0] * (n - 1)), *([0.0] * (d + 3 - n))] for n in (d + 1, d + 2)])
    if loop.model == "paper":
        return (
            (unit[d] + unit[d + 1])[: d + 2] / 2,
            (ramp[0] + ramp[1])[: d + 2] / 2,
            (unit[d + 1] + unit[d + 2]) / 2,
        )
    return unit[d + 1][: d + 2], ramp[1][: d + 2], unit[d + 2]


def _times_distance(rows: FloatArray, rho: FloatArray) -> FloatArray:
    """Multiply by D = 1 + rho^2 - 2 rho c."""
    product = np.zeros((rows.shape[0], rows.shape[1] + 1))
    product[:, 1:] = rows / 2
    product[:, 1:2] += rows[:, :1] / 2
    product[:, : rows.shape[1] - 1] += rows[:, 1:] / 2
    product *= -2 * rho
    product[:, :-1] += (1 + rho**2) * rows
    return product


def _fit(rows: FloatArray, degree: int) -> FloatArray:
    """Pad with zeros to degree + 1 columns; a wider array has only zeros beyond."""
    short = rows[:, : degree + 1]
    return np.pad(short, ((0, 0), (0, degree + 1 - short.shape[1])))
