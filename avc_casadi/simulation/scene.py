"""Simulating a scene, for one hand or for many."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._errors import InputError
from avc_casadi._util.arrays import FloatArray
from avc_casadi.coupling import Coupling, check_sample_time, require_coupling, thinned
from avc_casadi.model import EFFECTS
from avc_casadi.model.gains import NO_COUPLING, Gains, GainSchedule, GainTable, gains_at
from avc_casadi.model.scene import scene_effects
from avc_casadi.simulation.compile import CompiledScene, compile_scene
from avc_casadi.simulation.effects.base import SceneEffect
from avc_casadi.simulation.effects.computation import Adaptation
from avc_casadi.simulation.effects.hand import Grip
from avc_casadi.simulation.effects.mechanics import CoulombFriction
from avc_casadi.simulation.effects.registry import build_effects
from avc_casadi.simulation.effects.wall import Detents
from avc_casadi.simulation.execute import execute
from avc_casadi.simulation.judge import Judgement, Traces, energy_ledger
from avc_casadi.simulation.run import Claim, Run

if TYPE_CHECKING:
    from avc_casadi.model.hands import Hand, StylusHand
    from avc_casadi.model.problem import Problem

AnyGains = Coupling | Gains | GainTable | GainSchedule
"""Gains of a scene: a coupling, constant gains, a gain table, or the schedule of a method."""


def simulate(
    problem: Problem,
    gains: AnyGains,
    *,
    hand: Hand | StylusHand | None = None,
    seed: int = 0,
) -> Run:
    """Simulate the scene of a problem."""
    problem = stage(problem, gains)
    effects = build_effects(problem)
    effects = effects if hand is None else with_hand(problem, effects, hand)
    return simulate_effects(problem, *resolve(problem, effects, gains), seed=seed)


def simulate_effects(
    problem: Problem,
    effects: tuple[SceneEffect, ...],
    chosen: Gains,
    coupling: str,
    *,
    seed: int = 0,
) -> Run:
    """Simulate resolved effects and gains, of `settled`, in place of those of the problem file."""
    scene = compile_scene(problem, effects, chosen)
    started = time.perf_counter()
    traces = _traces(scene, chosen, seed)
    seconds = time.perf_counter() - started
    found = Traces.of(traces, problem.device).judge()
    claim: Claim = "asymptotic" if found.stable else "unstable"
    if found.stable and any(effect.friction_n > 0 for effect in effects):
        frictionless = compile_scene(problem, without(effects, CoulombFriction.kind), chosen)
        free = Traces.of(_traces(frictionless, chosen, seed), problem.device)
        claim = "asymptotic" if free.judge().stable else "held-by-friction"
    whole = np.ones(scene.samples)
    b, k, b_p = (traces.get(gain, whole * value) for gain, value in vars(chosen).items())
    stiffness = np.full(scene.samples, np.inf) if chosen.rigid else k
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
        damping_ns_per_m=b,
        stiffness_n_per_m=k,
        contact_damping_ns_per_m=b_p,
        interaction_hz=None if hz is None else np.where(hz > 0, hz, np.nan),
        ledger=energy_ledger(
            traces["position_m"],
            traces["force_n"],
            traces["tool_m"],
            stiffness,
            scene.environment,
            traces.get("anchor_m", 0.0),
            sum(one.potential_j(traces["position_m"]) for one in effects if isinstance(one, Detents)),
        ),
        judgement=found,
        claim=claim,
        states=len(scene.states),
        instructions=scene.instructions,
        build_seconds=scene.build_seconds,
        seconds=seconds,
        metres_per_unit=problem.device.metres_per_unit,
        units=problem.units,
    )


def simulate_batch(
    problem: Problem,
    hands: Hand | StylusHand,
    gains: AnyGains,
    *,
    friction: bool = True,
) -> Judgement:
    """Simulate a scene for many hands at once and judge every run; all share the motion and the noises.

    Args:
        problem: a validated problem whose scene has the effect ``hand`` (or lists none).
        hands: at the device, in place of the scene's hand.
        gains: as in `simulate`.
        friction: False leaves dry friction out, to tell asymptotic stability from being held by friction.

    Returns:
        The judgement, with arrays of shape (n,).

    Example:
        >>> from avc_casadi.model.hands import hand_set
        >>> problem = avc.load_problem("scenes/stiff-wall-pressed")
        >>> hands = hand_set(problem.hands, draws=2)
        >>> avc.simulate_batch(problem, hands, avc.solve(problem, "static")).stable.shape == (len(hands),)
        True
    """
    problem = stage(problem, gains)
    effects = with_hand(problem, build_effects(problem), hands)
    if not friction:
        effects = without(effects, CoulombFriction.kind)
    effects, chosen, _ = resolve(problem, effects, gains)
    scene = compile_scene(problem, effects, chosen)
    parameters, inputs = scene.parameter_values(chosen), scene.input_values()
    device = problem.device
    return Judgement.join(
        [
            Traces.of(execute(scene, parameters[first : first + _CHUNK], inputs), device).judge()
            for first in range(0, len(parameters), _CHUNK)
        ]
    )


# Hands whose traces are held at a time.
_CHUNK = 256


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
        return effects, gains, "none" if gains == NO_COUPLING else "given"
    if isinstance(gains, Coupling):
        return *resolve(problem, effects, gains.table)[:2], gains.method
    frequency, method = problem.scene.interaction_hz, "given"
    if isinstance(gains, GainSchedule):
        at, method = gains_at(gains, frequency), gains.method
    else:
        at = gains.at_rest if frequency is None else Gains(*gains(frequency).tolist())
    if any(isinstance(effect, Adaptation) for effect in effects):
        table = gains if isinstance(gains, GainTable) else thinned(GainTable.of(gains))
        effects = tuple(replace(one, table=table) if isinstance(one, Adaptation) else one for one in effects)
    return effects, at, method


def without(effects: tuple[SceneEffect, ...], kind: str) -> tuple[SceneEffect, ...]:
    """Return the effects without one kind."""
    return tuple(effect for effect in effects if effect.kind != kind)


def with_hand(problem: Problem, effects: tuple[SceneEffect, ...], hand: Hand | StylusHand) -> tuple[SceneEffect, ...]:
    """Return the effects with a hand, or many, in place of the effect ``hand``."""
    if not any(effect.kind == Grip.kind for effect in effects):
        raise InputError.of(
            "lists no hand that another one could replace; allowed: the effect hand, or no effects at all",
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
