"""Preconditions of a recommendation: infeasible problems, assumptions, and unused keys."""

from __future__ import annotations

from dataclasses import replace
from functools import singledispatch

import numpy as np

from avc_casadi.claims.deployable import detent_claim
from avc_casadi.claims.impedance import PRESS_N
from avc_casadi.files.plausibility import plausibility
from avc_casadi.files.problem_file import BELOW_NYQUIST
from avc_casadi.loops.plant_family import PlantFamily
from avc_casadi.loops.stable_walls import damping_range, softest_wall_n_per_m
from avc_casadi.loops.wall import MAX_DELAY_SAMPLES
from avc_casadi.model import EFFECTS
from avc_casadi.model.corners import LINEAR_KEYS
from avc_casadi.model.declared import declared, declared_effects
from avc_casadi.model.device import Device
from avc_casadi.model.ends import RIGID_N_PER_M, End, Follower, Simulation, Wall
from avc_casadi.model.problem import Frequency, Problem
from avc_casadi.recommendation.assumptions import (
    Assumption,
    RangeTried,
    Simplification,
    Slip,
    Undeclared,
    UndeclaredValue,
    Unused,
    WhyUnused,
)
from avc_casadi.recommendation.reasons import (
    DamperTooLarge,
    NoForce,
    NoMass,
    NothingRendered,
    NothingRenderedBecause,
    Reason,
    TooLate,
    UnstableDetents,
)
from avc_casadi.simulation.population.trial import CouplingTrial

# Keys of a device that neither loop nor trial of a teleoperator has.
_NOT_OF_TELEOPERATORS = ("coulomb_friction_n", "position_noise_rms_m", "backlash_m")


def why_infeasible(problem: Problem) -> Reason | None:
    """Return why no coupling to the wall is deployable at any gains; None where one may be.

    Causes are no mass, no force of the wall, too much delay, a damper above its stability limit, unstable detents.
    """
    device, wall = problem.device, problem.environment
    if device.mass_kg == 0:
        return NoMass(to_wall=True)
    if not (wall.stiffness_n_per_m or wall.damping_ns_per_m):
        return NoForce()
    family = PlantFamily.of(problem)
    slowest = family.largest_delay_samples
    if slowest > MAX_DELAY_SAMPLES:
        return TooLate(slowest, MAX_DELAY_SAMPLES)
    if wall.stiffness_n_per_m == 0:
        largest = damping_range(family, softest_wall_n_per_m(device)).highest_ns_per_m
        if wall.damping_ns_per_m > largest:
            return DamperTooLarge(wall.damping_ns_per_m, largest)
    if problem.detent is not None:
        claim = detent_claim(problem)
        if not claim.passed:
            return UnstableDetents(claim)
    return None


def nothing_rendered(problem: Problem, rendered_n_per_m: float, trial: CouplingTrial) -> NothingRendered | None:
    """Return why nothing of the wall is rendered to a hand; None where something is.

    One encoder step may command more than a press, a press may saturate, or dry friction may hold the device.
    `rendered_n_per_m` is the static stiffness that the coupling renders.
    """
    device = problem.device
    # A robot that no hand holds is not pressed.
    if problem.environment.stiffness_n_per_m == 0 or not max(problem.hands.stiffness_n_per_m):
        return None
    press_n, limit_n = PRESS_N * device.metres_per_unit, device.max_force_n
    most_n = press_n if limit_n is None else min(press_n, limit_n)
    step_m, friction_n = device.encoder_resolution_m, device.coulomb_friction_n
    if rendered_n_per_m * step_m > most_n:
        because = NothingRenderedBecause.STEP_EXCEEDS_FORCE
    elif np.isfinite(trial.stiffness):
        return None
    elif trial.at_force_limit.any():
        because = NothingRenderedBecause.PRESSES_SATURATE
    elif friction_n >= most_n:
        because = NothingRenderedBecause.FRICTION_HOLDS
    else:
        because = NothingRenderedBecause.NO_CONTACT
    return NothingRendered(because, step_m, friction_n, press_n, limit_n)


