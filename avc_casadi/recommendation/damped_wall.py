"""What a damper of the wall would change where a coupling rings: damping ratio, settling time, and impedance error."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from avc_casadi.claims.impedance import handle_impedance, target_impedance
from avc_casadi.coupling import Coupling
from avc_casadi.design.program import DISK_MARGIN, program_answers, why_no_law
from avc_casadi.loops.damped_wall import RINGS_BELOW, proposed_damper_ns_per_m, softened_n_per_m
from avc_casadi.loops.margins import OpenLoop, Transient, transients
from avc_casadi.loops.plant_family import PlantFamily
from avc_casadi.loops.wall import law_at_rest
from avc_casadi.model.gains import Gains, near_rigid_n_per_m
from avc_casadi.model.problem import Problem

_SLOW_HZ = 1.0
_BRISK_HZ = 10.0
"""Frequencies of the errors: a slow motion of a hand, and the fastest."""


@dataclass(frozen=True)
class DampedWall:
    """A wall with a damper in place of the declared one, and what a coupling to it reaches, the worst of all hands.

    Attributes:
        stiffness_n_per_m: of the wall.
        damping_ns_per_m: of the wall.
        damping_ratio: smallest, held or released.
        settling_s: longest, held or released.
        error_at_1_hz_share: impedance error against the declared wall.
        error_at_10_hz_share: the same.
    """

    stiffness_n_per_m: float
    damping_ns_per_m: float
    damping_ratio: float
    settling_s: float
    error_at_1_hz_share: float
    error_at_10_hz_share: float


def least_damped(of_loops: tuple[Transient, Transient]) -> Transient:
    """Return the transient of the smaller damping ratio: released, or with the worst hand."""
    return min(of_loops, key=lambda transient: transient.damping_ratio)


def damped_wall(coupling: Coupling) -> DampedWall | None:
    """Return a wall with a damper that does not ring, or rings least of those tried; None where the coupling does not.

    Tried are the declared stiffness with the damper that `avc new` proposes, rendered directly, then by an observer
    law; then the same with half of the stiffest wall that a spring and damper renders.
    """
    problem = coupling.problem
    wall_n_per_m = problem.environment.stiffness_n_per_m
    if wall_n_per_m == 0 or problem.device.mass_kg == 0 or problem.detent is not None:
        return None
    present = least_damped(transients(coupling)).damping_ratio
    if present >= RINGS_BELOW:
        return None
    best: DampedWall | None = None
    for damped in _damped_couplings(problem):
        reached = _reached(problem, damped)
        if reached is not None and reached.damping_ratio > (present if best is None else best.damping_ratio):
            best = reached
        if best is not None and best.damping_ratio >= RINGS_BELOW:
            break
    return best


def _damped_couplings(problem: Problem) -> Iterator[Coupling]:
    """Yield couplings to walls with a damper, N.s/m, the nearest to the declared wall first.

    First the wall with a damper, rendered as it is and by observer laws, then a softer one with it.
    """
    family = PlantFamily.of(problem)
    wall = problem.environment
    damper = proposed_damper_ns_per_m(family, wall.stiffness_n_per_m)
    softer_n_per_m = softened_n_per_m(family, wall.stiffness_n_per_m)
    if damper > wall.damping_ns_per_m:
        damped = problem.changed(environment={"damping_ns_per_m": damper})
        yield _rendered_directly(damped)
        if softer_n_per_m < wall.stiffness_n_per_m and not why_no_law(damped):
            yield from (answer.coupling for answer in program_answers(damped, DISK_MARGIN))
    if damper > 0 and softer_n_per_m < wall.stiffness_n_per_m:
        softer = {"stiffness_n_per_m": float(f"{softer_n_per_m:.2g}"), "damping_ns_per_m": damper}
        yield _rendered_directly(problem.changed(environment=softer))


def _rendered_directly(problem: Problem) -> Coupling:
    return Coupling.constant(problem, Gains(0.0, near_rigid_n_per_m(problem.device)), "none")


def _reached(declared: Problem, coupling: Coupling) -> DampedWall | None:
    """Return damping, settling time and error of a coupling to a damped wall; None where its disk margin is too small.

    The error is |Z_h - Z|/max(|Z|, |Z_e|) at 1 and 10 Hz: Z_h the impedance at the handle, Z_e the declared wall's, Z
    that of wall and device.
    """
    if OpenLoop.of(coupling).quick_disk_margin < DISK_MARGIN:
        return None
    of_loops = transients(coupling)
    wall = coupling.wall
    hz = np.array([_SLOW_HZ, _BRISK_HZ])
    force = law_at_rest(coupling).transfer(np.exp(2j * np.pi * hz * declared.device.sample_time_s))
    wanted, size = target_impedance(declared, hz)
    slow, brisk = (np.abs(handle_impedance(declared.device, force, hz)[0] - wanted) / size).tolist()
    return DampedWall(
        stiffness_n_per_m=wall.stiffness_n_per_m,
        damping_ns_per_m=wall.damping_ns_per_m,
        damping_ratio=least_damped(of_loops).damping_ratio,
        settling_s=max(transient.settling_s for transient in of_loops),
        error_at_1_hz_share=slow,
        error_at_10_hz_share=brisk,
    )
