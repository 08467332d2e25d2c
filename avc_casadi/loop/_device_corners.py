"""The corners of what is known of a device: every claim must hold at the worst of them."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from avc_casadi.problem import Device, Problem


def device_corners(problem: Problem) -> list[Device]:
    """Devices at the corners of the ranges of mass and damping; the nominal device alone where none is given."""
    device = problem.device
    masses = sorted(set(device.range.mass_kg or (device.mass_kg,)))
    dampings = sorted(set(device.range.damping_ns_per_m or (device.damping_ns_per_m,)))
    return [
        device.model_copy(update={"mass_kg": mass, "damping_ns_per_m": damping})
        for mass, damping in product(masses, dampings)
    ]


def least_damped(problem: Problem) -> Problem:
    """Return the problem with the lowest damping that its device may have: Re Z_h grows with it."""
    lowest = min(device.damping_ns_per_m for device in device_corners(problem))
    return problem.model_copy(update={"device": problem.device.model_copy(update={"damping_ns_per_m": lowest})})