def assumed(problem: Problem, devices: int = 1) -> tuple[Assumption, ...]:
    """Return the assumptions behind a recommendation: hands, what the device does not declare, ranges, and doubts.

    `devices` is how many devices of the ranges are tried by hands.
    """
    assumptions: list[Assumption] = [Simplification.LINEAR_HANDS, *_undeclared_with(problem.end, problem)]
    if problem.detent is not None:
        assumptions.append(Simplification.NO_DETENTS_IN_TRIAL)
    for key in _ranges(problem):
        linear = key.partition(".range.")[2] in LINEAR_KEYS
        assumptions.append(RangeTried(problem.units.key(key), linear=linear, devices=devices))
    slips = [Slip(doubt) for doubt in plausibility(problem)]
    return (*assumptions, *slips, *_assumed_of(problem.end))


@singledispatch
def _assumed_of(end: End) -> list[Simplification]:  # noqa: ARG001
    """Return what is assumed of an end."""
    return []


@_assumed_of.register
def _assumed_of_simulation(end: Simulation) -> list[Simplification]:
    simplifications = []
    if end.constraint and end.tool_mass_kg is not None:
        simplifications.append(Simplification.TOOL_FREE_OR_HELD)
    steady = len(set(end.step_s)) == 1
    simplifications.append(Simplification.STEADY_STEPS_OF_RANGE if steady else Simplification.STEADY_STEP_OF_LIST)
    of_device = end.clock == "device"
    simplifications.append(
        Simplification.ENGINE_STEPS_OF_DEVICE if of_device else Simplification.ENGINE_CLOCK_OF_ITS_OWN
    )
    return simplifications


@_assumed_of.register
def _assumed_of_follower(end: Follower) -> list[Simplification]:
    """Return what is assumed of a follower: no friction, and what of contact and link it does not state."""
    simplifications = [Simplification.NO_FRICTION_IN_TRIAL]
    if "contact_stiffness_n_per_m" not in end.model_fields_set:
        simplifications.append(Simplification.ANY_CONTACT)
    if end.contact_damping_ns_per_m is None:
        simplifications.append(Simplification.CONTACT_DAMPING)
    if end.jitter == 0 and end.lost_share == 0:
        simplifications.append(Simplification.EVEN_LINK)
    return simplifications


@singledispatch
def _undeclared_with(end: End, problem: Problem) -> list[Undeclared]:  # noqa: ARG001
    """Return the assumptions on what the devices of a problem do not declare."""
    return [Undeclared(missing) for missing in _missing(problem.device, friction=True)]


@_undeclared_with.register
def _undeclared_with_follower(end: Follower, problem: Problem) -> list[Undeclared]:
    leader = [Undeclared(missing, "leader") for missing in _missing(problem.device, friction=False)]
    return leader + [Undeclared(missing, "follower") for missing in _missing(end, friction=False)]


def _missing(device: Device, *, friction: bool) -> list[UndeclaredValue]:
    """Return which of amplifier, resonance, dry friction, encoder and force limit a device does not declare."""
    ranges = device.range
    missing = []
    if device.amplifier_bandwidth_hz is None:
        missing.append(UndeclaredValue.AMPLIFIER_BANDWIDTH)
    if device.resonance is None:
        missing.append(UndeclaredValue.RESONANCE)
    if friction and device.coulomb_friction_n == 0 and ranges.coulomb_friction_n is None:
        missing.append(UndeclaredValue.DRY_FRICTION)
    if device.encoder_resolution_m == 0 and ranges.encoder_resolution_m is None:
        missing.append(UndeclaredValue.ENCODER_RESOLUTION)
    if device.max_force_n is None:
        missing.append(UndeclaredValue.FORCE_LIMIT)
    return missing


def _ranges(problem: Problem) -> list[str]:
    """Return the declared ranges, of a second device too."""
    return [key for key in _declared_with(problem.end, problem) if ".range." in key]


@singledispatch
def _declared_with(end: End, problem: Problem) -> list[str]:  # noqa: ARG001
    """Return the declared keys of the devices of a problem that the trial has."""
    return [key for key in declared(problem) if key not in _not_simulated(problem.device)]


@_declared_with.register
def _declared_with_follower(end: Follower, problem: Problem) -> list[str]:
    far = problem.model_copy(update={"device": end.at_leader()})
    keys = [key for key in declared(problem) if key not in _not_simulated(problem.device)]
    keys += [key.replace("device", "follower", 1) for key in declared(far)]
    return [key for key in keys if key.rpartition(".")[2] not in _NOT_OF_TELEOPERATORS]


