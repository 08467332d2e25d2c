"""Closed regions of gains and limits that hold without delay, or for every rendering."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi.loop import device_corners
from avc_casadi.support import FloatArray

if TYPE_CHECKING:
    from avc_casadi.passivity._sampled import (
        SampledLoop,
        Values,
    )
    from avc_casadi.problem import Device


def passive_limit_n_per_m(device: Device) -> float:
    """Return 2 b_d/((1 + d) T): no passive linear time-invariant rendering has a larger DC stiffness.

    Taken with the lowest damping and the longest delay of the device's ranges. Not a number for a fractional delay, an
    amplifier or a resonance, for which no such limit is known here. F(z) = b_d + z^-(1+d) Z(z) is positive real; the d
    coefficients of its expansion in 1/z after b_d vanish, so that of its measure, b_d in all, z = 1 carries b_d/(1 + d)
    at most, and that is half the residue K T.
    """
    if device.amplifier_bandwidth_hz is not None or device.resonance is not None:
        return float("nan")
    corners = device_corners(device, ("damping_ns_per_m", "delay_samples"))
    if any(corner.delay_samples != int(corner.delay_samples) for corner in corners):
        return float("nan")
    return min(2 * corner.damping_ns_per_m / ((1 + corner.delay_samples) * corner.sample_time_s) for corner in corners)


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
