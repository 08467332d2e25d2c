"""Cost of each effect of a scene (states, instructions, time), and which ones it needs: each is left out in turn."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._errors import InputError
from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.json_values import plain
from avc_casadi._util.printed import Columns, Tabular
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.model.gains import Gains
from avc_casadi.model.registries import EFFECTS
from avc_casadi.simulation.compile import CompiledScene
from avc_casadi.simulation.effects.base import SceneEffect
from avc_casadi.simulation.effects.registry import build_effects
from avc_casadi.simulation.run import Run
from avc_casadi.simulation.scene import AnyGains, compile_for, settled, simulate_effects, staged, without

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem


# About so many instructions are timed, in a few repeats of so many samples.
_TIMED_INSTRUCTIONS = 2_000_000
_TIMED_SAMPLES = (50, 2000)
_REPEATS = 9


@dataclass(frozen=True)
class EffectCost:
    """Cost of one effect: the scene with it less the scene without it."""

    kind: str
    station: str
    states: int
    instructions: int | None
    ns_per_step: float | None


@dataclass(frozen=True)
class Explanation:
    """Composition of a scene."""

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
            "state_names": [*self.state_names],
            "instructions": self.instructions,
            "ns_per_step": self.ns_per_step,
            "scatter_ns": self.scatter_ns,
        }


def explain(problem: Problem, gains: AnyGains) -> Explanation:
    """Return the cost of each effect of a scene."""
    problem = staged(problem, gains)
    effects, chosen, _ = settled(problem, build_effects(problem), gains)
    return explain_effects(problem, effects, chosen)


def explain_effects(problem: Problem, effects: tuple[SceneEffect, ...], gains: Gains) -> Explanation:
    """Return the cost of each resolved effect."""
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


DEFAULT_TOLERANCE = 0.01
_CHANGES = ("position_change", "force_change", "stiffness_change", "outcome", "outcome_changed", "needed")


@dataclass(frozen=True)
class Screened:
    """Change of a scene without some of its effects."""

    kinds: tuple[str, ...]
    position_change: float
    force_change: float
    stiffness_change: float | None
    outcome: str
    outcome_changed: bool
    needed: bool

    @property
    def change(self) -> float:
        """The largest of the changes."""
        return max(self.position_change, self.force_change, self.stiffness_change or 0.0)


@dataclass(frozen=True, eq=False, repr=False)
class Screening(Tabular):
    """Effects by the change that they make; together those that the scene does not need."""

    tolerance: float
    whole: Run
    effects: tuple[tuple[Screened, EffectCost], ...]
    essential: tuple[str, ...]
    together: Screened | None
    scatter_ns: float

    def to_dict(self) -> Columns:
        """Return the effects as columns, a row for each that can be left out."""
        found = [{"effect": one.kinds[0]} | _changes(one) for one, _ in self.effects]
        columns = {
            name: np.array([np.nan if row[name] is None else row[name] for row in found])
            for name in ("effect", *_CHANGES)
        }
        return columns | {"instructions": np.array([cost.instructions for _, cost in self.effects], dtype=float)}

    def _summary(self) -> str:
        whole = self.whole
        what = f"not needed: {', '.join(self.unneeded)}" if self.unneeded else "all effects are needed"
        return f"{whole.problem!r}, coupling {whole.coupling}, tolerance {100 * self.tolerance:g} %: {what}"

    @property
    def unneeded(self) -> tuple[str, ...]:
        """Effects that the scene does not need at this tolerance."""
        return tuple(found.kinds[0] for found, _ in self.effects if not found.needed)

    def document(self) -> dict[str, Any]:
        """Return the JSON document."""
        return {
            "problem": self.whole.problem,
            "coupling": self.whole.coupling,
            "tolerance": self.tolerance,
            "outcome": self.whole.claim,
            "effects": [
                {"kind": found.kinds[0]}
                | _changes(found)
                | {
                    "states": cost.states,
                    "instructions": cost.instructions,
                    "ns_per_step": cost.ns_per_step,
                }
                for found, cost in self.effects
            ],
            "essential": list(self.essential),
            "unneeded": list(self.unneeded),
            "scatter_ns": self.scatter_ns,
            "together": None if self.together is None else {"kinds": self.together.kinds} | _changes(self.together),
        }


def _changes(found: Screened) -> dict[str, Any]:
    changes: dict[str, Any] = plain({name: getattr(found, name) for name in _CHANGES})
    return changes


def screen(
    problem: Problem,
    gains: AnyGains,
    *,
    tolerance: float = DEFAULT_TOLERANCE,
    progress: Progress = SILENT,
) -> Screening:
    """Leave out each effect of a scene in turn, then all that it does not need together."""
    if not 0 <= tolerance < 1:
        raise InputError.of(f"is {tolerance:g}; allowed: 0 or more and below 1", key="tolerance")
    problem = staged(problem, gains)
    effects, chosen, coupling = settled(problem, build_effects(problem), gains)
    whole = simulate_effects(problem, effects, chosen, coupling)
    explained = explain_effects(problem, effects, chosen)
    costs = {cost.kind: cost for cost in explained.effects}

    def dropped(kinds: tuple[str, ...]) -> Screened:
        rest = tuple(effect for effect in effects if effect.kind not in kinds)
        return _compare(whole, simulate_effects(problem, rest, chosen, coupling), kinds, tolerance)

    found, essential = [], []
    for done, kind in enumerate(costs):
        progress.advance(done, len(costs), f"effects, without {kind}")
        try:
            found.append(dropped((kind,)))
        except InputError:  # the only mass
            essential.append(kind)
    found.sort(key=lambda one: (not one.outcome_changed, -one.change))
    unneeded = tuple(one.kinds[0] for one in found if not one.needed)
    return Screening(
        tolerance=tolerance,
        whole=whole,
        effects=tuple((one, costs[one.kinds[0]]) for one in found),
        essential=tuple(essential),
        together=dropped(unneeded) if unneeded else None,
        scatter_ns=explained.scatter_ns,
    )


def _compare(whole: Run, rest: Run, kinds: tuple[str, ...], tolerance: float) -> Screened:
    position = _relative(whole.position_m - whole.position_m[0], rest.position_m - rest.position_m[0])
    force = _relative(whole.force_n, rest.force_n)
    one, other = whole.apparent_stiffness_n_per_m, rest.apparent_stiffness_n_per_m
    stiffness = abs(other / one - 1) if np.isfinite(one) and np.isfinite(other) else None
    changed = bool((rest.claim, rest.buzzing) != (whole.claim, whole.buzzing) or np.isfinite(one) != np.isfinite(other))
    largest = max(position, force, stiffness or 0.0)
    return Screened(
        kinds=kinds,
        position_change=position,
        force_change=force,
        stiffness_change=stiffness,
        outcome=rest.claim,
        outcome_changed=changed,
        needed=changed or not largest <= tolerance,
    )


def _relative(whole: FloatArray, rest: FloatArray) -> float:
    """Return the rms of the difference as a share of the rms of the whole; infinite where that is 0."""
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        difference, size = np.sqrt(np.mean((rest - whole) ** 2)), np.sqrt(np.mean(whole**2))
        return 0.0 if difference == 0 else float(np.divide(difference, size))
