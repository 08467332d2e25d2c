"""What gains feel like: the perceived impedance, with the observer and feedback that stand before them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.loop import NUMPY, SampleAngle, environment_impedance, loop_at, perceived_impedance
from avc_casadi.stability import force_over_position, frozen_rendering

if TYPE_CHECKING:
    from avc_casadi.problem import Problem
    from avc_casadi.runtime import StateFeedback
    from avc_casadi.support import ComplexArray, FloatArray


def felt_impedance(
    problem: Problem,
    frequency_hz: FloatArray,
    gains: tuple[FloatArray, FloatArray, FloatArray],
    law: StateFeedback | None = None,
) -> ComplexArray:
    """Return Z_h_avc at each frequency, N.s/m, shape (n,).

    Args:
        problem: device, wall and model of the hold.
        frequency_hz: where, shape (n,).
        gains: b (N.s/m), k (N/m), b_p (N.s/m), each of shape (n,).
        law: observer and feedback before the gains, its dead zone passing all; None where the gains stand alone.
    """
    loop, (b, k, contact) = loop_at(problem, frequency_hz), gains
    if law is None:
        return np.asarray(loop.perceived(b, k, contact))
    t = problem.device.sample_time_s
    # The impedance of a spring of 1 N/m turns force over position into one over velocity, in the model of the problem.
    unit = environment_impedance(SampleAngle.at(NUMPY, frequency_hz, t), problem.stability.model, 0.0, 1.0)
    rows, same = np.unique(np.stack([b, k, contact], axis=1), axis=0, return_inverse=True)
    each = np.array([force_over_position(law, frozen_rendering(problem, *row), frequency_hz, t) for row in rows])
    force = each[same.ravel(), np.arange(len(frequency_hz))]
    return np.asarray(perceived_impedance(loop.device, loop.hold, force * unit))
