"""Devices for which no coupling is looked for: what is wrong with them no coupling mends."""

from __future__ import annotations

from typing import TYPE_CHECKING

from avc_casadi.claims.detent import detent_verdict

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem


def hopeless(problem: Problem) -> str:
    """Return why no coupling is deployable, whatever its gains; empty where one may be.

    Args:
        problem: device, wall, hands and detents.
    """
    device, wall = problem.device, problem.environment
    if device.mass_kg == 0:
        return (
            "the device has no mass (device.mass_kg is 0): let go, nothing is there that a coupling could hold; give "
            "the mass of what moves"
        )
    if not (wall.stiffness_n_per_m or wall.damping_ns_per_m):
        return "the wall gives no force: there is nothing to couple to; give [environment] a stiffness or a damping"
    if problem.detent is not None:
        passed, sentence, advice, _ = detent_verdict(problem)
        if not passed:
            return f"whatever the coupling, {sentence}; {advice}"
    return ""
