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


def time_scale(plant: LinearPlant, step_s: float | FloatArray) -> FloatArray:
    """Return the diagonal that counts rates by the step, velocities in metres a step, which balances A."""
    return np.where([name.endswith("_per_s") for name in plant.names], step_s, 1.0)


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
    steps_s = np.array([step_s for _, step_s in cases])
    augmented, scales = _augmented([plant for plant, _ in cases], steps_s)
    scale = scales.reshape(len(cases), *(1,) * (augmented.ndim - 3), -1)
    wholes = expm(augmented * scale[..., None] / scale[..., None, :]) / scale[..., None] * scale[..., None, :]
    n = wholes.shape[-1] - 3
    return [Transition(one[..., :n, :n], one[..., :n, n], one[..., :n, n + 1 :]) for one in wholes]


def _augmented(plants: Sequence[LinearPlant], steps_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return matrices whose exponentials are sought, shape (cases, ..., n + 3, n + 3), and scales that balance them.

    Args:
        plants: of one shape.
        steps_s: length of the step of each.
    """
    n = plants[0].states
    matrix, force, target = (
        np.stack([getattr(plant, name) for plant in plants]) for name in ("matrix", "force", "target")
    )
    step = steps_s.reshape(-1, *(1,) * (matrix.ndim - 3))
    augmented = np.zeros((*matrix.shape[:-2], n + 3, n + 3))
    augmented[..., :n, :n] = matrix * step[..., None, None]
    augmented[..., :n, n] = force * step[..., None]
    augmented[..., :n, n + 1 :] = target * step[..., None, None]
    augmented[..., n + 1, n + 2] = step
    scales = np.ones((len(plants), n + 3))
    scales[:, :n] = time_scale(plants[0], steps_s[:, None])
    # The unit of force is chosen so that its column does not dominate the norm.
    scales[:, n] = np.maximum(1.0, np.abs(force).reshape(len(plants), -1).max(axis=1) * steps_s**2)
    scales[:, n + 2] = steps_s
    return augmented, scales
