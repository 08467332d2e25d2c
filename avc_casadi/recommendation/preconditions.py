"""Preconditions of a recommendation: infeasible problems, assumptions, and unused keys."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.claims.deployable import detent_verdict
from avc_casadi.claims.impedance import PRESS_N
from avc_casadi.files.plausibility import plausibility
from avc_casadi.files.problem_file import BELOW_NYQUIST
from avc_casadi.loops.wall import MAX_DELAY_SAMPLES
from avc_casadi.loops.walls import damping_range, softest_wall_n_per_m
from avc_casadi.model import EFFECTS
from avc_casadi.model.corners import LINEAR_KEYS, device_corners
from avc_casadi.model.ends import RIGID_N_PER_M, VirtualTool
from avc_casadi.model.hands import hand_corners, with_released
from avc_casadi.model.problem import Frequency, GainBox, Realism, ScheduleSettings, Stability, defaults_at
from avc_casadi.model.scene import declared, declared_effects

if TYPE_CHECKING:
    from collections.abc import Sequence

    from avc_casadi.coupling import Coupling
    from avc_casadi.model.device import Device
    from avc_casadi.model.problem import Problem
    from avc_casadi.simulation.population.trial import CouplingTrial

SLIP = "what may be a slip: "
_OF_SOLVE = " (asked of avc solve)"
_RANGE = "device.range."
# Keys of a device that neither loop nor trial of a teleoperator has.
_NOT_OF_TELEOPERATORS = ("coulomb_friction_n", "position_noise_rms_m", "backlash_m")
# Tables that concern a wall in the device's own loop.
_WALLS = ("boundaries", "coupling", "stability", "realism", "schedule", "robustness")
_BOX, _ANY = ("damping_ns_per_m", "stiffness_n_per_m", "contact_damping_ns_per_m"), (-np.inf, np.inf)


def why_infeasible(problem: Problem) -> str:
    """Return why no coupling is deployable at any gains; empty where one may be."""
    device, wall = problem.device, problem.environment
    if device.mass_kg == 0:
        return (
            "the device has no mass (device.mass_kg is 0): released, nothing is there that a "
            "coupling could hold; give the mass of what moves"
        )
    if not (wall.stiffness_n_per_m or wall.damping_ns_per_m):
        return "the wall gives no force: there is nothing to couple to; give [environment] a stiffness or a damping"
    slowest = max(one.delay_samples for one in device_corners(device, ("delay_samples",)))
    if slowest > MAX_DELAY_SAMPLES:
        return (
            f"no coupling is judged: linear stability is computed up to {MAX_DELAY_SAMPLES} samples of delay, not "
            f"{slowest:g} (device.delay_samples); shorten the delay, or state a longer sample time"
        )
    if wall.stiffness_n_per_m == 0:
        people = with_released(hand_corners(problem.hands))
        most = damping_range(device, people, softest_wall_n_per_m(device)).highest_ns_per_m
        if wall.damping_ns_per_m > most:
            return (
                f"a damper above {most:.3g} is not linearly stable with every hand and released, and "
                f"{wall.damping_ns_per_m:g} are wanted (environment.damping_ns_per_m): ask "
                "for less"
            )
    if problem.detent is not None:
        passed, sentence, advice, _ = detent_verdict(problem)
        if not passed:
            return f"whatever the coupling, {sentence}; {advice}"
    return ""


def nothing_rendered(problem: Problem, felt_n_per_m: float, trial: CouplingTrial) -> str:
    """Return why nothing of the wall is rendered to a hand; empty where something is."""
    device, press_n = problem.device, PRESS_N * problem.device.metres_per_unit
    # A robot that no hand holds is not pressed.
    if problem.environment.stiffness_n_per_m == 0 or not max(problem.hands.stiffness_n_per_m):
        return ""
    step, friction_n, most_n = device.encoder_resolution_m, device.coulomb_friction_n, press_n
    advice = "check the units of these values"
    most = f"a press of {press_n:.3g}"
    if device.max_force_n is not None and device.max_force_n < press_n:
        most_n = device.max_force_n
        most = f"the force limit (device.max_force_n, {most_n:g})"
    if felt_n_per_m * step > most_n:
        encoder = f"the encoder (device.encoder_resolution_m, {step:g})"
        what = f"one step of {encoder} asks for more than {most}"
    elif np.isfinite(trial.stiffness):
        return ""
    elif trial.at_force_limit.any():
        what = f"every press ends at the force limit (device.max_force_n, {device.max_force_n:g})"
        advice = "check its unit, or state [hands] that press less"
    elif friction_n >= most_n:
        held = f"dry friction (device.coulomb_friction_n, {friction_n:g})"
        what = f"no press ends in contact, for {held} is no less than {most}"
    else:
        what = f"no press ends in contact (device.encoder_resolution_m is {step:g})"
    return f"nothing of the wall is rendered: {what}; {advice}"


def assumed(problem: Problem, coupling: Coupling | None = None, *, devices: int = 1) -> tuple[str, ...]:
    """Return the assumptions."""
    gaps = ["hands are linear, on one axis, and constant while they hold on"]
    of: dict[str, Device] = {"": problem.device}
    if problem.follower is not None:
        of = {"leader: ": problem.device, "follower: ": problem.follower}
    for who, device in of.items():
        gaps += [f"{who}{gap}" for gap in _ideal(device)]
    if problem.detent is not None:
        gaps.append("the trial has no detents: their slopes are judged in the claims, and avc simulate has them")
    for who, device in of.items():
        gaps += [f"{who}{gap}" for gap in _of_trials(device, friction=problem.follower is None)]
    linear, rest = _ranges(problem)
    at = "trial at nominal" if devices == 1 else f"trial at nominal, and by others at {devices} devices of the ranges"
    gaps += [f"{key}: linear stability at its corners, {at}" for key in linear]
    gaps += [f"{key}: {at}; no part of linear stability" for key in rest]
    if coupling is not None:
        gaps += _outside(coupling)
    gaps += [f"{SLIP}{doubt.key} {doubt.message}" for doubt in plausibility(problem)]
    return tuple(gaps)


def _ideal(device: Device) -> list[str]:
    """Return the assumptions on amplifier and structure."""
    if device.amplifier_bandwidth_hz is None and device.resonance is None:
        return ["amplifier and structure are ideal: no bandwidth and no resonance is declared"]
    if device.amplifier_bandwidth_hz is None:
        return ["the amplifier is ideal: no bandwidth is declared"]
    return ["the structure is rigid: no resonance is declared"] if device.resonance is None else []


def _of_trials(device: Device, *, friction: bool) -> list[str]:
    """Return the assumptions that concern trials alone."""
    gaps = []
    if friction and device.coulomb_friction_n == 0 and device.range.coulomb_friction_n is None:
        gaps.append("no dry friction is declared: none is assumed, the cautious end")
    if device.encoder_resolution_m == 0 and device.range.encoder_resolution_m is None:
        gaps.append("no encoder resolution is declared: the position is taken as exact, the ideal end")
    if device.max_force_n is None:
        gaps.append("no force limit is declared: any force is taken as given")
    return gaps


def _ranges(problem: Problem) -> tuple[list[str], list[str]]:
    """Return the declared ranges that linear stability is judged over, and those used in simulation alone."""
    keys = [key for key in declared(problem) if key.startswith(_RANGE) and key not in _not_simulated(problem)]
    if problem.follower is not None:
        far = problem.model_copy(update={"device": problem.follower.at_leader()})
        keys += [key.replace("device", "follower", 1) for key in declared(far) if key.startswith(_RANGE)]
        keys = [key for key in keys if key.rpartition(".")[2] not in _NOT_OF_TELEOPERATORS]
    linear = [key for key in keys if key.partition(".range.")[2] in LINEAR_KEYS]
    return linear, [key for key in keys if key not in linear]


def _outside(coupling: Coupling) -> list[str]:
    """Return where gains leave the gain box stated in [coupling]."""
    box, gains, device = coupling.problem.coupling, coupling.table.gains, coupling.problem.device
    # Defaults, where the file of a rotary device states none.
    usual = defaults_at(GainBox, device.metres_per_unit) if device.motion == "rotary" else {}
    given = {key: getattr(box, key) for key in box.model_fields_set}
    stated = (_ANY if given.get(key) in {None, usual.get(key)} else given[key] for key in _BOX)
    left = [
        f"{symbol} of {outside[np.argmax(np.abs(outside - low))]:.4g} lies outside [{low:g}, {high:g}]"
        for symbol, (low, high), values in zip(("b", "k", "b_p"), stated, gains, strict=True)
        if len(outside := values[(values < low) | (values > high)])
    ]
    if not left:
        return []
    return [f"the gain box of [coupling] does not bound what is recommended: {' and '.join(left)}"]


def _not_simulated(problem: Problem) -> set[str]:
    """Return the declared keys without effect with an encoder at the handle: play is between it and the motor."""
    device = problem.device
    at_handle = device.encoder_at == "handle" and device.resonance is not None
    return {"device.backlash_m", "device.range.backlash_m"} if at_handle else set()


def _far_end(problem: Problem) -> str:
    """Return the table of the remote end that replaces the wall; empty where there is none."""
    return "simulation" if problem.simulation is not None else "follower" if problem.follower is not None else ""


def _band_stated(problem: Problem) -> bool:
    """Return whether [frequency] asks for another band than the default, which ends lower for a slow device."""
    ends = (Frequency(), Frequency(stop_hz=BELOW_NYQUIST / problem.device.sample_time_s))
    return problem.frequency not in ends


def _of_walls(problem: Problem) -> list[str]:
    """Return the tables beside another end that concern a wall in the device's own loop alone."""
    wall = problem.environment
    bare = type(problem)(
        device=problem.device,
        environment=wall,
        simulation=problem.simulation,
        follower=problem.follower,
        frequency=problem.frequency,
    )
    found = ["environment"] if wall.stiffness_n_per_m or wall.damping_ns_per_m else []
    found += [key for key in _WALLS if getattr(problem, key) != getattr(bare, key)]
    found += ["frequency"] if _band_stated(problem) else []
    reason = f"of a wall in the device's own loop: leave [{_far_end(problem)}] out for it"
    told = [f"{key} ({reason})" for key in found]
    if problem.scene != bare.scene:
        where = "of avc simulate alone" if problem.follower is None else "of avc simulate, which knows no [follower]"
        told.append(f"scene ({where})")
    return told


