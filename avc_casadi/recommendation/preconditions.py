"""Preconditions of a recommendation: infeasible problems, assumptions, and unused keys."""

from __future__ import annotations

from dataclasses import dataclass
from functools import singledispatch

import numpy as np

from avc_casadi._util.json_values import Sentence
from avc_casadi.claims.deployable import detent_claim
from avc_casadi.claims.impedance import PRESS_N
from avc_casadi.files.plausibility import plausibility
from avc_casadi.files.problem_file import BELOW_NYQUIST
from avc_casadi.loops.engine import ToolLoops
from avc_casadi.loops.plant_family import PlantFamily
from avc_casadi.loops.wall import MAX_DELAY_SAMPLES
from avc_casadi.loops.walls import damping_range, softest_wall_n_per_m
from avc_casadi.model import EFFECTS
from avc_casadi.model.corners import LINEAR_KEYS
from avc_casadi.model.declared import declared, declared_effects
from avc_casadi.model.device import Device
from avc_casadi.model.ends import RIGID_N_PER_M, End, Follower, Simulation, Wall
from avc_casadi.model.problem import Frequency, Problem
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

_OF_SOLVE = "of avc solve"


@dataclass(frozen=True)
class Assumption(Sentence):
    """What a recommendation assumes, in words; a slip is a value that was perhaps not meant."""

    text: str
    slip: bool = False

    def __str__(self) -> str:
        return f"what may be a slip: {self.text}" if self.slip else self.text


@dataclass(frozen=True)
class Unused(Sentence):
    """A declared key that no candidate, certificate or trial uses, and why."""

    key: str
    why: str

    @property
    def asked_of_solve(self) -> bool:
        """Whether it asks something of other methods, which weakens no verdict."""
        return self.why == _OF_SOLVE

    def __str__(self) -> str:
        return f"{self.key} ({self.why})"


# Keys of a device that neither loop nor trial of a teleoperator has.
_NOT_OF_TELEOPERATORS = ("coulomb_friction_n", "position_noise_rms_m", "backlash_m")


def why_infeasible(problem: Problem) -> Reason | None:
    """Return why no coupling is deployable at any gains; None where one may be."""
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
    """Return why nothing of the wall is rendered to a hand; None where something is."""
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
    """Return the assumptions."""
    gaps = ["hands are linear, on one axis, and do not change while they hold the device"]
    gaps += _undeclared_with(problem.end, problem)
    if problem.detent is not None:
        gaps.append("simulated hands feel no detents: the claims cover their slopes, and avc simulate includes them")
    at = "trial at nominal" if devices == 1 else f"trial at nominal, and by others at {devices} devices of the ranges"
    for key in _ranges(problem):
        linear = key.partition(".range.")[2] in LINEAR_KEYS
        gaps.append(
            f"{key}: {f'linear stability at its corners, {at}' if linear else f'{at}; no part of linear stability'}"
        )
    slips = (Assumption(f"{doubt.key} {doubt.message}", slip=True) for doubt in plausibility(problem))
    return (*map(Assumption, gaps), *slips, *map(Assumption, _assumed_of(problem.end)))


@singledispatch
def _assumed_of(end: End) -> list[str]:  # noqa: ARG001
    """Return what is assumed of an end."""
    return []


@_assumed_of.register
def _assumed_of_simulation(end: Simulation) -> list[str]:
    found = []
    if end.constraint and end.tool_mass_kg is not None:
        found.append(
            "the engine's contacts are constraints: the tool is free or stands still; for springs state a range"
        )
    if len(set(end.step_s)) == 1:
        found.append("the engine's step is steady: a range of step_s is judged at each steady step in it")
    else:
        found.append("the engine's step is steady, any of step_s: steps that vary are in the trial alone")
    return found


@_assumed_of.register
def _assumed_of_follower(end: Follower) -> list[str]:
    found = ["simulated hands: neither device has dry friction"]
    if "contact_stiffness_n_per_m" not in end.model_fields_set:
        found.append("the follower touches anything from nothing to a rigid object")
    if end.contact_damping_ns_per_m is None:
        found.append("what the follower touches is damped by a tenth of the critical damping")
    if end.jitter == 0 and end.lost_share == 0:
        found.append("the link is even: no jitter and no lost messages are declared")
    return found


@singledispatch
def _undeclared_with(end: End, problem: Problem) -> list[str]:  # noqa: ARG001
    """Return the assumptions on what the devices of a problem do not declare."""
    return _undeclared(problem.device, friction=True)


@_undeclared_with.register
def _undeclared_with_follower(end: Follower, problem: Problem) -> list[str]:
    devices = (("leader", problem.device), ("follower", end))
    return [f"{who}: {gap}" for who, device in devices for gap in _undeclared(device, friction=False)]


