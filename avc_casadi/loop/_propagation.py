"""Exact propagation of the linear plant between samples: the matrix exponential, for one hand or thousands at once."""

from __future__ import annotations

from collections.abc import Sequence
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
    return transitions([(plant, step_s)])[0]


def transitions(cases: Sequence[tuple[LinearPlant, float]]) -> list[Transition]:
    """Do the same for many plants of one shape, each with its step, in one go.

    Args:
        cases: plants and lengths of steps.
    """
    augmented, scales = (np.stack(parts) for parts in zip(*(_augmented(*case) for case in cases), strict=True))
    scale = scales.reshape(len(cases), *(1,) * (augmented.ndim - 3), -1)
    wholes = expm(augmented * scale[..., None] / scale[..., None, :]) / scale[..., None] * scale[..., None, :]
    n = wholes.shape[-1] - 3
    return [Transition(one[..., :n, :n], one[..., :n, n], one[..., :n, n + 1 :]) for one in wholes]


def _augmented(plant: LinearPlant, step_s: float) -> tuple[FloatArray, FloatArray]:
    """Return the matrix whose exponential is sought, shape (..., n + 3, n + 3), and the scale that balances it."""
    n = plant.states
    # The unit of force is chosen so that its column does not dominate the norm.
    unit = float(max(1.0, np.abs(plant.force).max() * step_s**2))
    augmented = np.zeros((*plant.matrix.shape[:-2], n + 3, n + 3))
    augmented[..., :n, :n] = plant.matrix * step_s
    augmented[..., :n, n] = plant.force * step_s
    augmented[..., :n, n + 1 :] = plant.target * step_s
    augmented[..., n + 1, n + 2] = step_s
    return augmented, np.concatenate([time_scale(plant, step_s), [unit, 1.0, step_s]])
