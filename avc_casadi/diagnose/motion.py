"""Motion of a device and its hand in ticks, under a force that is held and late."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import signal

from avc_casadi._util.arrays import FloatArray
from avc_casadi.diagnose.plant import Hypothesis
from avc_casadi.model.hands import released_hand
from avc_casadi.model.plant import sampled_plant


@dataclass(frozen=True, eq=False)
class SampledMotion:
    """x(n+1) = A x(n) + b_new F(n-d) + b_old F(n-d-1), position c x(n): device and hand in ticks, velocities a tick."""

    matrix: FloatArray
    """A, shape (s, s)."""
    new: FloatArray
    """b_new, shape (s,)."""
    old: FloatArray
    """b_old, shape (s,)."""
    output_row: FloatArray
    """c, shape (s,)."""
    characteristic: FloatArray
    """Characteristic polynomial of A, shape (s + 1,)."""
    whole_delay: int
    """d, ticks."""

    @classmethod
    def of(cls, hypothesis: Hypothesis, period_s: float) -> SampledMotion:
        """Return the motion of device and hand of a hypothesis over ticks of `period_s`, velocities in m a tick."""
        plant = sampled_plant(hypothesis.device, hypothesis.hand or released_hand())
        scale = np.array([period_s if name.endswith("_per_s") else 1.0 for name in plant.names])
        matrix = plant.matrix[0, 0] * scale[:, None] / scale
        return cls(
            matrix=matrix,
            new=plant.new[0, 0] * scale,
            old=plant.old[0, 0] * scale,
            output_row=plant.output_row,
            characteristic=np.asarray(np.poly(matrix)),
            whole_delay=int(plant.whole_delay[0]),
        )

    def response(self, entry: FloatArray, force: FloatArray) -> FloatArray:
        """Return the position under a force from rest, shape (n,), where b = `entry` is how it enters the state.

        sum over k of c A^(k-1) b F(n-k), as a filter whose denominator is the characteristic polynomial of A.
        """
        order = self.characteristic.size - 1
        markov, state = [0.0], entry.copy()
        for _ in range(order):
            markov.append(float(self.output_row @ state))
            state = self.matrix @ state
        numerator = np.convolve(self.characteristic, markov)[: order + 1]
        return np.asarray(signal.lfilter(numerator, self.characteristic, force, axis=0))

    def free(self, n: int) -> FloatArray:
        """Return the position c A^k of free motion from each state over n ticks, shape (n, s)."""
        free, power = self.output_row[None, :], self.matrix
        while len(free) < n:
            free, power = np.concatenate([free, free @ power]), power @ power
        return free[:n]
