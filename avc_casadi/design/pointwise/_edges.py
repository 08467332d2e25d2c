"""The edges of the gain box, each of which the coupling maps to a circle arc in the impedance plane."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from avc_casadi.design.pointwise._arcs import Arcs
from avc_casadi.loop import Loop, coupling_impedance
from avc_casadi.support import ComplexArray, FloatArray

if TYPE_CHECKING:
    from avc_casadi.problem import Problem


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
        (b0, b1), (k0, k1) = problem.coupling.damping_ns_per_m, problem.coupling.stiffness_n_per_m
        corners = [(b0, k0, True), (b1, k0, True), (b0, k0, False), (b0, k1, False)] * len(contacts)
        b, k, moves = (np.array(column)[:, None] for column in zip(*corners, strict=True))
        moves_k = moves.astype(bool)
        base = coupling_impedance(loop.angle, np.where(moves_k, b, 0.0), np.where(moves_k, 0.0, k))
        slope = np.where(moves_k, coupling_impedance(loop.angle, 0.0, 1.0), 1.0)
        low, high = np.where(moves_k, k0, b0), np.where(moves_k, k1, b1)
        return cls(loop, base, slope, b, k, moves_k, low, high, np.repeat(contacts, 4)[:, None])

    def rendered(self) -> Arcs:
        """Z_eavc along each edge."""
        environment = self.loop.environment
        return Arcs(
            environment * self.base,
            environment * self.slope,
            environment + self.base,
            self.slope,
            environment * environment * self.slope,
        )

    def perceived(self) -> Arcs:
        """Z_h_avc along each edge."""
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
        """dZ/dt along each edge, without cancellation."""
        b, k = np.where(self.moves_k, self.damping, t), np.where(self.moves_k, t, self.stiffness)
        along: ComplexArray = self.loop.sensitivity(b, k) * self.slope
        return along

    def gains(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(b, k, b_p) at t, not a number outside the edge."""
        t = np.where((t >= self.low) & (t <= self.high), t, np.nan)
        return (
            np.where(self.moves_k, self.damping, t),
            np.where(self.moves_k, t, self.stiffness),
            self.contact + 0 * t,
        )
