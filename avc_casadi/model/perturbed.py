"""Devices a little off their file: what a law meets on a real device, whose values nobody knows exactly."""

from __future__ import annotations

from itertools import product

from avc_casadi.model.corners import device_with, linear_values
from avc_casadi.model.declared import declared
from avc_casadi.model.device import Device
from avc_casadi.model.problem import Problem

PERTURBED_SHARE = 0.1
"""Relative perturbation of a value without a stated range, up and down: how well a careful identification knows it."""
LATER_SAMPLES = 0.25
"""By how much a delay without a stated range is longer; a shorter one is easier."""


def perturbed_keys(problem: Problem) -> tuple[str, ...]:
    """Return the keys of the device's linear values that have no stated range."""
    ranged = set(declared(problem))
    values = linear_values(problem.device)
    return tuple(key for key, value in values.items() if value > 0 and f"device.range.{key}" not in ranged)


def perturbed_devices(problem: Problem) -> list[Device]:
    """Return the devices with every value of `perturbed_keys` off either way: all combinations; none without keys."""
    keys = perturbed_keys(problem)
    if not keys:
        return []
    values = linear_values(problem.device)
    ends = [_ends(key, values[key]) for key in keys]
    return [device_with(problem.device, dict(zip(keys, corner, strict=True))) for corner in product(*ends)]


def _ends(key: str, value: float) -> tuple[float, float]:
    if key == "delay_samples":
        return value, value + LATER_SAMPLES
    return (1 - PERTURBED_SHARE) * value, (1 + PERTURBED_SHARE) * value
