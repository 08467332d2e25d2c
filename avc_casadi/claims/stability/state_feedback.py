"""The loop in contact with an observer and state feedback, for sector gains of the dead zone.

Quantiser and dead zone together are a gain between 0 and 1 on the innovation. The loop is analysed with that sector
gain constant: damping for every gain is necessary, not sufficient, for a loop without limit cycles between two encoder
steps.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.arrays import ComplexArray, FloatArray, IndexArray
from avc_casadi.loops.spectrum import eigenvalues

if TYPE_CHECKING:
    from avc_casadi.claims.stability.frozen_loop import Rendering
    from avc_casadi.model.runtime import StateFeedback


@dataclass(frozen=True)
class Laws:
    """Laws of one structure, as arrays.

    Attributes:
        state: A, shape (laws, n, n).
        force_m_per_n: B, shape (laws, n).
        innovation: L, shape (laws, n).
        feedback: R, shape (laws, n).
        measures: index of the estimated measured position.
        positions: indices of the positions.
    """

    state: FloatArray
    force_m_per_n: FloatArray
    innovation: FloatArray
    feedback: FloatArray
    measures: int
    positions: tuple[int, ...]

    @classmethod
    def of(cls, law: StateFeedback) -> Laws:
        """Return one law as arrays."""
        state, asked, gain, weight = (
            np.array(part)[None] for part in (law.state, law.force_m_per_n, law.innovation, law.feedback)
        )
        return cls(state, asked, gain, weight, law.measures, law.positions)

    def __len__(self) -> int:
        return len(self.state)

    def pick(self, rows: IndexArray) -> Laws:
        """Return some of the laws."""
        state, asked, gain, weight = (
            part[rows] for part in (self.state, self.force_m_per_n, self.innovation, self.feedback)
        )
        return Laws(state, asked, gain, weight, self.measures, self.positions)


def state_feedback_loop(
    plants: tuple[FloatArray, FloatArray, FloatArray],
    law: StateFeedback,
    rendering: Rendering,
    shares: FloatArray | tuple[float, ...] = (1.0,),
) -> FloatArray:
    """Close the loop of p plants.

    Args:
        plants: A (p, s, s), B (p, s) and the measured row (s,), of `plants_with_forces`.
        law: observer and feedback with n states.
        rendering: one frozen rendering, of the position that the law gives.
        shares: sector gains of the dead zone, shape (a,); 1 is the loop without dead zone.

    Returns:
        Shape (a, p, s + n + 2, s + n + 2); two less where the rendering is a spring alone. States: those of the plant,
        of the observer, the previous rendered position, the rendering's own.
    """
    return np.asarray(state_feedback_loops(plants, Laws.of(law), rendering, shares)[0])


def state_feedback_loops(
    plants: tuple[FloatArray, FloatArray, FloatArray],
    laws: Laws,
    rendering: Rendering,
    shares: FloatArray | tuple[float, ...] = (1.0,),
) -> FloatArray:
    """Close the loops of many laws, shape (laws, a, p, s + n + 2, s + n + 2)."""
    matrix, push, measured = plants
    now, before, own = rendering.force[0]
    remembers = bool(before or own)
    s, n = len(measured), laws.state.shape[-1]
    size = s + n + 2 * remembers
    plant, observer = slice(0, s), slice(s, s + n)
    passed = np.asarray(shares)[:, None] * laws.innovation[:, None]
    kept = np.empty((*passed.shape[:2], n, n))
    kept[:] = np.eye(n)
    kept[..., laws.measures] -= passed
    # Rows over (plant, observer): the corrected states, the rendered position, the force.
    weight, state = laws.feedback[:, None, None, :], laws.state[:, None]
    seen = np.zeros((*passed.shape[:2], size))
    seen[..., plant] = (weight @ passed[..., None])[..., 0] * measured
    seen[..., observer] = (weight @ kept)[..., 0, :]
    force = now * seen
    if remembers:
        force[..., -2:] = before, own
    loop = np.zeros((*passed.shape[:2], len(matrix), size, size))
    loop[..., plant, plant] = matrix
    loop[..., plant, :] += push[:, :, None] * force[:, :, None, None, :]
    loop[..., observer, plant] += ((state @ passed[..., None]) * measured)[:, :, None]
    loop[..., observer, observer] += (state @ kept)[:, :, None]
    loop[..., observer, :] += (laws.force_m_per_n[:, None, :, None] * force[..., None, :])[:, :, None]
    if remembers:
        loop[..., -2, :] = seen[:, :, None]
        loop[..., -1, :] = (rendering.state[0, 0] * seen)[:, :, None]
        loop[..., -1, -2:] += rendering.state[0, 1:]
    return loop


def poles(loop: FloatArray) -> ComplexArray:
    """Return the eigenvalues of each loop, shape (..., s)."""
    return eigenvalues(loop)


def largest_radius(loop: FloatArray) -> FloatArray:
    """Return the spectral radius of each loop, shape (...) for loops (..., s, s)."""
    return np.asarray(np.abs(poles(loop)).max(axis=-1))


def force_over_innovation(
    laws: Laws, rendering: Rendering, frequency_hz: FloatArray, sample_time_s: float
) -> tuple[ComplexArray, ComplexArray]:
    """Return force and estimated position over the innovation at each frequency, without dead zone.

    Returns:
        F/e and s_m/e, each of shape (laws, f): F/x is F/e over 1 + s_m/e.
    """
    z = np.exp(2j * np.pi * frequency_hz * sample_time_s)
    wall = force_over_position(rendering, z)
    gain = laws.innovation[:, None, :]
    closed = (
        laws.state[:, None] + wall[:, None, None] * (laws.force_m_per_n[:, :, None] * laws.feedback[:, None])[:, None]
    )
    pencil = z[:, None, None] * np.eye(laws.state.shape[-1]) - closed
    believed = np.linalg.solve(pencil, closed @ gain[..., None])[..., 0]
    # One product for each law: a single product rounds differently where there is one frequency.
    force = [wall * (states @ weight) for states, weight in zip(believed + gain, laws.feedback, strict=True)]
    return np.reshape(force, believed.shape[:2]), np.asarray(believed[..., laws.measures])


def stiffness_at_rest(rendering: Rendering) -> float:
    """Return the stiffness of a rendering at rest."""
    return float(force_over_position(rendering, np.ones(1, dtype=np.complex128))[0].real)


def force_over_position(rendering: Rendering, z: ComplexArray) -> ComplexArray:
    """Return the force of one rendering over its input position, N/m.

    Args:
        rendering: a single one.
        z: points, of any shape.
    """
    now, before, own = rendering.force[0]
    state = rendering.state[0]
    inner = (state[0] + state[1] / z) / (z - state[2]) if own else 0.0
    return np.asarray(now + before / z + own * inner)
