"""From the effects of a problem file to scene effects in the order of the loop."""

from __future__ import annotations

from collections import Counter

from avc_casadi._errors import Fault, InputError, UnsupportedError
from avc_casadi.model.declared import scene_effects
from avc_casadi.model.plant import HANDLE
from avc_casadi.model.problem import Problem
from avc_casadi.simulation.effects.actuation import Amplifier, Saturation
from avc_casadi.simulation.effects.base import SceneEffect
from avc_casadi.simulation.effects.computation import Adaptation, Estimator, Guard, Observer, StateFeedback
from avc_casadi.simulation.effects.filters import Compensator, Notch, VelocityFilter
from avc_casadi.simulation.effects.hand import Grip, StylusGrip
from avc_casadi.simulation.effects.mechanics import Backlash, CoulombFriction, Resonance, ViscousFriction
from avc_casadi.simulation.effects.sensing import Delay, Encoder, Jitter, Noise
from avc_casadi.simulation.effects.wall import Detents, TwoSidedEnvironment, Wall

# Within a station, effects act in this order.
_EFFECTS: tuple[type[SceneEffect], ...] = (
    Resonance,
    ViscousFriction,
    CoulombFriction,
    Grip,
    StylusGrip,
    Backlash,
    Noise,
    Encoder,
    Observer,
    Notch,
    Compensator,
    StateFeedback,
    VelocityFilter,
    Estimator,
    Adaptation,
    Wall,
    TwoSidedEnvironment,
    Detents,
    Guard,
    Saturation,
    Delay,
    Jitter,
    Amplifier,
)
KINDS: tuple[str, ...] = tuple(effect.kind for effect in _EFFECTS)

_EITHER = (("hand", "stylus-hand"), ("wall", "environment"), ("observer", "state-feedback"))


def build_effects(problem: Problem) -> tuple[SceneEffect, ...]:
    """Settle the effects of a problem's scene, in the order of the loop; with none listed, all that is declared.

    Raises:
        InputError: impossible combinations and missing numbers, all at once.
        UnsupportedError: an effect that scenes do not simulate.
    """
    tables = scene_effects(problem)
    absent = [table.kind for table in tables if table.kind not in KINDS]
    if absent:
        raise UnsupportedError(
            f"{problem.name}: scene.effects: scenes do not simulate {', '.join(absent)}; they do: {', '.join(KINDS)}"
        )
    faults = _impossible(problem, [table.kind for table in tables])
    classes = {effect.kind: effect for effect in _EFFECTS}
    built: list[SceneEffect] = []
    for index, table in enumerate(tables):
        try:
            built.append(classes[table.kind].build(table, problem, f"scene.effects[{index}]"))
        except InputError as error:
            faults.extend(error.faults)
    faults.extend(_clashes(problem, built))
    if faults:
        raise InputError(faults)
    return tuple(sorted(built, key=lambda effect: KINDS.index(effect.kind)))


def _impossible(problem: Problem, kinds: list[str]) -> list[Fault]:
    messages = [f"{kind} is listed {count} times; allowed: once" for kind, count in Counter(kinds).items() if count > 1]
    messages += [
        f"{one} and {other} exclude each other; allowed: one of them"
        for one, other in _EITHER
        if one in kinds and other in kinds
    ]
    carried = problem.device.mass_kg > 0 or "hand" in kinds
    if not carried:
        messages.append("nothing has a mass; allowed: device.mass_kg above 0, or the effect hand with a mass")
    return [Fault(problem.name, None, "scene.effects", message) for message in messages]


def _clashes(problem: Problem, built: list[SceneEffect]) -> list[Fault]:
    """Effects whose numbers do not go together."""
    messages = []
    delays = [effect.samples for effect in built if isinstance(effect, Delay)]
    if any(samples != int(samples) for samples in delays) and any(isinstance(effect, Jitter) for effect in built):
        messages.append(
            f"delay of {delays[0]:g} samples and jitter exclude each other; allowed: whole samples, or no jitter"
        )
    if any(isinstance(effect, Backlash) for effect in built) and any(effect.sensed_body == HANDLE for effect in built):
        messages.append("backlash and an encoder at the handle exclude each other; allowed: one of them")
    return [Fault(problem.name, None, "scene.effects", message) for message in messages]
