"""Z_h of a sampled loop without delay: equations as in the paper, complex numbers as pairs, the problem's numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

from avc_casadi.model.problem import Problem

Pair = tuple[Any, Any]


def _times(x: Pair, y: Pair) -> Pair:
    return x[0] * y[0] - x[1] * y[1], x[0] * y[1] + x[1] * y[0]


def _series(x: Pair, y: Pair) -> Pair:
    total = x[0] + y[0], x[1] + y[1]
    scale = total[0] ** 2 + total[1] ** 2
    up = _times(_times(x, y), (total[0], -total[1]))
    return up[0] / scale, up[1] / scale


def perceived(problem: Problem, frequency_hz: float, damping: Any, stiffness: Any, wall: tuple[Any, Any]) -> Pair:
    """Z_h of a spring and damper in series with a wall, before the device; no coupling where damping is None."""
    t = problem.device.sample_time_s
    phi = np.pi * frequency_hz * t
    hold = np.cos(2 * phi), -np.sin(2 * phi)

    def joined(b: Any, k: Any) -> Pair:
        return b + k * t / 2, -k * t / 2 / np.tan(phi)

    rendered = joined(*wall) if damping is None else _series(joined(damping, stiffness), joined(*wall))
    felt = _times(hold, rendered)
    return problem.device.damping_ns_per_m + felt[0], 2 * problem.device.mass_kg / t * np.tan(phi) + felt[1]
