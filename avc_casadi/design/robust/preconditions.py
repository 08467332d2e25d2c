"""When a robust law can be searched at all, and the wall as a law meets it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from avc_casadi.claims.stability.frozen_loop import MAX_DELAY_SAMPLES, Rendering, frozen_rendering
from avc_casadi.model.gains import Gains, spring_before

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem


def why_no_law(problem: Problem) -> str:
    """Say why a device before a wall has no law; empty where it may have one."""
    device = problem.device
    faults = []
    if not problem.environment.stiffness_n_per_m > 0:
        faults.append("the wall has no stiffness to be rendered (environment.stiffness_n_per_m)")
    if not device.mass_kg > 0:
        faults.append("the device has no mass (device.mass_kg), so that nothing is there when it is released")
    if device.delay_samples > MAX_DELAY_SAMPLES / 4:
        faults.append(f"the delay of {device.delay_samples:g} samples is above {MAX_DELAY_SAMPLES // 4}")
    return "; ".join(faults)


def softened(problem: Problem, stiffness_n_per_m: float) -> tuple[Gains, Rendering]:
    """Return the spring in series with which the wall has a stiffness at rest, and both as they are rendered."""
    gains = Gains(0.0, spring_before(problem, stiffness_n_per_m))
    return gains, frozen_rendering(problem, 0.0, gains.stiffness_n_per_m)
