"""Circle arcs Z(t) = (a0 + a1 t)/(c0 + c1 t) with real t: every question about them is a real quadratic.

The series coupling is affine in its gains and a Moebius map follows, so that an edge of the gain box becomes an arc in
the impedance plane.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi.paper.equations import coupling_impedance
from avc_casadi.paper.loop import Loop
from avc_casadi.paper.numbers import abs2

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem


def real_roots(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Return the real roots of a t^2 + b t + c, shape (2, ...), not a number where there is none.

    The larger root comes from the sum that does not cancel, the smaller from the product of the roots.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        half = -0.5 * (b + np.copysign(np.sqrt(b * b - 4 * a * c), b))
        return np.stack((half / a, c / half))


@dataclass(frozen=True)
class Arcs:
    """A stack of arcs; every coefficient has a shape that broadcasts to (m, n) arcs."""

    a0: ComplexArray
    a1: ComplexArray
    c0: ComplexArray
    c1: ComplexArray
    # a1 c0 - a0 c1, free of cancellation: dZ/dt = turn/(c0 + c1 t)^2.
    turn: ComplexArray

    def _numerator(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        return abs2(self.a1), 2 * (self.a0.real * self.a1.real + self.a0.imag * self.a1.imag), abs2(self.a0)

    def _denominator(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        return abs2(self.c1), 2 * (self.c0.real * self.c1.real + self.c0.imag * self.c1.imag), abs2(self.c0)

    def magnitude_roots(self, magnitude: FloatArray) -> FloatArray:
        """Return t where |Z(t)| has a given value, shape (2, m, n)."""
        pairs = zip(self._numerator(), self._denominator(), strict=True)
        a, b, c = (top - magnitude * magnitude * bottom for top, bottom in pairs)
        return real_roots(a, b, c)

    def magnitude_extrema(self) -> FloatArray:
        """Return t where d|Z|^2/dt = 0, shape (2, m, n): Re{turn conj((a0 + a1 t)(c0 + c1 t))} = 0."""
        turn = np.conj(self.turn)
        return real_roots(
            (turn * self.a1 * self.c1).real,
            (turn * (self.a0 * self.c1 + self.a1 * self.c0)).real,
            (turn * self.a0 * self.c0).real,
        )

    def _projected(self, direction: complex) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the quadratic of Re(direction * numerator * conj(denominator))."""
        a0, a1 = direction * self.a0, direction * self.a1
        c0, c1 = self.c0, self.c1
        return (
            a1.real * c1.real + a1.imag * c1.imag,
            a0.real * c1.real + a0.imag * c1.imag + a1.real * c0.real + a1.imag * c0.imag,
            a0.real * c0.real + a0.imag * c0.imag,
        )

    def level_roots(self, level: FloatArray | float, *, imaginary: bool = False) -> FloatArray:
        """Return t where Re Z (or Im Z) has a given value, shape (2, m, n)."""
        pairs = zip(self._projected(-1j if imaginary else 1.0), self._denominator(), strict=True)
        a, b, c = (top - level * bottom for top, bottom in pairs)
        return real_roots(a, b, c)

    def level_extrema(self, *, imaginary: bool = False) -> FloatArray:
        """Return t where Re Z (or Im Z) is stationary, shape (2, m, n): Re{turn conj(c0 + c1 t)^2} = 0."""
        turn = np.conj(self.turn) * (1j if imaginary else 1.0)
        return real_roots(
            (turn * self.c1 * self.c1).real,
            2 * (turn * self.c0 * self.c1).real,
            (turn * self.c0 * self.c0).real,
        )


@dataclass(frozen=True)
class Edges:
    """The four edges of the (b, k) box at given contact dampings; arrays broadcast to (edges, n)."""

    loop: Loop
    base: ComplexArray
    slope: ComplexArray
    damping: FloatArray
    stiffness: FloatArray
    moves_k: NDArray[np.bool_]
    low: FloatArray
    high: FloatArray
    contact: FloatArray

    @classmethod
    def of(cls, problem: Problem, loop: Loop, contacts: tuple[float, ...]) -> Edges:
        """Return the edges of a problem's gain box at each contact damping, N.s/m."""
        (b0, b1), (k0, k1) = problem.coupling.damping_ns_per_m, problem.coupling.stiffness_n_per_m
        corners = [(b0, k0, True), (b1, k0, True), (b0, k0, False), (b0, k1, False)] * len(contacts)
        b, k, moves = (np.array(column)[:, None] for column in zip(*corners, strict=True))
        moves_k = moves.astype(bool)
        base = coupling_impedance(loop.angle, np.where(moves_k, b, 0.0), np.where(moves_k, 0.0, k))
        slope = np.where(moves_k, coupling_impedance(loop.angle, 0.0, 1.0), 1.0)
        low, high = np.where(moves_k, k0, b0), np.where(moves_k, k1, b1)
        return cls(loop, base, slope, b, k, moves_k, low, high, np.repeat(contacts, 4)[:, None])

    def rendered(self) -> Arcs:
        """Return Z_eavc along each edge."""
        environment = self.loop.environment
        return Arcs(
            environment * self.base,
            environment * self.slope,
            environment + self.base,
            self.slope,
            environment * environment * self.slope,
        )

    def perceived(self) -> Arcs:
        """Return Z_h_avc along each edge."""
        start = self.loop.device + self.loop.hold * self.contact
        inner = self.rendered()
        return Arcs(
            start * inner.c0 + self.loop.hold * inner.a0,
            start * inner.c1 + self.loop.hold * inner.a1,
            inner.c0,
            inner.c1,
            self.loop.hold * inner.turn,
        )

    def derivative(self, t: FloatArray) -> ComplexArray:
        """Return dZ/dt along each edge, without cancellation."""
        b, k = np.where(self.moves_k, self.damping, t), np.where(self.moves_k, t, self.stiffness)
        along: ComplexArray = self.loop.sensitivity(b, k) * self.slope
        return along

    def gains(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return (b, k, b_p) at t, not a number outside the edge."""
        t = np.where((t >= self.low) & (t <= self.high), t, np.nan)
        return (
            np.where(self.moves_k, self.damping, t),
            np.where(self.moves_k, t, self.stiffness),
            self.contact + 0 * t,
        )
