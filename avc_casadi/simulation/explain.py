"""What a scene consists of and what each effect costs: states, instructions and time of one sample."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._errors import InputError
from avc_casadi.model.gains import Gains
from avc_casadi.model.registries import EFFECTS
from avc_casadi.simulation.compile import CompiledScene
from avc_casadi.simulation.effects.base import SceneEffect
from avc_casadi.simulation.effects.registry import build_effects
from avc_casadi.simulation.scene import AnyGains, compile_for, settled, staged, without

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem

# About so many instructions are timed, in a few repeats of so many samples.
_TIMED_INSTRUCTIONS = 2_000_000
_TIMED_SAMPLES = (50, 2000)
_REPEATS = 9


@dataclass(frozen=True)
class EffectCost:
    """What one effect adds: the scene with it less the scene without it.

    Attributes:
        kind: name of the effect.
        station: where in the loop it acts.
        states: states that it adds.
        instructions: instructions that it adds to a sample; None where the scene does not exist without it.
        ns_per_step: time that it adds to a sample in CasADi's evaluation; None in the same case. A cost below
            `Explanation.scatter_ns` is not told from none, and may come out negative.
    """

    kind: str
    station: str
    states: int
    instructions: int | None
    ns_per_step: float | None


@dataclass(frozen=True)
class Explanation:
    """What a scene consists of.

    Attributes:
        effects: what each listed effect adds, in the order of the loop.
        absent: kinds that are not listed and leave nothing behind.
        states: number of states of the whole sample.
        state_names: their names.
        instructions: number of instructions of the whole sample.
        ns_per_step: time of the whole sample.
        scatter_ns: by how much a time of the whole sample scatters: its median less its least.
    """

    effects: tuple[EffectCost, ...]
    absent: tuple[str, ...]
    states: int
    state_names: tuple[str, ...]
    instructions: int
    ns_per_step: float
    scatter_ns: float

    def document(self) -> dict[str, Any]:
        """Return the part of the JSON document."""
        return {
            "effects": [vars(effect) for effect in self.effects],
            "absent": list(self.absent),
            "states": self.states,
            "state_names": list(self.state_names),
            "instructions": self.instructions,
            "ns_per_step": self.ns_per_step,
            "scatter_ns": self.scatter_ns,
        }


def explain(problem: Problem, gains: AnyGains, *, interaction_hz: float | None = None) -> Explanation:
    """Say what each effect of a scene adds.

    Args:
        problem: a validated problem.
        gains: as in `simulate`.
        interaction_hz: as in `simulate`.
    """
    problem = staged(problem, gains)
    effects, chosen, _ = settled(problem, build_effects(problem), gains, interaction_hz)
    return explain_effects(problem, effects, chosen)


def explain_effects(problem: Problem, effects: tuple[SceneEffect, ...], gains: Gains) -> Explanation:
    """Say what each of the settled effects adds."""
    scene = compile_for(problem, effects, gains)
    times_ns = _times_ns(scene, gains)
    whole_ns = min(times_ns)
    costs = tuple(_cost(problem, effects, gains, effect, scene, whole_ns) for effect in effects)
    listed = {effect.kind for effect in effects}
    return Explanation(
        effects=costs,
        absent=tuple(kind for kind in EFFECTS if kind not in listed),
        states=len(scene.states),
        state_names=scene.states,
        instructions=scene.instructions,
        ns_per_step=whole_ns,
        scatter_ns=float(np.median(times_ns)) - whole_ns,
    )


def _cost(
    problem: Problem,
    effects: tuple[SceneEffect, ...],
    gains: Gains,
    effect: SceneEffect,
    scene: CompiledScene,
    whole_ns: float,
) -> EffectCost:
    station = effect.station.name.lower()
    try:
        rest = compile_for(problem, without(effects, effect.kind), gains)
    except InputError:  # the only mass
        return EffectCost(effect.kind, station, scene.states_of(effect.kind), None, None)
    return EffectCost(
        kind=effect.kind,
        station=station,
        states=len(scene.states) - len(rest.states),
        instructions=scene.instructions - rest.instructions,
        ns_per_step=whole_ns - ns_per_step(rest, gains),
    )


def ns_per_step(scene: CompiledScene, gains: Gains) -> float:
    """Measure one sample in CasADi's loop: processor time of the quickest of a few runs, ns."""
    return min(_times_ns(scene, gains))


def _times_ns(scene: CompiledScene, gains: Gains) -> list[float]:
    """Measure one sample in CasADi's loop a few times: processor times, ns."""
    import casadi as ca  # noqa: PLC0415

    samples = int(np.clip(_TIMED_INSTRUCTIONS // scene.instructions, *_TIMED_SAMPLES))
    inputs = np.resize(scene.input_values(), (len(scene.inputs), samples))
    parameters = np.repeat(scene.parameter_values(gains)[:1].T, samples, axis=1)
    loop = scene.function.mapaccum("timed", samples)
    arguments = [ca.DM(scene.initial), ca.DM(inputs), ca.DM(parameters)]
    times_ns = []
    for _ in range(_REPEATS):
        started = time.process_time()
        loop(*arguments)
        times_ns.append((time.process_time() - started) / samples * 1e9)
    return times_ns
