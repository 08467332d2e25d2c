"""From the effects of a problem file to scene effects in the order of the loop."""

from __future__ import annotations

from collections import Counter
from itertools import combinations

from avc_casadi._errors import Fault, InputError
from avc_casadi.model import EFFECTS
from avc_casadi.model.plant import HANDLE
from avc_casadi.model.problem import Problem
from avc_casadi.model.scene import scene_effects
from avc_casadi.simulation.effects.base import SceneEffect
from avc_casadi.simulation.effects.filters import VelocityFilter
from avc_casadi.simulation.effects.mechanics import Backlash
from avc_casadi.simulation.effects.sensing import Delay, Jitter
from avc_casadi.simulation.effects.virtual_tool import Engine


def build_effects(problem: Problem) -> tuple[SceneEffect, ...]:
    """Return the effects of a problem's scene, in the order of the loop; with none listed, all declared ones."""
    tables = scene_effects(problem)
    faults = _impossible(problem, [table.kind for table in tables])
    built: list[SceneEffect] = []
    for index, table in enumerate(tables):
        try:
            built.append(EFFECTS[table.kind].build(table, problem, f"scene.effects[{index}]"))
        except InputError as error:
            faults.extend(error.faults)
    faults.extend(_clashes(problem, built))
    if faults:
        raise InputError(faults)
    return tuple(sorted(built, key=lambda effect: effect.rank))


def _impossible(problem: Problem, kinds: list[str]) -> list[Fault]:
    messages = [f"{kind} is listed {count} times; allowed: once" for kind, count in Counter(kinds).items() if count > 1]
    messages += [
        f"{one} and {other} exclude each other; allowed: one of them"
        for one, other in combinations(sorted(set(kinds), key=list(EFFECTS).index), 2)
        if EFFECTS[one].role and EFFECTS[one].role == EFFECTS[other].role
    ]
    carried = problem.device.mass_kg > 0 or "hand" in kinds
    if not carried:
        messages.append("nothing has a mass; allowed: device.mass_kg above 0, or the effect hand with a mass")
    return [Fault(problem.name, None, "scene.effects", message) for message in messages]


def _clashes(problem: Problem, built: list[SceneEffect]) -> list[Fault]:
    """Return errors of effects with incompatible numbers."""
    messages = []
    delays = [effect.samples for effect in built if isinstance(effect, Delay)]
    late = any(isinstance(effect, Jitter) and effect.rms_s > 0 for effect in built)
    if late and any(samples != int(samples) for samples in delays):
        messages.append(
            f"delay of {delays[0]:g} samples and forces that come late at random exclude each other; allowed: whole "
            "samples, or jitter with rms_s = 0"
        )
    filtered = any(isinstance(effect, VelocityFilter) for effect in built)
    if filtered and any(isinstance(effect, Engine) for effect in built):
        messages.append("the engine of simulation sees plain differences; allowed: leave velocity-filter out")
    if any(isinstance(effect, Backlash) for effect in built) and any(effect.sensed_body == HANDLE for effect in built):
        messages.append("backlash and an encoder at the handle exclude each other; allowed: one of them")
    return [Fault(problem.name, None, "scene.effects", message) for message in messages]
