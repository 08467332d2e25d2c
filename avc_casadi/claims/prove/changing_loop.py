"""The loop in kept contact whose row of gains changes from sample to sample, with all hands of a cell at once.

The state is that of `stability.joint_rendering`: position, velocity by the sample, the position before, the joint
between coupling and wall, forces under way. It means the same with every row. Mechanics G, shape (2, 3), is all that
depends on the hand: with beta = B T/M, kappa = k T^2/M and phi, psi of `oscillator`,

    G = [[1 - kappa psi, phi, psi T^2/M], [-kappa phi, 1 - beta phi - kappa psi, phi T^2/M]],
    A(row) = base(row) + [G; 0] select(row).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.claims.prove.interval import Interval, Jet
from avc_casadi.claims.prove.oscillator import oscillator
from avc_casadi.claims.stability.frozen_loop import joint_rendering

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem

LIGHTNESS, DAMPING, STIFFNESS = range(3)
"""Rows of a cell: 1 over all mass that moves, 1/kg, in which the loop is almost linear; all damping, N.s/m; stiffness
of the hand, N/m."""


@dataclass(frozen=True)
class ChangingLoop:
    """Loops of some rows of gains; s states.

    Attributes:
        sample_time_s: T.
        base: what no hand changes, shape (rows, s, s).
        select: what mechanics acts on: position, velocity, force; shape (rows, 3, s).
    """

    sample_time_s: float
    base: FloatArray
    select: FloatArray

    @classmethod
    def of(cls, problem: Problem, gains: FloatArray) -> ChangingLoop:
        """Take rows of gains b, k and b_p, shape (3, rows); a whole number of samples of delay.

        Forces under way are counted in the distance that they move the lightest mass in a sample.
        """
        t = problem.device.sample_time_s
        rendering = joint_rendering(problem, *gains)
        late = int(problem.device.delay_samples)
        rows, size = gains.shape[1], 4 + late
        unit = t**2 / (problem.device.mass_kg + problem.hands.mass_kg[0])
        base, select = np.zeros((rows, size, size)), np.zeros((rows, 3, size))
        base[:, 2, 0] = 1.0
        base[:, 3, [0, 2, 3]] = rendering.state
        select[:, 0, 0] = select[:, 1, 1] = 1.0
        if late:
            base[:, 4, [0, 2, 3]] = rendering.force * unit
            base[:, np.arange(5, size), np.arange(4, size - 1)] = 1.0
            select[:, 2, -1] = -1.0 / unit
        else:
            select[:, 2, [0, 2, 3]] = -rendering.force
        return cls(t, base, select)

    @property
    def rows(self) -> int:
        """Number of rows of gains."""
        return len(self.base)

    def matrices(self, mechanics: FloatArray) -> FloatArray:
        """Return A of every row with mechanics G of shape (n, 2, 3): shape (n, rows, s, s)."""
        found = np.repeat(self.base[None], len(mechanics), axis=0)
        found[:, :, :2] += mechanics[:, None] @ self.select
        return found

    def at(self, points: FloatArray) -> FloatArray:
        """Return A of every row at points of shape (3, n): shape (n, rows, s, s)."""
        return self.matrices(_stacked(self._mechanics(Interval.of(points)))[0].middle)

    def over(self, cells: Interval) -> tuple[FloatArray, Interval]:
        """Return A of every row at the middles of n cells, and enclosed slopes of G there.

        Args:
            cells: shape (3, n).

        Returns:
            Shape (n, rows, s, s), and (3, n, 2, 3): along 1/mass, damping and stiffness.
        """
        _, slopes = _stacked(self._mechanics(cells))
        return self.at(cells.middle), slopes

    def _mechanics(self, cells: Interval) -> list[list[Jet[Interval]]]:
        t, count = self.sample_time_s, cells.shape[1]
        unit = [Interval.of(np.eye(3)[:, row : row + 1] * np.ones(count)) for row in range(3)]
        per_mass = Jet(cells[LIGHTNESS], unit[LIGHTNESS])
        beta = Jet(cells[DAMPING], unit[DAMPING]) * per_mass.times(t)
        push = per_mass.times(Interval.of(t).square())
        kappa = Jet(cells[STIFFNESS], unit[STIFFNESS]) * push
        phi, psi = (
            Jet(one.value, one.slope[0] * beta.slope + one.slope[1] * kappa.slope)
            for one in oscillator(beta.value, kappa.value)
        )
        left = (-(kappa * psi)).plus(1.0)
        return [[left, phi, psi * push], [-(kappa * phi), left - beta * phi, phi * push]]


def _stacked(entries: list[list[Jet[Interval]]]) -> tuple[Interval, Interval]:
    """Return values, shape (n, 2, 3), and slopes, shape (3, n, 2, 3)."""

    def joined(parts: list[list[FloatArray]]) -> FloatArray:
        return np.stack([np.stack(row, axis=-1) for row in parts], axis=-2)

    return (
        Interval(
            joined([[one.value.low for one in row] for row in entries]),
            joined([[one.value.high for one in row] for row in entries]),
        ),
        Interval(
            joined([[one.slope.low for one in row] for row in entries]),
            joined([[one.slope.high for one in row] for row in entries]),
        ),
    )
