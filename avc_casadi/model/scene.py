"""The scene of a problem file: motion of the hand's target, coupling and effects, listed or those declared."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BeforeValidator, Field, SerializeAsAny, ValidationError

from avc_casadi.model import EFFECTS, METHODS
from avc_casadi.model import effects as e
from avc_casadi.model import quantity as q
from avc_casadi.model import table as t
from avc_casadi.model.effects import Effect

if TYPE_CHECKING:
    from avc_casadi.model.ends import ToolGains
    from avc_casadi.model.problem import Problem


class _Motion(t.Table):
    """Motion of the hand's target along the axis of the device; the wall begins at 0 and lies at x > 0."""

    start_m: q.Position = -0.01
    end_m: q.Position = 0.01
    speed_m_per_s: q.Speed = 0.07


class Press(_Motion):
    """From start to end at constant speed, then stay."""

    kind: Literal["press"] = "press"


class Tap(_Motion):
    """To and fro between start and end."""

    kind: Literal["tap"] = "tap"
    frequency_hz: q.Hertz = 2.0
    rest_s: q.Span = 1.0


class Hold(_Motion):
    """Stay at the end from the beginning."""

    kind: Literal["hold"] = "hold"


class _Oscillation(_Motion):
    """Oscillation of the target."""

    kind: Any  # first, as in what is written
    frequency_hz: q.Hertz = 1.0
    amplitude_m: q.Amplitude = 0.005
    rest_s: q.Span = 1.0


class Stroke(_Oscillation):
    """From start to end at constant speed, then oscillate about the end."""

    kind: Literal["stroke"] = "stroke"


class Free(_Oscillation):
    """Oscillate about the start."""

    kind: Literal["free"] = "free"


MOTIONS: dict[str, type[_Motion]] = {"press": Press, "tap": Tap, "hold": Hold, "stroke": Stroke, "free": Free}
Motion = Annotated[Press | Tap | Hold | Stroke | Free, Field(discriminator="kind")]


def coupling_name(value: Any) -> str:
    """Return the coupling of a scene, none or a method of the registry, or refuse it."""
    choices = ("none", *METHODS)
    if not isinstance(value, str) or value not in choices:
        raise t.refusal(f"is {t.shown(value)}; allowed: {t.one_of(choices, value)}")
    return value


def _effects(value: Any) -> tuple[Any, ...]:
    """Return the effects of a scene, each read by the keys of its kind; all faults are reported at once."""
    if not isinstance(value, list | tuple) or len(value) > 100:
        raise t.refusal(f"is {t.shown(value)}; allowed: one [[scene.effects]] for each effect, 100 at most")
    found: list[Any] = []
    faults: list[t.Finding] = []
    for index, one in enumerate(value):
        kind = one.get("kind") if isinstance(one, Mapping) else None
        if isinstance(one, Effect):
            found.append(one)
        elif not isinstance(one, Mapping):
            faults.append(((index,), f"is {t.shown(one)}, not a table; allowed: a table with kind"))
        elif not isinstance(kind, str) or kind not in EFFECTS:
            what = "is missing" if kind is None else f"is {t.shown(kind)}"
            faults.append(((index, "kind"), f"{what}; allowed: {t.one_of(EFFECTS, kind)}"))
        else:
            try:
                found.append(EFFECTS[kind].keys.model_validate(one))
            except ValidationError as error:
                faults += [((index, *path), message) for path, message in t.faults_of(error)]
    if faults:
        raise t.inner_faults(faults)
    return tuple(found)


class Scene(t.Table):
    """The simulated scene: motion of the hand's target, coupling and effects."""

    duration_s: q.Span = 3.0
    coupling: Annotated[str, BeforeValidator(coupling_name)] = "static"
    interaction_hz: q.Hertz | None = None
    integrator: Literal["exact", "projected"] = "exact"
    substeps: q.Substeps = 1
    motion: Motion = Press()
    effects: Annotated[tuple[SerializeAsAny[Effect], ...], BeforeValidator(_effects)] = ()


def declared(problem: Problem) -> tuple[str, ...]:
    """Return the keys by which the device is more than a mass with a damper, exactly known and without delay."""
    device = problem.device
    stated = {"motion", "handle_radius_m", "mass_kg", "damping_ns_per_m", "sample_time_s", "held", "range"}
    # These have no effect alone.
    lag = {"amplifier_damping_ratio"} if device.amplifier_order == 1 else set()
    idle = {"amplifier_order", "amplifier_damping_ratio"} if device.amplifier_bandwidth_hz is None else lag
    idle |= {"encoder_at"} if device.resonance is None else set()
    found = [
        f"device.{key}"
        for key, field in type(device).model_fields.items()
        if key not in stated | idle and getattr(device, key) != field.default
    ]
    found += [f"device.range.{key}" for key, ends in device.range if key not in {"resonance", *lag} and ends]
    found += [f"device.range.resonance.{key}" for key, ends in device.range.resonance if ends]
    return (*found, "detent") if problem.detent is not None else tuple(found)


def declared_effects(problem: Problem) -> tuple[e.Effect, ...]:
    """Return the scene tables of a hand, a wall or a simulation, and all that the device declares."""
    device = problem.device
    at_handle = device.encoder_at == "handle" and device.resonance is not None
    found: list[tuple[bool, e.Effect]] = [
        (True, e.HandEffect()),
        (problem.simulation is None, e.WallEffect()),
        (problem.simulation is not None, e.SimulationEffect()),
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
    return tuple(effect for there, effect in found if there)


def scene_effects(problem: Problem) -> tuple[e.Effect, ...]:
    """Return the effects that a scene lists, or if it lists none all declared ones."""
    return problem.scene.effects or declared_effects(problem)


def with_gains(problem: Problem, gains: ToolGains) -> Problem:
    """Return the problem with a scene in which the engine is joined to the device by these gains."""
    joined = tuple(
        one.model_copy(update=vars(gains)) if isinstance(one, e.SimulationEffect) and not one.stiffness_n_per_m else one
        for one in scene_effects(problem)
    )
    return problem.changed(scene={"effects": joined, "coupling": "none"})


def left_out(problem: Problem) -> tuple[str, ...]:
    """Return the kinds of declared effects that a scene with a list of effects does not simulate."""
    listed = {effect.kind for effect in scene_effects(problem)}
    roles = {EFFECTS[kind].role for kind in listed} - {""}
    return tuple(
        effect.kind
        for effect in declared_effects(problem)
        if effect.kind not in listed and EFFECTS[effect.kind].role not in roles
    )
