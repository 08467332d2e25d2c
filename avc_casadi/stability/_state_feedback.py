"""The loop in contact with an observer and state feedback, where a share of the innovation passes the dead zone.

Quantiser and dead zone together are a gain between 0 and 1 on the innovation. The loop is looked at with that gain
held: damped for every share is what a loop without buzz between two encoder steps must be, and no proof that it is.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.support import ComplexArray, FloatArray

if TYPE_CHECKING:
    from avc_casadi.runtime import StateFeedback
    from avc_casadi.stability._transition import Rendering


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
        rendering: one frozen rendering; what it sees is the position that the law gives.
        shares: of the innovation that pass, shape (a,); 1 is the loop without dead zone.

    Returns:
        Shape (a, p, s + n + 2, s + n + 2); two less where the rendering is a spring alone. States: those of the plant,
        of the observer, the position seen before, the rendering's own.
    """
    matrix, push, measured = plants
    state, asked, gain, weight = (
        np.array(part) for part in (law.state, law.force_m_per_n, law.innovation, law.feedback)
    )
    now, before, own = rendering.force[0]
    remembers = bool(before or own)
    s, n = len(measured), law.states
    size = s + n + 2 * remembers
    loop = np.zeros((len(shares), len(matrix), size, size))
    loop[:, :, :s, :s] = matrix
    plant, observer = slice(0, s), slice(s, s + n)
    for index, share in enumerate(shares):
        passed = share * gain
        kept = np.eye(n)
        kept[:, law.measures] -= passed
        # Rows over (plant, observer): the corrected states, the position that is seen, the force.
        seen = np.zeros(size)
        seen[plant], seen[observer] = (weight @ passed) * measured, weight @ kept
        force = now * seen
        if remembers:
            force[-2:] = before, own
        part = loop[index]
        part[:, plant, :] += push[:, :, None] * force
        part[:, observer, plant] += np.outer(state @ passed, measured)
        part[:, observer, observer] += state @ kept
        part[:, observer, :] += np.outer(asked, force)
        if remembers:
            part[:, -2] = seen
            part[:, -1] = rendering.state[0, 0] * seen
            part[:, -1, -2:] += rendering.state[0, 1:]
    return loop


def largest_radius(loop: FloatArray) -> FloatArray:
    """Return the spectral radius of each loop, shape (a, p)."""
    return np.asarray(np.abs(np.linalg.eigvals(loop)).max(axis=-1))


def force_over_innovation(
    law: StateFeedback, rendering: Rendering, frequency_hz: FloatArray, sample_time_s: float
) -> tuple[ComplexArray, ComplexArray]:
    """Return force and believed position over the innovation at each frequency, the dead zone passing all.

    Returns:
        F/e and s_m/e, each of shape (f,): F/x is F/e over 1 + s_m/e.
    """
    state, asked, gain, weight = (
        np.array(part) for part in (law.state, law.force_m_per_n, law.innovation, law.feedback)
    )
    z = np.exp(2j * np.pi * frequency_hz * sample_time_s)
    wall = _rendered(rendering, z)
    n = law.states
    closed = state + wall[:, None, None] * np.outer(asked, weight)
    pencil = z[:, None, None] * np.eye(n) - closed
    believed = np.linalg.solve(pencil, closed @ gain[:, None])[..., 0]
    return wall * ((believed + gain) @ weight), believed[:, law.measures]


def force_over_position(
    law: StateFeedback, rendering: Rendering, frequency_hz: FloatArray, sample_time_s: float
) -> ComplexArray:
    """Return force over the measured position at each frequency, N/m, shape (f,), the dead zone passing all."""
    force, believed = force_over_innovation(law, rendering, frequency_hz, sample_time_s)
    return np.asarray(force / (1 + believed))


def stiffness_at_rest(rendering: Rendering) -> float:
    """Return the stiffness of a rendering at rest."""
    return float(_rendered(rendering, np.ones(1, dtype=np.complex128))[0].real)


def _rendered(rendering: Rendering, z: ComplexArray) -> ComplexArray:
    """Return force over the position that is seen."""
    now, before, own = rendering.force[0]
    state = rendering.state[0]
    inner = (state[0] + state[1] / z) / (z - state[2]) if own else 0.0
    return np.asarray(now + before / z + own * inner)
