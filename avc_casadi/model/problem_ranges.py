"""A problem over the ranges of its device: its corners, the least damped device, and the margin that covers it."""

from __future__ import annotations

from functools import lru_cache

from avc_casadi.model.corners import device_corners
from avc_casadi.model.problem import Problem


# Cached: every check of a schedule needs the corners of the same few problems.
@lru_cache(maxsize=16)
def corner_problems(problem: Problem) -> tuple[Problem, ...]:
    """Return the problem at the corners of the ranges of device mass and damping, each device without ranges."""
    corners = device_corners(problem.device, ("mass_kg", "damping_ns_per_m"))
    return tuple(problem.changed(device=corner) for corner in corners)


@lru_cache(maxsize=16)
def least_damped(problem: Problem, credit_ns_per_m: float = 0.0) -> Problem:
    """Return the problem with the lowest damping that its device may have: Re Z_h grows with it."""
    lowest = min(device.damping_ns_per_m for device in device_corners(problem.device, ("damping_ns_per_m",)))
    known = {"damping_ns_per_m": lowest + credit_ns_per_m, "range": {"damping_ns_per_m": None}}
    return problem.changed(device=known)


def margin_over_range(problem: Problem) -> float:
    """Return the Re Z_h of the nominal device at which every device of its range keeps the margin, N.s/m."""
    spread = problem.device.damping_ns_per_m - least_damped(problem).device.damping_ns_per_m
    return problem.stability.margin_ns_per_m + spread
