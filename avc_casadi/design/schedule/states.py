"""States of the schedule: logarithms of the gains, shifted so that a gain of 0 is admitted."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.model.problem import Problem
from avc_casadi.paper.equations import coupling_impedance
from avc_casadi.paper.loop import Loop
from avc_casadi.paper.rows import GainArrays

_FLOOR_SHARE = 1e-4
"""Floors of b and k as a share of the smallest gain that weighs as much as the environment."""
_AT_END = 1e-5
"""States nearer than this to an end of the box are set to it: an interior point method only approaches it."""


@dataclass(frozen=True)
class States:
    """The map between gains and states, sigma = ln(gain + floor), and the box of both.

    d = 3 states where the box admits contact damping, otherwise 2.

    Attributes:
        floors: b (N.s/m), k (N/m) and b_p (N.s/m) below which a gain counts as 0; shape (d,).
        least: lower ends of the gains, (d,).
        most: upper ends of the gains, (d,).
    """

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

    def gains(self, states: FloatArray) -> GainArrays:
        """Return (b, k, b_p) of states of shape (d, ...), inside the box to the last bit."""

        def spread(values: FloatArray) -> FloatArray:
            return values.reshape(-1, *([1] * (states.ndim - 1)))

        low, high, least, most = (spread(values) for values in (self.low, self.high, self.least, self.most))
        gains = np.clip(np.exp(states) - spread(self.floors), least, most)
        gains = np.where(states <= low + _AT_END, least, np.where(states >= high - _AT_END, most, gains))
        contact = gains[2] if len(gains) == 3 else np.zeros_like(gains[0])
        return gains[0], gains[1], contact

    def states(self, gains: GainArrays) -> FloatArray:
        """Return the states of (b, k, b_p), shape (d, ...), clipped to the box."""
        kept = np.array(gains[: len(self.floors)])
        shape = (-1, *([1] * (kept.ndim - 1)))
        states = np.log(kept + self.floors.reshape(shape))
        return np.clip(states, self.low.reshape(shape), self.high.reshape(shape))
