"""Why a frequency has no gains: the violated constraint, by how much, and the smallest relaxation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.model.corners import least_damped
from avc_casadi.model.gains import Status
from avc_casadi.paper.arcs import Edges
from avc_casadi.paper.loop import loop_at

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem


def row_reasons(problem: Problem, status: tuple[Status, ...]) -> tuple[str, ...]:
    """Return for each infeasible row the violated constraint, by how much, and the smallest relaxation."""
    rows = [row for row, item in enumerate(status) if item is Status.INFEASIBLE]
    reasons = [""] * len(status)
    if rows:
        margin = problem.stability.margin_ns_per_m
        # Reported for the least damped device of the range, which is critical.
        best, b, k, _ = largest_real_part(least_damped(problem), problem.frequencies_hz()[rows])
        for row, value, damping, stiffness in zip(rows, best, b, k, strict=True):
            at = f"{value:.6g}, at b = {damping:.6g}, k = {stiffness:.6g}"
            claim = f"Re Z_h >= {margin:g} (stability.margin_ns_per_m)"
            if value >= margin:
                reasons[row] = (
                    f"{claim} is met in the gain box with no room: {at}; missed by no more than rounding: add device"
                    " damping, or widen the box of [coupling]"
                )
                continue
            missing = _rounded_up(margin - value)
            # A margin cannot be lowered below 0.
            lower = "lower the margin by that, " if margin >= missing else ""
            reasons[row] = (
                f"{claim} cannot be met in the gain box: at most {at}; missed by {missing:.6g}: {lower}add "
                "as much device damping, or widen the box of [coupling]"
            )
    return tuple(reasons)


def _rounded_up(value: float) -> float:
    """Round to six digits, upwards, so that the relaxation shown suffices."""
    step = 10.0 ** (np.floor(np.log10(value)) - 5)
    return float(np.ceil(value / step) * step) if step > 0 else value


def largest_real_part(
    problem: Problem, frequency_hz: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return (max Re Z_h over the gain box, b, k, b_p), each (n,).

    Re Z_h is harmonic in the coupling's impedance, so that its maximum lies on an edge of the box: at an end of it or
    where it is stationary.
    """
    loop = loop_at(problem, frequency_hz)
    edges = Edges.of(problem, loop, problem.coupling.contact_damping_ns_per_m)
    stationary = edges.perceived().level_extrema()
    ends = np.broadcast_to(np.stack((edges.low, edges.high)), stationary.shape)
    t = np.concatenate((stationary, ends))
    b, k, p = (gain.reshape(-1, t.shape[-1]) for gain in edges.gains(t))
    value = loop.perceived(b, k, p).real
    best = np.nanargmax(value, axis=0), np.arange(value.shape[1])
    return value[best], b[best], k[best], p[best]
