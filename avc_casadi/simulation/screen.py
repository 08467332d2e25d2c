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
DEFAULT_TOLERANCE = 0.01


@dataclass(frozen=True)
class EffectCost:
    """Cost of one effect: the scene with it less the scene without it; None of the only mass."""

    kind: str
    station: str
    states: int
    instructions: int | None = None
    ns_per_step: float | None = None


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
        return {**vars(self), "effects": [vars(effect) for effect in self.effects]}


def explain(problem: Problem, gains: AnyGains) -> Explanation:
    """Return the cost of each effect of a scene."""
    problem = staged(problem, gains)
    effects, chosen, _ = settled(problem, build_effects(problem), gains)
    return _explain(problem, effects, chosen)


def _explain(problem: Problem, effects: tuple[SceneEffect, ...], gains: Gains) -> Explanation:
    scene = compile_for(problem, effects, gains)
    times_ns = _times_ns(scene, gains)
    costs = []
    for effect in effects:
        kind, station = effect.kind, effect.station.name.lower()
        try:
            rest = compile_for(problem, without(effects, kind), gains)
        except InputError:  # the only mass
            costs.append(EffectCost(kind, station, scene.states_of(kind)))
            continue
        states, instructions = len(scene.states) - len(rest.states), scene.instructions - rest.instructions
        took_ns = min(times_ns) - min(_times_ns(rest, gains))
        costs.append(EffectCost(kind, station, states, instructions, took_ns))
    return Explanation(
        effects=tuple(costs),
        absent=tuple(kind for kind in EFFECTS if kind not in {effect.kind for effect in effects}),
        states=len(scene.states),
        state_names=scene.states,
        instructions=scene.instructions,
        ns_per_step=min(times_ns),
        scatter_ns=float(np.median(times_ns)) - min(times_ns),
    )


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

    def document(self) -> dict[str, Any]:
        """Return JSON values."""
        found: dict[str, Any] = plain(vars(self))
        return found


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
        rows = [vars(found) | {"effect": cost.kind, "instructions": cost.instructions} for found, cost in self.effects]
        changes = ("position_change", "force_change", "stiffness_change")
        keys = ("effect", *changes, "outcome", "outcome_changed", "needed", "instructions")
        return {key: np.array([np.nan if row[key] is None else row[key] for row in rows]) for key in keys}

    def _summary(self) -> str:
        whole = self.whole
        what = f"not needed: {', '.join(self.unneeded)}" if self.unneeded else "all effects are needed"
        return f"{whole.problem!r}, coupling {whole.coupling}, tolerance {100 * self.tolerance:g} %: {what}"

    @property
    def unneeded(self) -> tuple[str, ...]:
        """Effects that the scene does not need at this tolerance."""
        return tuple(cost.kind for found, cost in self.effects if not found.needed)

    def document(self) -> dict[str, Any]:
        """Return the JSON document."""
        effects = []
        for found, cost in self.effects:
            changes = {key: value for key, value in found.document().items() if key != "kinds"}
            effects.append({key: value for key, value in vars(cost).items() if key != "station"} | changes)
        return {
            "problem": self.whole.problem,
            "coupling": self.whole.coupling,
            "tolerance": self.tolerance,
            "outcome": self.whole.claim,
            "effects": effects,
            "essential": list(self.essential),
            "unneeded": list(self.unneeded),
            "scatter_ns": self.scatter_ns,
            "together": self.together and self.together.document(),
        }


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
    explained = _explain(problem, effects, chosen)

    def dropped(kinds: tuple[str, ...]) -> Screened:
        rest = tuple(effect for effect in effects if effect.kind not in kinds)
        return _compare(whole, simulate_effects(problem, rest, chosen, coupling), kinds, tolerance)

    found, essential = [], []
    for done, cost in enumerate(explained.effects):
        progress.advance(done, len(explained.effects), f"effects, without {cost.kind}")
        try:
            found.append((dropped((cost.kind,)), cost))
        except InputError:  # the only mass
            essential.append(cost.kind)
    found.sort(key=lambda one: (not one[0].outcome_changed, -one[0].change))
    unneeded = tuple(cost.kind for one, cost in found if not one.needed)
    together = dropped(unneeded) if unneeded else None
    return Screening(tolerance, whole, tuple(found), tuple(essential), together, explained.scatter_ns)


def _compare(whole: Run, rest: Run, kinds: tuple[str, ...], tolerance: float) -> Screened:
    position = _relative(whole.position_m - whole.position_m[0], rest.position_m - rest.position_m[0])
    force = _relative(whole.force_n, rest.force_n)
    one, other = whole.apparent_stiffness_n_per_m, rest.apparent_stiffness_n_per_m
    stiffness = abs(other / one - 1) if np.isfinite(one) and np.isfinite(other) else None
    changed = bool((rest.claim, rest.buzzing) != (whole.claim, whole.buzzing) or np.isfinite(one) != np.isfinite(other))
    needed = changed or not max(position, force, stiffness or 0.0) <= tolerance
    return Screened(kinds, position, force, stiffness, rest.claim, changed, needed)


def _relative(whole: FloatArray, rest: FloatArray) -> float:
    """Return the rms of the difference as a share of the rms of the whole; infinite where that is 0."""
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        difference, size = np.sqrt(np.mean((rest - whole) ** 2)), np.sqrt(np.mean(whole**2))
        return 0.0 if difference == 0 else float(np.divide(difference, size))
