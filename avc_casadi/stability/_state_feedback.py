"""The loop in contact with an observer and state feedback, where a share of the innovation passes the dead zone.

Quantiser and dead zone together are a gain between 0 and 1 on the innovation. The loop is looked at with that gain
held: damped for every share is what a loop without buzz between two encoder steps must be, and no proof that it is.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.support import FloatArray

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
