"""Where gains lie in the K-B plane: the wall that each row renders at its own frequency."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.loop import coupling_gains, loop_at
from avc_casadi.support import FloatArray

if TYPE_CHECKING:
    from avc_casadi.coupling import GainSchedule
    from avc_casadi.problem import Problem


def rendered_wall(problem: Problem, gains: GainSchedule) -> tuple[FloatArray, FloatArray]:
    """Return (B, K) of the spring and damper that each row amounts to at its own frequency, shape (n,) each.

    Contact damping counts as damping of the wall. The loop is the one that runs (sampled-data), whatever model the
    gains were designed for. Rows without gains are not numbers.
    """
    loop = loop_at(problem.changed(stability={"model": "sampled-data"}), gains.frequency_hz)
    usable = gains.usable
    b, k, contact = (
        np.where(usable, gain, 1.0)
        for gain in (gains.damping_ns_per_m, gains.stiffness_n_per_m, gains.contact_damping_ns_per_m)
    )
    wall = coupling_gains(loop.angle, loop.rendered(b, k) + contact)
    return np.where(usable, wall[0], np.nan), np.where(usable, wall[1], np.nan)