def _of_simulation(tool: VirtualTool | None) -> list[str]:
    """Return the keys of a [simulation] without effect beside its others."""
    if tool is None:
        return []
    default, keys, why = (
        VirtualTool(step_s=tool.step_s),
        ["contact_damping_ns_per_m"],
        "of a spring, and none is touched",
    )
    if tool.tool_mass_kg is None:
        keys += ["tool_damping_ns_per_m", "integrator", "contact_stiffness_n_per_m"]
        why = "of a tool, and no tool_mass_kg is given"
    elif any(0 < one < RIGID_N_PER_M for one in tool.contact_stiffness_n_per_m):
        return []
    return [f"simulation.{key} ({why})" for key in keys if getattr(tool, key) != getattr(default, key)]


def _of_teleoperator(problem: Problem) -> list[str]:
    """Return the keys of leader and follower that neither loop nor trial of a teleoperator has."""
    if problem.follower is None:
        return []
    return [
        f"{table}.{key} (the trial of a teleoperator has none)"
        for table, device in (("device", problem.device), ("follower", problem.follower))
        for key in _NOT_OF_TELEOPERATORS
        if getattr(device, key) > 0 or getattr(device.range, key) is not None
    ]


def not_used(problem: Problem) -> tuple[str, ...]:
    """Return the declared keys that no candidate, certificate or trial uses."""
    unseen = [key for key in declared(problem) if key in _not_simulated(problem)]
    unused = [f"{key} (not seen by an encoder at the handle)" for key in unseen]
    simulated = {effect.kind for effect in declared_effects(problem)}
    listed = [
        effect.kind
        for effect in problem.scene.effects
        if EFFECTS[effect.kind].scene_alone and effect.kind not in simulated
    ]
    if _far_end(problem):
        unused += [*_of_walls(problem), *_of_simulation(problem.simulation), *_of_teleoperator(problem)]
    else:
        bounds, wall = problem.boundaries, problem.environment
        asked = (
            ("boundaries", not bounds.upper == bounds.lower == wall),
            ("stability", problem.stability != Stability()),
            ("realism", problem.realism != Realism()),
            ("schedule", problem.schedule != ScheduleSettings()),
            ("frequency", _band_stated(problem)),
        )
        unused += [f"{table}{_OF_SOLVE}" for table, stated in asked if stated]
    known = {"velocity-filter": "known to avc simulate and avc zwidth alone"}
    return (
        *unused,
        *(f"scene.effects: {kind} ({known.get(kind, 'simulated by avc simulate alone')})" for kind in listed),
    )


def not_judged(unused: Sequence[str]) -> list[str]:
    """Return the entries of `not_used` that weaken a verdict: what is asked of other methods does not."""
    return [what for what in unused if not what.endswith(_OF_SOLVE)]


def asked_of_others(unused: Sequence[str]) -> list[str]:
    """Return one sentence on the tables by which other methods are asked; none where there are none."""
    tables = [what.removesuffix(_OF_SOLVE) for what in unused if what.endswith(_OF_SOLVE)]
    return [f"{', '.join(tables)}: asked of avc solve, not of avc recommend"] if tables else []
