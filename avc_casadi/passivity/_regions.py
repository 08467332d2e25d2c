"""Closed regions of gains and limits that hold without delay, or for every rendering."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi.support import FloatArray

if TYPE_CHECKING:
    from avc_casadi.passivity._sampled import (
        SampledLoop,
        Values,
    )


def passive_limit_n_per_m(device_damping_ns_per_m: float, sample_time_s: float, delay_samples: float = 0) -> float:
    """Return 2 b_d/((1 + d) T): no passive linear time-invariant rendering has a larger DC stiffness.

    Not a number for a fractional delay, for which no such limit is known here.
    """
    if delay_samples != int(delay_samples):
        return float("nan")
    return 2 * device_damping_ns_per_m / ((1 + delay_samples) * sample_time_s)


def largest_lead_for_all_frequencies(
    loop: SampledLoop, contact_damping_ns_per_m: Values = 0.0, margin_ns_per_m: float = 0.0
) -> FloatArray:
    """Bound on b + kT/2, necessary and sufficient for Re Z_h >= margin at all frequencies.

    Sampled-data without delay. Re Z_h is lowest at Nyquist: b_d - b_p - a_1 a_2/(a_1 + a_2), a_1 = b + kT/2, a_2 = b_e
    + k_e T/2.

    Returns:
        The bound, N.s/m: infinite where any passive coupling will do, negative where none does.

    Raises:
        UnsupportedError: the paper's hold, or delay: use `worst_margin`.
    """
    if loop.model != "sampled-data" or loop.delay_samples:
        raise UnsupportedError(
            f"the closed region needs the sampled-data model without delay, not {loop.model} with "
            f"{loop.delay_samples} samples of delay: use worst_margin"
        )
    budget = np.asarray(loop.device_damping_ns_per_m, dtype=np.float64) - contact_damping_ns_per_m - margin_ns_per_m
    wall = np.asarray(
        loop.environment_damping_ns_per_m + np.multiply(loop.environment_stiffness_n_per_m, loop.sample_time_s / 2)
    )
    enough = budget >= wall
    bound = wall * budget / np.where(enough, 1.0, wall - budget)
    return np.asarray(np.where(enough, np.inf, np.where(budget < 0, -1.0, bound)))
