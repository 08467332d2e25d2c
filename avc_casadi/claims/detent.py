"""Stability on the slopes of detents: a spring in the valleys, a negative one at the tops."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.loops.walls import damping_range, loop_poles, stiffest_wall
from avc_casadi.model.corners import LINEAR_KEYS, device_corners
from avc_casadi.model.hands import hand_set, joined, no_hand

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem

_DRAWS = 24
# A pole so far from the real axis oscillates.
_OSCILLATES = 1e-6


def detent_verdict(problem: Problem) -> tuple[bool, str, str, float]:
    """Judge the linear loops at the steepest slopes of the detents, of both signs, with every hand and released."""
    detent = problem.detent
    if detent is None:
        raise ValueError("the problem has no detents")
    slope, damping = detent.slope_n_per_m, detent.damping_ns_per_m
    people = joined(hand_set(problem.hands, draws=_DRAWS), no_hand())
    valley, top = (loop_poles(problem.device, people, sign * slope, damping) for sign in (1.0, -1.0))
    radius = float(np.abs(valley).max())
    leaving = top[np.abs(top) >= 1]
    swings = bool((np.abs(leaving.imag) > _OSCILLATES).any())
    if radius < 1 and not swings:
        corners = len(device_corners(problem.device, LINEAR_KEYS))
        held = int((np.abs(top).max(axis=-1).reshape(corners, -1).max(axis=0) < 1).sum())
        quickest = float(np.log(np.abs(leaving)).max()) / problem.device.sample_time_s if len(leaving) else math.nan
        rest = "" if held == len(people) else f", the others leave it without swinging, by e in {1 / quickest:.3g} s"
        sentence = (
            f"detents: in a valley, a spring of {slope:.4g}, linearly stable with every hand of [hands] and "
            f"released, spectral radius {radius:.6g} at most; at a top, a spring of {-slope:.4g}, {held} of "
            f"{len(people)} hands, one of them none, hold it{rest}"
        )
        return True, sentence, "", radius
    where = (
        f"in a valley, a spring of {slope:.4g} with {damping:.4g}: spectral radius {radius:.6g}"
        if radius >= 1
        else f"at a top, a spring of {-slope:.4g}: what leaves it swings"
    )
    return False, f"detents: linearly unstable {where}", _advice(problem, slope), radius


def _advice(problem: Problem, slope: float) -> str:
    people = joined(hand_set(problem.hands, draws=_DRAWS), no_hand())
    found = damping_range(problem.device, people, slope)
    if math.isfinite(found.lowest_ns_per_m):
        return (
            f"give the detents a damping of {found.lowest_ns_per_m:.4g} to {found.highest_ns_per_m:.4g}, "
            "or make the detents weaker or wider"
        )
    most = stiffest_wall(problem.device, people).stiffness_n_per_m
    return f"make the detents weaker or wider: no damping holds a slope above {most:.4g}"
