"""The corners of what is known of a device: every claim must hold at the worst of them."""

from __future__ import annotations

from functools import lru_cache
from itertools import product
from typing import TYPE_CHECKING

from avc_casadi.problem import DeviceRange

if TYPE_CHECKING:
    from avc_casadi.problem import Problem


# Every check of a schedule asks for the corners of the same few problems.
@lru_cache(maxsize=16)
def device_corners(problem: Problem) -> tuple[Problem, ...]:
    """The problem at the corners of the ranges of device mass and damping, each with a device that is known exactly.

    The nominal device alone where no range is given.
    """
    device = problem.device
    masses = sorted(set(device.range.mass_kg or (device.mass_kg,)))
    dampings = sorted(set(device.range.damping_ns_per_m or (device.damping_ns_per_m,)))
    return tuple(_with_device(problem, mass, damping) for mass, damping in product(masses, dampings))


@lru_cache(maxsize=16)
def least_damped(problem: Problem, credit_ns_per_m: float = 0.0) -> Problem:
    """Return the problem with the lowest damping that its device may have: Re Z_h grows with it.

    Args:
        problem: the problem.
        credit_ns_per_m: damping of the hand, credited to the device.
    """
    lowest = min(corner.device.damping_ns_per_m for corner in device_corners(problem))
    return _with_device(problem, problem.device.mass_kg, lowest + credit_ns_per_m)


def _with_device(problem: Problem, mass_kg: float, damping_ns_per_m: float) -> Problem:
    return problem.changed(device={"mass_kg": mass_kg, "damping_ns_per_m": damping_ns_per_m, "range": DeviceRange()})
