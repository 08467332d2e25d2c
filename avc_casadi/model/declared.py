"""What a problem declares of its device, and the effects that its scene simulates."""

from __future__ import annotations

from functools import singledispatch

from avc_casadi.model import EFFECTS
from avc_casadi.model import effects as e
from avc_casadi.model.ends import End, Simulation, ToolGains
from avc_casadi.model.problem import Problem


def declared(problem: Problem) -> tuple[str, ...]:
    """Return the keys by which the device is more than a mass with a damper, exactly known and without delay."""
    device = problem.device
    stated = {"motion", "handle_radius_m", "mass_kg", "damping_ns_per_m", "sample_time_s", "held", "range"}
    # These have no effect alone.
    lag = {"amplifier_damping_ratio"} if device.amplifier_order == 1 else set()
    idle = {"amplifier_order", "amplifier_damping_ratio"} if device.amplifier_bandwidth_hz is None else lag
    idle |= {"encoder_at"} if device.resonance is None else set()
    keys = [
        f"device.{key}"
        for key, field in type(device).model_fields.items()
        if key not in stated | idle and getattr(device, key) != field.default
    ]
    keys += [f"device.range.{key}" for key, ends in device.range if key not in {"resonance", *lag} and ends]
    keys += [f"device.range.resonance.{key}" for key, ends in device.range.resonance if ends]
    return (*keys, "detent") if problem.detent is not None else tuple(keys)


@singledispatch
def end_effect(end: End) -> e.Effect:  # noqa: ARG001 - of what a scene has no effect of its own it has the wall alone
    """Return the scene table of an end."""
    return e.WallEffect()


@end_effect.register
def _simulation_effect(end: Simulation) -> e.Effect:  # noqa: ARG001
    return e.SimulationEffect()


def declared_effects(problem: Problem) -> tuple[e.Effect, ...]:
    """Return the scene tables of a hand, a wall or a simulation, and all that the device declares."""
    device = problem.device
    at_handle = device.encoder_at == "handle" and device.resonance is not None
    candidates: list[tuple[bool, e.Effect]] = [
        (True, e.HandEffect()),
        (True, end_effect(problem.end)),
        (problem.detent is not None, e.DetentEffect()),
        (device.resonance is not None, e.ResonanceEffect()),
        (device.coulomb_friction_n > 0, e.CoulombFrictionEffect()),
        (device.backlash_m > 0 and not at_handle, e.BacklashEffect()),
        (device.position_noise_rms_m > 0, e.NoiseEffect()),
        (device.encoder_resolution_m > 0 or at_handle, e.EncoderEffect()),
        (device.delay_samples > 0, e.DelayEffect()),
        (device.max_force_n is not None, e.SaturationEffect()),
        (device.amplifier_bandwidth_hz is not None, e.AmplifierEffect()),
    ]
    return tuple(effect for declares, effect in candidates if declares)


def scene_effects(problem: Problem) -> tuple[e.Effect, ...]:
    """Return the effects that a scene lists, or if it lists none all declared ones."""
    return problem.scene.effects or declared_effects(problem)


def with_law_alone(problem: Problem) -> Problem:
    """Return the problem with a scene in which its law acts in place of wall and coupling."""
    surroundings = (e.WallEffect, e.EnvironmentEffect, e.LawEffect)
    kept = tuple(effect for effect in scene_effects(problem) if not isinstance(effect, surroundings))
    kept = tuple(effect for effect in kept if not EFFECTS[effect.kind].of_coupling)
    return problem.changed(scene={"effects": (*kept, e.LawEffect()), "coupling": "none"})


def with_gains(problem: Problem, gains: ToolGains) -> Problem:
    """Return the problem with a scene in which the engine is joined to the device by these gains."""
    joined = tuple(
        effect.model_copy(update=vars(gains))
        if isinstance(effect, e.SimulationEffect) and not effect.stiffness_n_per_m
        else effect
        for effect in scene_effects(problem)
    )
    return problem.changed(scene={"effects": joined, "coupling": "none"})


def left_out(problem: Problem) -> tuple[str, ...]:
    """Return the kinds of declared effects that a scene with a list of effects does not simulate.

    An effect of the list replaces a declared one of the same role, such as another hand; that is not left out.
    """
    listed = {effect.kind for effect in scene_effects(problem)}
    roles = {EFFECTS[kind].role for kind in listed} - {""}
    return tuple(
        effect.kind
        for effect in declared_effects(problem)
        if effect.kind not in listed and EFFECTS[effect.kind].role not in roles
    )


_OF_OTHER_TABLES = ("hand", "wall", "environment", "simulation")
"""Effects that stand for [hands], [environment] and [simulation], where they have no value of their own."""
_DEVICE_KEYS = {
    "encoder": {"resolution_m": "encoder_resolution_m", "at": "encoder_at"},
    "amplifier": {
        "bandwidth_hz": "amplifier_bandwidth_hz",
        "order": "amplifier_order",
        "damping_ratio": "amplifier_damping_ratio",
    },
}
"""Keys of the device that a scene's table gives anew, of effects that do not name them themselves."""


def effects_of_scene_alone(problem: Problem) -> tuple[str, ...]:
    """Return the effects of the scene that no other table states, each with its keys that differ from these."""
    known = {effect.kind for effect in declared_effects(problem)} | {*_OF_OTHER_TABLES}
    names = []
    for effect in problem.scene.effects:
        values = _own_values(problem, effect)
        if effect.kind not in known:
            names.append(f"scene.effects: {effect.kind}")
        elif values:
            names.append(f"scene.effects: {effect.kind} ({', '.join(values)})")
    return tuple(dict.fromkeys(names))


def _own_values(problem: Problem, effect: e.Effect) -> list[str]:
    """Return the keys of an effect that are stated and differ from those of the device."""
    device = problem.device
    sources = {**EFFECTS[effect.kind].device_keys, **_DEVICE_KEYS.get(effect.kind, {})}
    stated = sorted(effect.model_fields_set - {"kind"})

    def declared_value(key: str) -> object:
        if effect.kind == "resonance":
            return getattr(device.resonance, key, None)
        return getattr(device, sources[key]) if sources.get(key) else None

    differing = [key for key in stated if getattr(effect, key) not in (None, declared_value(key))]
    return [problem.units.key(key) for key in differing]
