"""States of the schedule: logarithms of the gains, shifted so that a gain of 0 is admitted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.model.problem import Problem
from avc_casadi.paper.equations import Loop, coupling_impedance
from avc_casadi.paper.rows import GainArrays

_FLOOR_SHARE = 1e-4
"""Floors of b and k as a share of the smallest gain that weighs as much as the environment."""
_AT_END = 1e-5
"""States nearer than this to an end of the box are set to it: an interior point method only approaches it."""


@dataclass(frozen=True)
class States:
    """The map between gains and states, sigma = ln(gain + floor), and the box of both."""

    floors: FloatArray
    least: FloatArray
    most: FloatArray

    @classmethod
    def of(cls, problem: Problem, loop: Loop) -> States:
        """Return the map with floors for a problem at the frequencies of ``loop``."""
        weight = np.abs(loop.environment)
        weight = np.where(weight > 0, weight, max(problem.device.damping_ns_per_m, 1.0))
        b = _FLOOR_SHARE * float(weight.min())
        k = _FLOOR_SHARE * float((weight / np.abs(coupling_impedance(loop.angle, 0.0, 1.0))).min())
        floors, box = [b, k], problem.coupling
        ends = [box.damping_ns_per_m, box.stiffness_n_per_m]
        if box.contact_damping_ns_per_m[1] > 0:
            floors.append(max(problem.device.damping_ns_per_m, 10 * b))
            ends.append(box.contact_damping_ns_per_m)
        least, most = np.array(ends).T
        return cls(np.array(floors), least, most)

    @property
    def low(self) -> FloatArray:
        """Lower ends of the states, (d,)."""
        return np.asarray(np.log(self.least + self.floors))

    @property
    def high(self) -> FloatArray:
        """Upper ends of the states, (d,)."""
        return np.asarray(np.log(self.most + self.floors))

    def within(self, low: FloatArray, high: FloatArray) -> States:
        """Return the states of a part of the box, between states of shape (d,) clipped to the box."""
        least = np.where(low > self.low, np.exp(low) - self.floors, self.least)
        most = np.where(high < self.high, np.exp(high) - self.floors, self.most)
        return replace(self, least=np.clip(least, self.least, self.most), most=np.clip(most, self.least, self.most))

    def lattice(self, points: Mapping[int, tuple[int, ...]]) -> tuple[list[FloatArray], FloatArray]:
        """Return the axes of a lattice over the box and its nodes, (d, m): so many along each state."""
        ends = zip(self.low, self.high, points[len(self.floors)], strict=True)
        axes = [np.linspace(low, high, count if high > low else 1) for low, high, count in ends]
        return axes, np.array([grid.ravel() for grid in np.meshgrid(*axes, indexing="ij")])

    def gains(self, states: FloatArray) -> GainArrays:
        """Return (b, k, b_p) of states of shape (d, ...), inside the box to the last bit."""
        last = states.T
        inside = np.clip(np.exp(last) - self.floors, self.least, self.most)
        low, high = last <= self.low + _AT_END, last >= self.high - _AT_END
        gains = np.where(low, self.least, np.where(high, self.most, inside)).T
        return gains[0], gains[1], gains[2] if len(gains) == 3 else np.zeros_like(gains[0])

    def states(self, gains: GainArrays) -> FloatArray:
        """Return the states of (b, k, b_p), shape (d, ...), clipped to the box."""
        kept = np.array(gains[: len(self.floors)]).T
        return np.asarray(np.clip(np.log(kept + self.floors), self.low, self.high).T)
