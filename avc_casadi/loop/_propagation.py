"""Exact propagation of the linear plant between samples: the matrix exponential, for one hand or thousands at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from avc_casadi.loop._expm import expm
from avc_casadi.loop._plant import LinearPlant
from avc_casadi.support import FloatArray


@dataclass(frozen=True)
class Transition:
    """One step of length h: x(h) = Phi x(0) + gamma_F F + gamma_x x_h + gamma_v v_h.

    F is constant over the step and the target moves at constant velocity: x_h + v_h t.

    Attributes:
        matrix: Phi, shape (..., n, n).
        force: gamma_F, shape (..., n).
        target: gamma_x and gamma_v, shape (..., n, 2).
    """

    matrix: FloatArray
    force: FloatArray
    target: FloatArray


def time_scale(plant: LinearPlant, step_s: float) -> FloatArray:
    """Return the diagonal that counts rates by the step, velocities in metres a step, which balances A."""
    return np.array([step_s if name.endswith("_per_s") else 1.0 for name in plant.names])


def transition(plant: LinearPlant, step_s: float) -> Transition:
    """Discretise the plant exactly for a held force and a target at constant velocity.

    Args:
        plant: the linear plant.
        step_s: length of the step.
    """
    n = plant.states
    # The unit of force is chosen so that its column does not dominate the norm.
    unit = float(max(1.0, np.abs(plant.force).max() * step_s**2))
    scale = np.concatenate([time_scale(plant, step_s), [unit, 1.0, step_s]])
    augmented = np.zeros((*plant.matrix.shape[:-2], n + 3, n + 3))
    augmented[..., :n, :n] = plant.matrix * step_s
    augmented[..., :n, n] = plant.force * step_s
    augmented[..., :n, n + 1 :] = plant.target * step_s
    augmented[..., n + 1, n + 2] = step_s
    whole = expm(augmented * scale[:, None] / scale) / scale[:, None] * scale
    return Transition(whole[..., :n, :n], whole[..., :n, n], whole[..., :n, n + 1 :])
