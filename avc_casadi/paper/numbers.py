"""Number systems in which the equations are evaluated: numpy arrays, CasADi expressions, or 50 digits in tests.

An equation needs complex arithmetic, ``.real``, ``.imag``, ``.conjugate()`` and a sine. CasADi has no complex numbers,
so that `ComplexExpr` pairs two of its expressions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

# One equation serves numpy arrays, numbers of 50 digits and CasADi expressions, which share no static type.
Real = Any
Complex = Any


@dataclass(frozen=True)
class ComplexExpr:
    """A complex number whose real and imaginary parts are CasADi expressions (or plain numbers)."""

    real: Real
    imag: Real

    @staticmethod
    def of(value: Complex) -> ComplexExpr:
        """Return a real or complex number or a CasADi expression as this type."""
        if isinstance(value, ComplexExpr):
            return value
        if isinstance(value, complex | np.complexfloating):
            return ComplexExpr(float(value.real), float(value.imag))
        return ComplexExpr(value, 0.0)

    def conjugate(self) -> ComplexExpr:
        """Return the complex conjugate."""
        return ComplexExpr(self.real, -self.imag)

    def __neg__(self) -> ComplexExpr:
        return ComplexExpr(-self.real, -self.imag)

    def __add__(self, other: Complex) -> ComplexExpr:
        other = ComplexExpr.of(other)
        return ComplexExpr(self.real + other.real, self.imag + other.imag)

    __radd__ = __add__

    def __sub__(self, other: Complex) -> ComplexExpr:
        return self + (-ComplexExpr.of(other))

    def __rsub__(self, other: Complex) -> ComplexExpr:
        return ComplexExpr.of(other) + (-self)

    def __mul__(self, other: Complex) -> ComplexExpr:
        other = ComplexExpr.of(other)
        return ComplexExpr(
            self.real * other.real - self.imag * other.imag, self.real * other.imag + self.imag * other.real
        )

    __rmul__ = __mul__

    def __truediv__(self, other: Complex) -> ComplexExpr:
        if not isinstance(other, ComplexExpr | complex | np.complexfloating):
            return ComplexExpr(self.real / other, self.imag / other)
        other = ComplexExpr.of(other)
        product = self * other.conjugate()
        scale = other.real * other.real + other.imag * other.imag
        return ComplexExpr(product.real / scale, product.imag / scale)

    def __rtruediv__(self, other: Complex) -> ComplexExpr:
        return ComplexExpr.of(other) / self


@dataclass(frozen=True)
class NumberSystem:
    """Operations that an equation needs beyond arithmetic.

    Attributes:
        sin_pi: x -> sin(pi x).
        complex: joins a real and an imaginary part.
        number: takes a Python float into the system.
        one_for_zero: x -> x, or 1 where x is 0.
    """

    sin_pi: Callable[[Real], Real]
    complex: Callable[[Real, Real], Complex]
    number: Callable[[float], Real]
    one_for_zero: Callable[[Real], Real]

    def cos_pi(self, x: Real) -> Real:
        """Return cos(pi x), with full relative accuracy near its zero at x = 1/2 (the Nyquist frequency)."""
        return self.sin_pi(0.5 - x)


def _numpy_complex(re: Real, im: Real) -> Complex:
    """Join two arrays without the product 1j * im, which costs time and turns infinities into not a number."""
    z = np.empty(np.broadcast_shapes(np.shape(re), np.shape(im)), dtype=np.complex128)
    z.real, z.imag = re, im
    return z[()]


NUMPY = NumberSystem(
    sin_pi=lambda x: np.sin(np.pi * np.asarray(x)),
    complex=_numpy_complex,
    number=float,
    one_for_zero=lambda x: np.where(x == 0, 1.0, x),
)


def casadi_numbers() -> NumberSystem:
    """Return the CasADi system (SX, MX or DM); imported on demand, for a fast start of the command line."""
    import casadi as ca  # noqa: PLC0415

    return NumberSystem(
        sin_pi=lambda x: ca.sin(ca.pi * x),
        complex=ComplexExpr,
        number=lambda value: value,
        one_for_zero=lambda x: x + (x == 0),
    )


def abs2(z: Complex) -> Real:
    """Return |z|^2 without a square root, whose gradient is not a number at 0."""
    return z.real * z.real + z.imag * z.imag
