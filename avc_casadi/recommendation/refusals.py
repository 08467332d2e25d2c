"""What `recommend` refuses at any gains, known at once: `check` says the same, before any coupling is searched.

A press of the trial moves the hand's target 10 mm into the wall. Where dry friction holds the device against the hand's
spring, damper and momentum, no press ends in contact: that is integrated for the corners of the hands, without a wall.
Where a press at rest is at the force limit even with the weakest hand K, before a wall k and behind friction f,

    k x = K (end - x) - f,   k x > 0.97 limit,

every press saturates, and nothing of the wall is rendered.
"""

from __future__ import annotations

import math
from functools import partial, singledispatch

import numpy as np

from avc_casadi.design.virtual_tool import EndSearch, search_of
from avc_casadi.loops.engine import ToolLoops
from avc_casadi.loops.plant_family import PlantFamily
from avc_casadi.loops.stable_walls import stiffest_wall
from avc_casadi.model.ends import End, Follower, Simulation, Wall
from avc_casadi.model.hands import hand_corners
from avc_casadi.model.joint import Joint
from avc_casadi.model.problem import Problem
from avc_casadi.model.scene import Motion, Press
from avc_casadi.recommendation.joint import NO_JOINT_GAINS, recommend_joint
from avc_casadi.recommendation.preconditions import why_infeasible
from avc_casadi.recommendation.reasons import (
    NoMass,
    NoPairStable,
    NothingRendered,
    NothingRenderedBecause,
    Reason,
    UnstableEngine,
    UnstableStiffness,
)
from avc_casadi.simulation.population.motions import at_handle
from avc_casadi.simulation.population.trial import NEAR_LIMIT

_STEP_S = 1e-4
"""Step of a press, s: a hundredth of the fastest swing of a hand on its spring."""
_AT_REST_S = 0.5
"""How long the target stays at its end: until the device has stopped."""


@singledispatch
def refusal(end: End, problem: Problem) -> Reason | None:  # noqa: ARG001
    """Return why no coupling to an end is deployable, as far as that is known at once; None where one may be."""
    return None


@refusal.register
def _refusal_of_wall(end: Wall, problem: Problem) -> Reason | None:  # noqa: ARG001
    return why_infeasible(problem) or no_press_renders(problem)


@refusal.register
def _refusal_of_simulation(tool: Simulation, problem: Problem) -> Reason | None:
    if problem.device.mass_kg == 0:
        return NoMass(to_wall=False)
    if not ToolLoops(problem).engine_alone_stable():
        return unstable_engine(tool)
    return _unstable(search_of(tool, problem), tool)


@refusal.register
def _refusal_of_follower(follower: Follower, problem: Problem) -> Reason | None:
    return _unstable(search_of(follower, problem), follower)


@refusal.register
def _refusal_of_joint(joint: Joint, problem: Problem) -> Reason | None:  # noqa: ARG001
    return NO_JOINT_GAINS if recommend_joint(problem).stiffest is None else None


def unstable_engine(tool: Simulation) -> UnstableEngine:
    """Return that an engine's own contact is unstable: the stiffest, at its longest step, of its lightest tool."""
    lightest_kg = min(tool.tool_mass_kg or (math.inf,))
    return UnstableEngine(tool.contact_stiffness_n_per_m[1], max(tool.step_s), lightest_kg)


def _unstable(search: EndSearch, end: End) -> Reason | None:
    """Return that no damper keeps a required stiffness stable at the corners of all ranges, or any stiffness at all."""
    required_n_per_m = search.wanted_n_per_m
    stiffness_n_per_m = search.softest.stiffness_n_per_m if required_n_per_m is None else required_n_per_m
    if any(search.held(stiffness_n_per_m, local=local, inside=False) is not None for local in (False, True)):
        return None
    return NoPairStable() if required_n_per_m is None else UnstableStiffness(required_n_per_m, end.kind)


def no_press_renders(problem: Problem) -> NothingRendered | None:
    """Return why no press of a hand of the ranges meets a rendered wall, whatever the coupling; None where one may.

    Dry friction may hold the device against the strongest hand's press, or the weakest press may saturate the force.
    """
    device = problem.device
    hands = problem.hands
    wall_n_per_m = problem.environment.stiffness_n_per_m
    weakest_n_per_m, strongest_n_per_m = hands.stiffness_n_per_m
    if wall_n_per_m == 0 or strongest_n_per_m == 0 or device.mass_kg == 0:
        return None
    press = at_handle(Press(), device)
    friction_n, limit_n = device.coulomb_friction_n, device.max_force_n
    because = partial(
        NothingRendered,
        step_m=device.encoder_resolution_m,
        friction_n=friction_n,
        press_n=strongest_n_per_m * press.end_m,
        limit_n=limit_n,
    )
    # Less friction than the spring alone overcomes holds no device.
    if friction_n >= strongest_n_per_m * press.end_m and deepest_without_wall_m(problem, press) <= 0:
        return because(NothingRenderedBecause.FRICTION_HOLDS)
    if limit_n is None:
        return None
    # Before a wall that no spring and damper renders, something softer may press less.
    rendered_n_per_m = min(wall_n_per_m, stiffest_wall(PlantFamily.of(problem)).stiffness_n_per_m)
    least_n = weakest_n_per_m * press.end_m - friction_n
    if rendered_n_per_m * least_n / (weakest_n_per_m + rendered_n_per_m) > NEAR_LIMIT * limit_n:
        return because(NothingRenderedBecause.PRESSES_SATURATE)
    return None


def deepest_without_wall_m(problem: Problem, press: Motion) -> float:
    """Return how deep the deepest of the corner hands presses a device with dry friction where no wall is.

    Implicit steps of M x'' = K (target - x) + B (target' - x') - f sign(x'), in which friction stops and never drives.
    """
    device, hand = problem.device, hand_corners(problem.hands)
    mass = device.mass_kg + np.asarray(hand.mass_kg)
    damping, stiffness = np.asarray(hand.damping_ns_per_m), np.asarray(hand.stiffness_n_per_m)
    inertia = mass + _STEP_S * (damping + device.damping_ns_per_m) + _STEP_S**2 * stiffness
    position, speed = np.full(mass.shape, press.start_m), np.zeros(mass.shape)
    moves_s = (press.end_m - press.start_m) / press.speed_m_per_s
    for step in range(1, round((moves_s + _AT_REST_S) / _STEP_S) + 1):
        time_s = min(step * _STEP_S, moves_s)
        target_m = press.start_m + time_s * press.speed_m_per_s
        pace = press.speed_m_per_s if time_s < moves_s else 0.0
        impulse = mass * speed + _STEP_S * (stiffness * (target_m - position) + damping * pace)
        speed = np.sign(impulse) * np.maximum(np.abs(impulse) - _STEP_S * device.coulomb_friction_n, 0.0) / inertia
        position = position + _STEP_S * speed
    return float(position.max())
