"""Simulating a scene, for one hand or for many; a run is saved as traces (npz) and a manifest (JSON)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path
from typing import Any, Literal

import numpy as np

from avc_casadi._errors import InputError
from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.files import write_file
from avc_casadi._util.json_values import json_text, plain, plain_table
from avc_casadi._util.printed import Columns, Tabular
from avc_casadi._util.units import LINEAR, Units
from avc_casadi.coupling import Coupling, check_sample_time, require_coupling, thinned
from avc_casadi.model import EFFECTS
from avc_casadi.model.declared import scene_effects
from avc_casadi.model.gains import NO_COUPLING, Gains, GainSchedule, GainTable, gains_at
from avc_casadi.model.hands import Hand, StylusHand
from avc_casadi.model.problem import Problem
from avc_casadi.model.table import shown
from avc_casadi.simulation.compile import CompiledScene, build_effects, compile_scene
from avc_casadi.simulation.effects.base import SceneEffect
from avc_casadi.simulation.effects.computation import Adaptation
from avc_casadi.simulation.effects.environment import Detents, SceneLaw
from avc_casadi.simulation.effects.mechanics import CoulombFriction, Grip
from avc_casadi.simulation.execute import execute
from avc_casadi.simulation.judge import DIVERGENCE_M, Judgement, Ledger, Traces, energy_ledger

Claim = Literal["asymptotic", "held-by-friction", "unstable"]

_HANDS_AT_ONCE = 256
"""Hands whose traces are in memory at a time."""

_CLAIMS: dict[Claim, str] = {
    "asymptotic": "settled, and does so without dry friction too",
    "held-by-friction": "settled only because of dry friction; without friction it does not",
    "unstable": "did not settle",
}


@dataclass(frozen=True, eq=False, repr=False)
class Run(Tabular):
    """A simulated scene: traces of shape (samples,), energies, and whether the device settles.

    Attributes:
        problem: name of the problem.
        coupling: method of the gains: none, static, ..., or given.
        effects: kinds of the effects that were simulated, in the order of the loop.
        sample_time_s: T.
        position_m: true position of the device.
        velocity_m_per_s: true velocity of the device.
        force_n: commanded force, held over a sample, positive against +x.
        tool_m: position of the virtual tool between coupling and environment.
        target_m: position of the hand's target.
        damping_ns_per_m: b; infinite for a rigid coupling.
        stiffness_n_per_m: k; infinite for a rigid coupling.
        contact_damping_ns_per_m: b_p.
        interaction_hz: estimated interaction frequency, not a number at rest; None without an estimator.
        ledger: energies.
        judgement: figures of the run.
        claim: ``asymptotic``, ``held-by-friction`` or ``unstable``.
        metres_per_unit: displacement of the hand for a unit of the position.
        units: names and units of the device.
        definition: the problem given to `simulate`, for ``print``; None of a run among many.
        request: gains, hand, frequency and seed given to `simulate`.
        notes: where the scene's own coupling is designed for another device than the one simulated.

    Example:
        >>> run = avc.simulate("scenes/stiff-wall-pressed")
        >>> f"{run.samples} samples of {run.sample_time_s} s, {run.claim}, {run.apparent_stiffness_n_per_m:.0f} N/m"
        '3000 samples of 0.001 s, asymptotic, 3844 N/m'
    """

    problem: str
    coupling: str
    effects: tuple[str, ...]
    sample_time_s: float
    position_m: FloatArray
    velocity_m_per_s: FloatArray
    force_n: FloatArray
    tool_m: FloatArray
    target_m: FloatArray
    damping_ns_per_m: FloatArray
    stiffness_n_per_m: FloatArray
    contact_damping_ns_per_m: FloatArray
    interaction_hz: FloatArray | None
    ledger: Ledger
    judgement: Judgement
    claim: Claim
    metres_per_unit: float = 1.0
    units: Units = LINEAR
    definition: Problem | None = None
    request: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def to_dict(self) -> Columns:
        """Return the traces against time as columns, each of shape (samples,)."""
        traces = ("time_s", "position_m", "velocity_m_per_s", "force_n", "tool_m", "target_m")
        gains = ("damping_ns_per_m", "stiffness_n_per_m", "contact_damping_ns_per_m")
        estimate = () if self.interaction_hz is None else ("interaction_hz",)
        return {name: getattr(self, name) for name in (*traces, *gains, *estimate)}

    def _summary(self) -> str:
        duration = self.samples * self.sample_time_s
        return f"{self.problem!r}, coupling {self.coupling}, {duration:g} s: {_CLAIMS[self.claim]}"

    @property
    def samples(self) -> int:
        """Number of samples."""
        return len(self.position_m)

    @property
    def time_s(self) -> FloatArray:
        """Times of the samples."""
        return np.arange(self.samples, dtype=np.float64) * np.float64(self.sample_time_s)

    @property
    def samples_in_reach(self) -> int:
        """Number of samples before the run leaves the workspace for good; all of them, unless it diverged."""
        beyond = ~(np.abs(self.position_m) < DIVERGENCE_M / self.metres_per_unit)
        return int(beyond.argmax()) if beyond.any() else self.samples

    @property
    def stable(self) -> bool:
        """Whether the device settled."""
        return bool(self.judgement.stable)

    @property
    def buzzing(self) -> bool:
        """Whether the force chatters."""
        return bool(self.judgement.buzzing)

    @property
    def apparent_stiffness_n_per_m(self) -> float:
        """Mean force over mean penetration at the end; not a number without contact."""
        return float(self.judgement.apparent_stiffness_n_per_m)

    @property
    def energy_generated_j(self) -> float:
        """Largest energy that the virtual side gave out beyond all that it had absorbed."""
        return float(0.0 - np.minimum(0.0, self.ledger.absorbed_j.min()))

    def certificate(self) -> dict[str, Any]:
        """Return the level L6: this time-varying run, with its energy ledger."""
        return {
            "pass": self.claim == "asymptotic",
            "margin_ns_per_m": None,
            "frequency_hz": None,
            "model": "sampled-data",
            "claim": f"simulated for {self.samples * self.sample_time_s:g} s: {_CLAIMS[self.claim]}",
            "outcome": self.claim,
            "energy_generated_j": plain(self.energy_generated_j),
        }

    def document(self, trace: Path | None = None) -> dict[str, Any]:
        """Return the JSON document; `trace` is the file of the traces."""
        judgement = self.judgement
        peaks = ("peak_velocity_m_per_s", "position_peak_to_peak_m", "mean_force_n", "force_ripple_n")
        stiffnesses = ("apparent_stiffness_n_per_m", "rate_hardness_n_per_m")
        document = {
            "problem": self.problem,
            "coupling": self.coupling,
            "damping_ns_per_m": self.damping_ns_per_m[0],
            "stiffness_n_per_m": self.stiffness_n_per_m[0],
            "contact_damping_ns_per_m": self.contact_damping_ns_per_m[0],
            "stable": self.stable,
            "outcome": self.claim,
            "diverged": bool(judgement.diverged),
            "buzzing": self.buzzing,
            "steps": self.samples,
            **{name: getattr(judgement, name) for name in (*peaks, *stiffnesses)},
            "energy_generated_j": self.energy_generated_j,
            "certificate": {"L6": self.certificate()},
            "trace": None if trace is None else str(trace),
        }
        return plain_table(document)

    def save(self, path: Path | str) -> Path:
        """Write the traces to `path` (npz) and the manifest beside it (the same name, ``.json``)."""
        target = Path(path).with_suffix(".npz")
        arrays = BytesIO()
        np.savez_compressed(
            arrays,
            **self.units.keyed(self.to_dict()),
            absorbed_j=self.ledger.absorbed_j,
            stored_j=self.ledger.stored_j,
            dissipated_j=self.ledger.dissipated_j,
        )
        text = json_text(self.document(target) | {"effects": list(self.effects)}, self.units)
        write_file(target, arrays.getvalue())
        write_file(target.with_suffix(".json"), text)
        return target


AnyGains = Coupling | Gains | GainTable | GainSchedule
"""Gains of a scene: a coupling, constant gains, a gain table, or the schedule of a method."""


def simulate(problem: Problem, gains: AnyGains, *, hand: Hand | StylusHand | None = None, seed: int = 0) -> Run:
    """Simulate the scene of a problem."""
    problem = stage(problem, gains)
    effects = build_effects(problem)
    effects = effects if hand is None else with_hand(problem, effects, hand)
    return simulate_effects(problem, *resolve(problem, effects, gains), seed=seed)


def simulate_effects(
    problem: Problem, effects: tuple[SceneEffect, ...], at_start: Gains, coupling: str, *, seed: int = 0
) -> Run:
    """Simulate effects and gains, of `resolve`, in place of those of the problem file."""
    scene = compile_scene(problem, effects, at_start)
    traces = _traces(scene, at_start, seed)
    judgement = Traces.of(traces, problem.device).judge()
    claim: Claim = "asymptotic" if judgement.stable else "unstable"
    if judgement.stable and any(isinstance(effect, CoulombFriction) for effect in effects):
        frictionless = compile_scene(problem, without(effects, CoulombFriction.kind), at_start)
        free = Traces.of(_traces(frictionless, at_start, seed), problem.device)
        claim = "asymptotic" if free.judge().stable else "held-by-friction"
    whole = np.ones(scene.samples)
    damping = traces.get("damping_ns_per_m", whole * at_start.damping_ns_per_m)
    stiffness = traces.get("stiffness_n_per_m", whole * at_start.stiffness_n_per_m)
    contact_damping = traces.get("contact_damping_ns_per_m", whole * at_start.contact_damping_ns_per_m)
    hz = traces.get("interaction_hz")
    return Run(
        problem=problem.name,
        coupling=coupling,
        effects=tuple(effect.kind for effect in effects),
        sample_time_s=scene.sample_time_s,
        position_m=traces["position_m"],
        velocity_m_per_s=traces["velocity_m_per_s"],
        force_n=traces["force_n"],
        tool_m=traces["tool_m"],
        target_m=scene.target.position_m,
        damping_ns_per_m=damping,
        stiffness_n_per_m=stiffness,
        contact_damping_ns_per_m=contact_damping,
        interaction_hz=None if hz is None else np.where(hz > 0, hz, np.nan),
        ledger=energy_ledger(
            traces["position_m"],
            traces["force_n"],
            traces["tool_m"],
            np.full(scene.samples, np.inf) if at_start.rigid else stiffness,
            scene.environment,
            traces.get("anchor_m", 0.0),
            sum(effect.potential_j(traces["position_m"]) for effect in effects if isinstance(effect, Detents)),
        ),
        judgement=judgement,
        claim=claim,
        metres_per_unit=problem.device.metres_per_unit,
        units=problem.units,
    )


def simulate_batch(problem: Problem, hands: Hand | StylusHand, gains: AnyGains, *, friction: bool = True) -> Judgement:
    """Simulate a scene for many hands at once and judge every run; all share the motion and the noises.

    Args:
        problem: a validated problem whose scene has the effect ``hand`` (or lists none).
        hands: at the device, in place of the scene's hand.
        gains: as in `simulate`.
        friction: False leaves dry friction out, to tell asymptotic stability from being held by friction.

    Returns:
        The judgement, with arrays of shape (n,).

    Raises:
        InputError: as `simulate`; or the scene lists no hand.

    Example:
        >>> from avc_casadi.model.hands import hand_set
        >>> problem = avc.load_problem("scenes/stiff-wall-pressed")
        >>> hands = hand_set(problem.hands, draws=2)
        >>> verdict = avc.simulate_batch(problem, hands, avc.solve(problem, "static"))
        >>> f"{verdict.stable.sum()} of {len(hands)} hands settle"
        '10 of 10 hands settle'
    """
    problem = stage(problem, gains)
    effects = with_hand(problem, build_effects(problem), hands)
    if not friction:
        effects = without(effects, CoulombFriction.kind)
    effects, at_start, _ = resolve(problem, effects, gains)
    scene = compile_scene(problem, effects, at_start)
    parameters, inputs = scene.parameter_values(at_start), scene.input_values()
    parts = (parameters[first : first + _HANDS_AT_ONCE] for first in range(0, len(parameters), _HANDS_AT_ONCE))
    return Judgement.join([Traces.of(execute(scene, block, inputs), problem.device).judge() for block in parts])


def stage(problem: Problem, gains: AnyGains) -> Problem:
    """Return the problem with the scene for some gains: a coupling brings its own part of the control computer."""
    if isinstance(gains, GainSchedule):
        check_sample_time(gains.sample_time_s, problem, f"gains by {gains.method} for {gains.problem}")
    if isinstance(gains, Gains | GainTable | GainSchedule):
        return problem
    require_coupling(gains)
    check_sample_time(gains.sample_time_s, problem, f"coupling by {gains.method} for {gains.problem.name}")
    kept = tuple(effect for effect in scene_effects(problem) if not EFFECTS[effect.kind].of_coupling)
    return problem.changed(scene={"effects": (*kept, *gains.runtime.effects(constant=gains.table.constant))})


def resolve(
    problem: Problem, effects: tuple[SceneEffect, ...], gains: AnyGains
) -> tuple[tuple[SceneEffect, ...], Gains, str]:
    """Return the effects with the table that an adaptation follows, the gains at the start, and their method."""
    if isinstance(gains, Gains):
        own_law = any(isinstance(effect, SceneLaw) for effect in effects)
        return effects, gains, "law" if own_law else "none" if gains == NO_COUPLING else "given"
    if isinstance(gains, Coupling):
        return *resolve(problem, effects, gains.table)[:2], gains.method
    frequency, method = problem.scene.interaction_hz, "given"
    if isinstance(gains, GainSchedule):
        at_start, method = gains_at(gains, frequency), gains.method
    else:
        at_start = gains.at_rest if frequency is None else Gains(*gains(frequency).tolist())
    if any(isinstance(effect, Adaptation) for effect in effects):
        table = gains if isinstance(gains, GainTable) else thinned(GainTable.of(gains))
        effects = tuple(
            replace(effect, gain_table=table) if isinstance(effect, Adaptation) else effect for effect in effects
        )
    return effects, at_start, method


def without(effects: tuple[SceneEffect, ...], kind: str) -> tuple[SceneEffect, ...]:
    """Return the effects without one kind."""
    return tuple(effect for effect in effects if effect.kind != kind)


def with_hand(problem: Problem, effects: tuple[SceneEffect, ...], hand: Hand | StylusHand) -> tuple[SceneEffect, ...]:
    """Return the effects with a hand, or many, in place of the effect ``hand``."""
    if not isinstance(hand, Hand | StylusHand):
        raise InputError.of(f"is {shown(hand)}; allowed: a Hand or a StylusHand", key="hand")
    if not any(effect.kind == Grip.kind for effect in effects):
        raise InputError.of(
            "has no hand to replace; add the effect hand, or list no effects",
            file=problem.name,
            key="scene.effects",
        )
    return tuple(Grip(hand) if effect.kind == Grip.kind else effect for effect in effects)


def _traces(scene: CompiledScene, gains: Gains, seed: int) -> dict[str, FloatArray]:
    """Return the traces of one run, with those missing in free space: no force, and a tool at the device."""
    results = execute(scene, scene.parameter_values(gains), scene.input_values(seed))
    traces = {name: values[0] for name, values in results.items()}
    position = traces["position_m"]
    return ({"force_n": np.zeros_like(position), "tool_m": position} if scene.environment is None else {}) | traces
