"""The energy ledger: what the virtual side takes in through the held force, and what its springs hold.

The held force F of a sample is paired with the displacement until the next one, F(k) (x(k+1) - x(k)): that is the
energy which really passes, whatever happens between two samples. Pairing it with the displacement before it would
hide the K dx^2/2 that every step of a held spring creates.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from avc_casadi.scene.loop import Environment
from avc_casadi.support import Comparable, FloatArray


@dataclass(frozen=True, eq=False)
class Ledger(Comparable):
    """Energies at the samples, each of shape (..., samples), J.

    Attributes:
        absorbed_j: energy that the virtual side has taken in since the beginning; below 0 it has given out energy that
            it never had, and is not passive.
        stored_j: energy in the springs of coupling and environment, as far as it can reach the hand.
    """

    absorbed_j: FloatArray
    stored_j: FloatArray

    @property
    def dissipated_j(self) -> FloatArray:
        """What was taken in and is not stored; where it falls, sampling, delay or quantisation create energy."""
        return self.absorbed_j - (self.stored_j - self.stored_j[..., :1])

    @property
    def generated_j(self) -> FloatArray:
        """Largest energy given out beyond all that was taken in, shape (...)."""
        generated: FloatArray = 0.0 - np.minimum(0.0, self.absorbed_j.min(axis=-1))
        return generated


def energy_ledger(
    position_m: FloatArray,
    force_n: FloatArray,
    tool_m: FloatArray,
    stiffness_n_per_m: ArrayLike,
    environment: Environment | None,
    anchor_m: ArrayLike = 0.0,
    potential_j: ArrayLike = 0.0,
) -> Ledger:
    """Draw up the ledger from the traces.

    Args:
        position_m: true position of the device, shape (..., samples).
        force_n: held force, positive against +x.
        tool_m: position of the virtual tool.
        stiffness_n_per_m: k, one number or one a sample; infinite for a rigid coupling, which stores nothing.
        environment: the environment, or None in free space.
        anchor_m: deflection at which the spring of the coupling is slack.
        potential_j: energy that detents hold, one a sample; what they hold at the beginning counts as taken in.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        work = force_n[..., :-1] * np.diff(position_m, axis=-1)
        absorbed = np.concatenate([np.zeros((*work.shape[:-1], 1)), np.cumsum(work, axis=-1)], axis=-1)
        stored = np.zeros_like(absorbed)
        if environment is not None:
            one_sided = environment.one_sided
            depth = np.maximum(tool_m, 0.0) if one_sided else tool_m
            stored += environment.stiffness_n_per_m * depth**2 / 2
            stiffness = np.asarray(stiffness_n_per_m, np.float64)
            deflection = position_m - tool_m
            # Out of contact the clip-last law stretches its coupling without a force: nobody gets that energy.
            deflection = environment.by_law(np.maximum(deflection, 0.0), deflection) if one_sided else deflection
            stretch = np.where(np.isinf(stiffness), 0.0, deflection - np.asarray(anchor_m, np.float64))
            stored += np.where(np.isinf(stiffness), 0.0, stiffness) * stretch**2 / 2
        held = np.broadcast_to(np.asarray(potential_j, np.float64), absorbed.shape)
    return Ledger(absorbed + held[..., :1], stored + held)
