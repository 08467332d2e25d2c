"""Circle arcs Z(t) = (a0 + a1 t)/(c0 + c1 t) with real t: every question about them is a real quadratic.

The series coupling is affine in its gains and a Moebius map follows, so that an edge of the gain box becomes an arc in
the impedance plane.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from avc_casadi.loop import abs2
from avc_casadi.support import ComplexArray, FloatArray


def real_roots(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Return the real roots of a t^2 + b t + c, shape (2, ...), not a number where there is none.

    The larger root comes from the sum that does not cancel, the smaller from the product of the roots.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        half = -0.5 * (b + np.copysign(np.sqrt(b * b - 4 * a * c), b))
        return np.stack((half / a, c / half))


@dataclass(frozen=True)
class Arcs:
    """A stack of arcs; every coefficient has a shape that broadcasts to (m, n) arcs.

    Attributes:
        a0: numerator at t = 0.
        a1: slope of the numerator.
        c0: denominator at t = 0.
        c1: slope of the denominator.
        turn: a1 c0 - a0 c1, given by the caller, who knows it without cancellation; dZ/dt = turn/(c0 + c1 t)^2.
    """

    a0: ComplexArray
    a1: ComplexArray
    c0: ComplexArray
    c1: ComplexArray
    turn: ComplexArray

    def _numerator(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        return abs2(self.a1), 2 * (self.a0.real * self.a1.real + self.a0.imag * self.a1.imag), abs2(self.a0)

    def _denominator(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        return abs2(self.c1), 2 * (self.c0.real * self.c1.real + self.c0.imag * self.c1.imag), abs2(self.c0)

    def magnitude_roots(self, magnitude: FloatArray) -> FloatArray:
        """Where |Z(t)| has a given value, shape (2, m, n)."""
        pairs = zip(self._numerator(), self._denominator(), strict=True)
        a, b, c = (top - magnitude * magnitude * bottom for top, bottom in pairs)
        return real_roots(a, b, c)

    def magnitude_extrema(self) -> FloatArray:
        """Where d|Z|^2/dt = 0, shape (2, m, n): Re{turn conj((a0 + a1 t)(c0 + c1 t))} = 0."""
        turn = np.conj(self.turn)
        return real_roots(
            (turn * self.a1 * self.c1).real,
            (turn * (self.a0 * self.c1 + self.a1 * self.c0)).real,
            (turn * self.a0 * self.c0).real,
        )

    def _projected(self, direction: complex) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Quadratic of Re(direction * numerator * conj(denominator))."""
        a0, a1 = direction * self.a0, direction * self.a1
        c0, c1 = self.c0, self.c1
        return (
            a1.real * c1.real + a1.imag * c1.imag,
            a0.real * c1.real + a0.imag * c1.imag + a1.real * c0.real + a1.imag * c0.imag,
            a0.real * c0.real + a0.imag * c0.imag,
        )

    def level_roots(self, level: FloatArray | float, *, imaginary: bool = False) -> FloatArray:
        """Where Re Z (or Im Z) has a given value, shape (2, m, n)."""
        pairs = zip(self._projected(-1j if imaginary else 1.0), self._denominator(), strict=True)
        a, b, c = (top - level * bottom for top, bottom in pairs)
        return real_roots(a, b, c)

    def level_extrema(self, *, imaginary: bool = False) -> FloatArray:
        """Where Re Z (or Im Z) is stationary, shape (2, m, n): Re{turn conj(c0 + c1 t)^2} = 0."""
        turn = np.conj(self.turn) * (1j if imaginary else 1.0)
        return real_roots(
            (turn * self.c1 * self.c1).real,
            2 * (turn * self.c0 * self.c1).real,
            (turn * self.c0 * self.c0).real,
        )