def _not_simulated(device: Device) -> set[str]:
    """Return the declared keys without effect with an encoder at the handle: play is between it and the motor."""
    at_handle = device.encoder_at == "handle" and device.resonance is not None
    return {"device.backlash_m", "device.range.backlash_m"} if at_handle else set()


def not_used(problem: Problem) -> tuple[Unused, ...]:
    """Return the declared keys that no candidate, certificate or trial uses."""
    unseen = _not_simulated(problem.device)
    unused = [Unused(key, WhyUnused.ENCODER_AT_HANDLE) for key in declared(problem) if key in unseen]
    kept = ("device", "environment", "frequency", *problem.end_tables())
    bare = type(problem)(**{table: getattr(problem, table) for table in kept})
    bare = bare.changed(coupling={"contact": problem.coupling.contact})
    tables = ("boundaries", "stability", "realism", "schedule", "coupling", "robustness")
    stated = [key for key in tables if getattr(problem, key) != getattr(bare, key)]
    # The default band ends lower for a slow device.
    if problem.frequency not in (Frequency(), Frequency(stop_hz=BELOW_NYQUIST / problem.device.sample_time_s)):
        stated.append("frequency")
    unused += _unused_beside(problem.end, problem, bare, stated)
    if problem.law is not None:
        unused.append(Unused("law", WhyUnused.LAW))
    simulated = {effect.kind for effect in declared_effects(problem)}
    alone = [effect.kind for effect in problem.scene.effects if EFFECTS[effect.kind].scene_alone]
    known = {"velocity-filter": WhyUnused.SIMULATED_AND_RENDERED_ALONE}
    unused += [
        Unused(f"scene.effects: {kind}", known.get(kind, WhyUnused.SIMULATED_ALONE))
        for kind in alone
        if kind not in simulated
    ]
    return tuple(replace(item, key=problem.units.key(item.key)) for item in unused)


@singledispatch
def _unused_beside(end: End, problem: Problem, bare: Problem, stated: list[str]) -> list[Unused]:
    """Return the stated tables, and the keys of its own, that a coupling to an end does not use; `bare` has none."""
    wall = problem.environment
    stated = stated + (["environment"] if wall.stiffness_n_per_m or wall.damping_ns_per_m else [])
    unused = [Unused(table, WhyUnused.OF_WALL, end.kind) for table in stated]
    if problem.scene != bare.scene:
        why = WhyUnused.OF_SCENE if end.in_scenes else WhyUnused.OF_SCENE_WITHOUT_END
        unused.append(Unused("scene", why, end.kind))
    return unused + _unused_of(end, problem)


@_unused_beside.register
def _unused_beside_wall(end: Wall, problem: Problem, bare: Problem, stated: list[str]) -> list[Unused]:  # noqa: ARG001
    return [Unused(table, WhyUnused.OF_SOLVE) for table in stated if table != "robustness"]


@singledispatch
def _unused_of(end: End, problem: Problem) -> list[Unused]:  # noqa: ARG001
    """Return the keys of an end and of its devices without effect."""
    return []


@_unused_of.register
def _unused_of_simulation(tool: Simulation, problem: Problem) -> list[Unused]:  # noqa: ARG001
    """Return the keys of a tool and its contact that have no effect, as there is no tool or no spring."""
    default = Simulation(step_s=tool.step_s)
    keys = ["contact_damping_ns_per_m"]
    why = WhyUnused.NO_SPRING_TOUCHED
    if tool.tool_mass_kg is None:
        keys += ["tool_damping_ns_per_m", "integrator", "substeps", "contact_stiffness_n_per_m"]
        why = WhyUnused.NO_TOOL
    elif any(0 < contact < RIGID_N_PER_M for contact in tool.contact_stiffness_n_per_m):
        return []
    return [Unused(f"simulation.{key}", why) for key in keys if getattr(tool, key) != getattr(default, key)]


@_unused_of.register
def _unused_of_teleoperator(follower: Follower, problem: Problem) -> list[Unused]:
    return [
        Unused(f"{table}.{key}", WhyUnused.NOT_OF_TELEOPERATORS)
        for table, device in (("device", problem.device), ("follower", follower))
        for key in _NOT_OF_TELEOPERATORS
        if getattr(device, key) > 0 or getattr(device.range, key) is not None
    ]