def _undeclared(device: Device, *, friction: bool) -> list[str]:
    """Return the assumptions on what a device does not declare."""
    known, gaps = device.range, []
    if device.amplifier_bandwidth_hz is None:
        gaps.append("no amplifier bandwidth is declared: an ideal amplifier is assumed")
    if device.resonance is None:
        gaps.append("no resonance is declared: a rigid structure is assumed")
    if friction and device.coulomb_friction_n == 0 and known.coulomb_friction_n is None:
        gaps.append("no dry friction is declared: 0 is assumed, the cautious value")
    if device.encoder_resolution_m == 0 and known.encoder_resolution_m is None:
        gaps.append("no encoder resolution is declared: an exact position is assumed, the ideal value")
    if device.max_force_n is None:
        gaps.append("no force limit is declared: an unlimited force is assumed")
    return gaps


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
    unused = [Unused(key, "not seen by an encoder at the handle") for key in declared(problem) if key in unseen]
    kept = ("device", "environment", "frequency", *problem.end_tables())
    bare = type(problem)(**{table: getattr(problem, table) for table in kept})
    bare = bare.changed(coupling={"contact": problem.coupling.contact})
    tables = ("boundaries", "stability", "realism", "schedule", "coupling", "robustness")
    stated = [key for key in tables if getattr(problem, key) != getattr(bare, key)]
    # The default band ends lower for a slow device.
    if problem.frequency not in (Frequency(), Frequency(stop_hz=BELOW_NYQUIST / problem.device.sample_time_s)):
        stated.append("frequency")
    unused += _unused_beside(problem.end, problem, bare, stated)
    unused += (
        [Unused("law", "avc certify judges it, avc trial, simulate and export run it")]
        if problem.law is not None
        else []
    )
    simulated = {effect.kind for effect in declared_effects(problem)}
    known = {"velocity-filter": "known to avc simulate and avc zwidth alone"}
    return (
        *unused,
        *(
            Unused(f"scene.effects: {effect.kind}", known.get(effect.kind, "simulated by avc simulate alone"))
            for effect in problem.scene.effects
            if EFFECTS[effect.kind].scene_alone and effect.kind not in simulated
        ),
    )


@singledispatch
def _unused_beside(end: End, problem: Problem, bare: Problem, stated: list[str]) -> list[Unused]:
    """Return the stated tables, and the keys of its own, that a coupling to an end does not use; `bare` has none."""
    wall = problem.environment
    stated = stated + (["environment"] if wall.stiffness_n_per_m or wall.damping_ns_per_m else [])
    of_wall = f"of a wall in the device's own loop: leave [{end.kind}] out for it"
    unused = [Unused(table, of_wall) for table in stated]
    if problem.scene != bare.scene:
        knows = "of avc simulate alone" if end.in_scenes else f"of avc simulate, which knows no [{end.kind}]"
        unused.append(Unused("scene", knows))
    return unused + _unused_of(end, problem)


@_unused_beside.register
def _unused_beside_wall(end: Wall, problem: Problem, bare: Problem, stated: list[str]) -> list[Unused]:  # noqa: ARG001
    return [Unused(table, _OF_SOLVE) for table in stated if table != "robustness"]


@singledispatch
def _unused_of(end: End, problem: Problem) -> list[Unused]:  # noqa: ARG001
    """Return the keys of an end and of its devices without effect."""
    return []


@_unused_of.register
def _unused_of_simulation(tool: Simulation, problem: Problem) -> list[Unused]:  # noqa: ARG001
    default = Simulation(step_s=tool.step_s)
    keys, why = ["contact_damping_ns_per_m"], "of a contact spring, and there is no such spring"
    if tool.tool_mass_kg is None:
        keys += ["tool_damping_ns_per_m", "integrator", "substeps", "contact_stiffness_n_per_m"]
        why = "of a tool, and tool_mass_kg is missing"
    elif any(0 < contact < RIGID_N_PER_M for contact in tool.contact_stiffness_n_per_m):
        return []
    return [Unused(f"simulation.{key}", why) for key in keys if getattr(tool, key) != getattr(default, key)]


@_unused_of.register
def _unused_of_teleoperator(follower: Follower, problem: Problem) -> list[Unused]:
    return [
        Unused(f"{table}.{key}", "not simulated with a follower")
        for table, device in (("device", problem.device), ("follower", follower))
        for key in _NOT_OF_TELEOPERATORS
        if getattr(device, key) > 0 or getattr(device.range, key) is not None
    ]


@singledispatch
def doubts(end: End, problem: Problem) -> dict[str, str]:  # noqa: ARG001
    """Return unusual values of an end by key, as warnings before any coupling is searched."""
    return {}


@doubts.register
def _doubts_of_simulation(tool: Simulation, problem: Problem) -> dict[str, str]:
    """Return what is costliest in stiffness, or beyond any coupling."""
    t, found = problem.device.sample_time_s, dict[str, str]()
    if not ToolLoops(problem).engine_alone_stable():
        found["contact_stiffness_n_per_m"] = (
            "makes the engine's own contact unstable at this step, whatever the coupling"
        )
    if tool.exchange == "ahead" and tool.tool_mass_kg is not None:
        found["exchange"] = (
            "is ahead: the device receives a state that is already the result of its force, which acts like a negative "
            "damper; a damper in the device's loop compensates this. Better send the state with which the step began "
            "(on-time)"
        )
    if tool.integrator == "explicit":
        found["integrator"] = "is explicit: it adds energy to every oscillation; use semi-implicit if the engine has it"
    if tool.substeps > 1:
        found["substeps"] = (
            "hold a force for the whole step; compute it in each substep instead, and state that time as step_s"
        )
    if any(abs(step_s / t - round(step_s / t)) > 1e-6 for step_s in tool.step_s):
        found["step_s"] = f"is not a multiple of T = {t:g} s: every phase of the two clocks is judged"
    return {f"{tool.kind}.{key}": text for key, text in found.items()}
