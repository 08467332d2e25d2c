"""Cost of each effect of a scene (states, instructions, time), and which ones it needs: each is left out in turn."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from numbers import Real
from typing import Any

import numpy as np

from avc_casadi._errors import InputError
from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.printed import Columns, Tabular
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.model import EFFECTS
from avc_casadi.model.gains import Gains
from avc_casadi.model.problem import Problem
from avc_casadi.model.table import shown
from avc_casadi.simulation.compile import CompiledScene, build_effects, compile_scene
from avc_casadi.simulation.scene import AnyGains, Run, resolve, simulate_effects, stage, without
from avc_casadi.simulation.tick import ca

_NS_PER_S = 1e9
TOLERANCE = 0.01
"""Share of the motion, of the force or of the stiffness by which an effect that is not needed may change it."""
_CHANGES = ("position_change", "force_change", "stiffness_change")


@dataclass(frozen=True)
class EffectCost:
    """What an effect adds to a sample of its scene: states, instructions and time.

    Attributes:
        kind: kind of the effect.
        station: where in the loop it acts.
        states: None, as are the others, where the scene needs the effect: its only mass, or the body of the encoder.
        instructions: instructions of a sample.
        ns_per_step: time of a sample, ns.
    """

    kind: str
    station: str
    states: int | None = None
    instructions: int | None = None
    ns_per_step: float | None = None


@dataclass(frozen=True)
class SceneCost:
    """What a scene is composed of, and the cost of each effect.

    Attributes:
        effects: the effects in the order of the loop.
        absent: kinds of effects that it leaves out.
        states: number of states of the whole.
        state_names: their names.
        instructions: instructions of a sample of the whole.
        ns_per_step: its time, ns: the least of a few.
        scatter_ns: median of that time, beyond the least.
    """

    effects: tuple[EffectCost, ...]
    absent: tuple[str, ...]
    states: int
    state_names: tuple[str, ...]
    instructions: int
    ns_per_step: float
    scatter_ns: float


def explain(problem: Problem, gains: AnyGains) -> SceneCost:
    """Return what a scene is composed of, and the cost of each effect: the scene less the scene without it."""
    problem = stage(problem, gains)
    effects, at_start, _ = resolve(problem, build_effects(problem), gains)
    scene = compile_scene(problem, effects, at_start)
    times_ns = _times_ns(scene, at_start)
    costs = []
    for effect in effects:
        station = effect.station.name.lower()
        try:
            rest = compile_scene(problem, without(effects, effect.kind), at_start)
        except InputError:  # the only mass, or the body of the encoder
            costs.append(EffectCost(effect.kind, station))
            continue
        costs.append(
            EffectCost(
                kind=effect.kind,
                station=station,
                states=len(scene.states) - len(rest.states),
                instructions=scene.instructions - rest.instructions,
                ns_per_step=min(times_ns) - min(_times_ns(rest, at_start)),
            )
        )
    present = {effect.kind for effect in effects}
    return SceneCost(
        effects=tuple(costs),
        absent=tuple(kind for kind in EFFECTS if kind not in present),
        states=len(scene.states),
        state_names=tuple(scene.states),
        instructions=scene.instructions,
        ns_per_step=min(times_ns),
        scatter_ns=float(np.median(times_ns)) - min(times_ns),
    )


def _times_ns(scene: CompiledScene, gains: Gains) -> list[float]:
    """Measure one sample in CasADi's loop a few times: processor times, ns."""
    samples = int(np.clip(2_000_000 // scene.instructions, 50, 2000))
    inputs = np.resize(scene.input_values(), (len(scene.inputs), samples))
    parameters = np.repeat(scene.parameter_values(gains)[:1].T, samples, axis=1)
    loop = scene.function.mapaccum("timed", samples)
    arguments = [ca.DM(scene.initial), ca.DM(inputs), ca.DM(parameters)]
    times_ns = []
    for _ in range(9):
        start = time.process_time()
        loop(*arguments)
        times_ns.append((time.process_time() - start) / samples * _NS_PER_S)
    return times_ns


@dataclass(frozen=True, eq=False, repr=False)
class Screening(Tabular):
    """Effects by the change that they make; together those that the scene does not need."""

    tolerance: float
    whole: Run
    effects: tuple[dict[str, Any], ...]
    essential: tuple[str, ...]
    together: dict[str, Any] | None
    scatter_ns: float

    def to_dict(self) -> Columns:
        """Return the effects as columns, a row for each that can be left out."""
        keys = (*_CHANGES, "outcome", "outcome_changed", "needed", "instructions")
        columns = {key: [np.nan if effect[key] is None else effect[key] for effect in self.effects] for key in keys}
        return {"effect": np.array([effect["kind"] for effect in self.effects])} | {
            key: np.array(column) for key, column in columns.items()
        }

    def _summary(self) -> str:
        whole = self.whole
        verdict = f"not needed: {', '.join(self.redundant)}" if self.redundant else "all effects are needed"
        return f"{whole.problem!r}, coupling {whole.coupling}, tolerance {100 * self.tolerance:g} %: {verdict}"

    @property
    def redundant(self) -> tuple[str, ...]:
        """Effects that the scene does not need at this tolerance."""
        return tuple(effect["kind"] for effect in self.effects if not effect["needed"])


def screen(
    problem: Problem, gains: AnyGains, *, tolerance: float = TOLERANCE, progress: Progress = SILENT
) -> Screening:
    """Leave out each effect of a scene in turn, then all that it does not need together."""
    if isinstance(tolerance, bool) or not isinstance(tolerance, Real) or not 0 <= tolerance < 1:
        raise InputError.of(f"is {shown(tolerance)}; allowed: 0 or more and below 1", key="tolerance")
    problem = stage(problem, gains)
    effects, at_start, coupling = resolve(problem, build_effects(problem), gains)
    whole = simulate_effects(problem, effects, at_start, coupling)
    costs = explain(problem, gains)

    def changes(kinds: tuple[str, ...]) -> dict[str, Any]:
        rest = tuple(effect for effect in effects if effect.kind not in kinds)
        return _compare(whole, simulate_effects(problem, rest, at_start, coupling), tolerance)

    rows, essential = [], []
    for place, cost in enumerate(costs.effects):
        progress.advance(place, len(costs.effects), f"effects, without {cost.kind}")
        try:
            known = {key: value for key, value in asdict(cost).items() if key != "station"}
            rows.append(known | changes((cost.kind,)))
        except InputError:  # the only mass
            essential.append(cost.kind)
    rows.sort(key=lambda row: (not row["outcome_changed"], -max(row[key] or 0.0 for key in _CHANGES)))
    redundant = tuple(row["kind"] for row in rows if not row["needed"])
    together = {"kinds": redundant, **changes(redundant)} if redundant else None
    return Screening(tolerance, whole, tuple(rows), tuple(essential), together, costs.scatter_ns)


def _compare(whole: Run, rest: Run, tolerance: float) -> dict[str, Any]:
    """Return the change of a scene without some of its effects."""
    position = _relative(whole.position_m - whole.position_m[0], rest.position_m - rest.position_m[0])
    force = _relative(whole.force_n, rest.force_n)
    before = whole.apparent_stiffness_n_per_m
    after = rest.apparent_stiffness_n_per_m
    touched, touches = np.isfinite(before), np.isfinite(after)
    stiffness = abs(after / before - 1) if touched and touches else None
    changed = bool((rest.claim, rest.buzzing) != (whole.claim, whole.buzzing) or touched != touches)
    needed = changed or not max(position, force, stiffness or 0.0) <= tolerance
    return {
        **dict(zip(_CHANGES, (position, force, stiffness), strict=True)),
        "outcome": rest.claim,
        "outcome_changed": changed,
        "needed": needed,
    }


def _relative(whole: FloatArray, rest: FloatArray) -> float:
    """Return the rms of the difference as a share of the rms of the whole; infinite where that is 0."""
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        difference, size = np.sqrt(np.mean((rest - whole) ** 2)), np.sqrt(np.mean(whole**2))
        return 0.0 if difference == 0 else float(np.divide(difference, size))
