"""Trial of a coupling to a virtual tool: many hands in free motion, making and breaking contact, pressed, dragged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi._util.printed import Columns
from avc_casadi.loops.engine import contact_stiffnesses_n_per_m, required_tool
from avc_casadi.model.declared import declared_effects
from avc_casadi.model.effects import SimulationEffect
from avc_casadi.model.gains import NO_COUPLING
from avc_casadi.model.scene import Free, Hold, Motion, Press, Scene, Stroke
from avc_casadi.model.virtual_tool import HEAVIEST_TOOL_KG
from avc_casadi.simulation.effects.registry import build_effects
from avc_casadi.simulation.effects.virtual_tool import Engine
from avc_casadi.simulation.execute import execute
from avc_casadi.simulation.judge import AT_REST_M_PER_S, judge, judged_samples
from avc_casadi.simulation.population.motions import TRIAL_S, at_handle, course_of
from avc_casadi.simulation.population.other_end_trial import OtherEndTrial
from avc_casadi.simulation.population.prepared import Shared, people_key, shared
from avc_casadi.simulation.population.trial import engine_for
from avc_casadi.simulation.scene import compile_for, held_by, without

if TYPE_CHECKING:
    from avc_casadi.model.hands import Hand
    from avc_casadi.model.problem import Problem
    from avc_casadi.model.virtual_tool import ToolGains
    from avc_casadi.simulation.compile import CompiledScene

TOOL_MOTIONS: dict[str, Motion] = {
    "free": Free(frequency_hz=2.0, amplitude_m=0.008, rest_s=1.5),
    "press": Press(),
    "tap": Stroke(frequency_hz=2.0, amplitude_m=0.015),
    "hold": Hold(),
    "drag": Stroke(),
    "strike": Press(speed_m_per_s=0.3),
    "touch": Press(end_m=5e-4, speed_m_per_s=0.03),
}
"""Free motion; a press; taps that break contact; held in contact; moved while pressed; struck; touched lightly."""
DROPPED_SHARE = 0.01
"""Share of the engine's steps that are missed in the runs with dropped steps."""
# As in the trial of a wall: dry friction projected, exact events being several times slower.
_FRICTION_SUBSTEPS = 4


@dataclass(frozen=True, eq=False, repr=False)
class ToolTrial(OtherEndTrial):
    """Results by simulated hand; every array has shape (hands,)."""

    stable_without_friction: BoolArray
    stable_with_dropped_steps: BoolArray

    @property
    def settled(self) -> bool:
        """Whether all hands settle, without friction and with missed steps too."""
        return self.settled_with_friction and bool(np.all(self.stable_without_friction))

    @property
    def settled_with_friction(self) -> bool:
        """Whether all hands settle as declared, with missed steps too."""
        return bool(np.all(self.stable & self.stable_with_dropped_steps))

    def _more_columns(self) -> Columns:
        return {
            "stable_without_friction": self.stable_without_friction,
            "stable_with_dropped_steps": self.stable_with_dropped_steps,
        }

    def _more(self) -> dict[str, Any]:
        return {
            "settled_without_friction": int(self.stable_without_friction.sum()),
            "settled_with_dropped_steps": int(self.stable_with_dropped_steps.sum()),
            "dropped_share": DROPPED_SHARE,
        }


def try_tool(
    problem: Problem, gains: ToolGains, hands: Hand, seed: int = 0, motions: Sequence[str] = tuple(TOOL_MOTIONS)
) -> ToolTrial:
    """Simulate hands that move a tool, with all that the problem declares of the device.

    Every motion is simulated as declared, without dry friction and with missed steps of the engine, on every contact of
    the range of [simulation].
    """
    tool = required_tool(problem)
    contacts = [one for one in contact_stiffnesses_n_per_m(tool) if one > 0] or [0.0]
    kinds = [(True, 0.0), (True, DROPPED_SHARE)] + ([(False, 0.0)] if problem.device.coulomb_friction_n > 0 else [])
    settled: dict[tuple[bool, float], dict[str, BoolArray]] = {kind: {} for kind in kinds}
    stiffness, tap = np.full(len(hands), np.nan), np.zeros(len(hands))
    for friction, dropped in kinds:
        for name in motions:
            key = (problem, people_key(hands), name, friction, dropped)
            build = partial(_scene, problem, hands, name, friction=friction, dropped_share=dropped)
            rests = []
            for contact in contacts:
                run = _run(problem, hands, shared(Shared(key, build)), gains, contact)
                rests.append(run.settled)
                if friction and dropped == 0 and contact == contacts[-1]:
                    stiffness = run.stiffness_n_per_m if name == "press" else stiffness
                    tap = run.force_n if name == "tap" else tap
            settled[friction, dropped][name] = np.asarray(np.all(rests, axis=0))
    declared = settled[True, 0.0]
    free = settled.get((False, 0.0), declared)
    return ToolTrial(
        seed=seed,
        by_motion=declared,
        stable_without_friction=np.asarray(np.all(list(free.values()), axis=0)),
        stable_with_dropped_steps=np.asarray(np.all(list(settled[True, DROPPED_SHARE].values()), axis=0)),
        stiffness_n_per_m=stiffness,
        tap_force_n=tap,
    )


@dataclass(frozen=True)
class _Run:
    settled: BoolArray
    stiffness_n_per_m: FloatArray
    force_n: FloatArray


def _scene(problem: Problem, hands: Hand, name: str, *, friction: bool, dropped_share: float) -> CompiledScene:
    """Return a motion of many hands, for all gains and contacts."""
    longer_s = course_of(_heavier(problem)).longest_s - TRIAL_S
    friction = friction and problem.device.coulomb_friction_n > 0
    how: dict[str, Any] = {"integrator": "projected", "substeps": _FRICTION_SUBSTEPS} if friction else {}
    kept = tuple(effect for effect in declared_effects(problem) if effect.kind != SimulationEffect().kind)
    engine = SimulationEffect(stiffness_n_per_m=1.0, dropped_share=dropped_share)
    motion = at_handle(TOOL_MOTIONS[name], problem.device)
    if isinstance(motion, Free | Stroke):
        motion = motion.model_copy(update={"rest_s": motion.rest_s + longer_s})
    scene = Scene(duration_s=TRIAL_S + longer_s, motion=motion, effects=(*kept, engine), coupling="none", **how)
    run = problem.changed(scene=scene)
    effects = held_by(run, build_effects(run), hands)
    return compile_for(run, effects if friction else without(effects, "coulomb-friction"), NO_COUPLING)


def _heavier(problem: Problem) -> Problem:
    """Return the problem with the tool's mass added to the device, as in free motion."""
    tool = required_tool(problem)
    mass = problem.device.mass_kg + (0.0 if tool.tool_mass_kg is None else tool.scale * tool.tool_mass_kg[1])
    return problem.changed(device={"mass_kg": min(mass, HEAVIEST_TOOL_KG), "range": {"mass_kg": None}})


def _run(
    problem: Problem,
    hands: Hand,
    scene: tuple[CompiledScene, FloatArray],
    gains: ToolGains,
    contact_stiffness_n_per_m: float,
) -> _Run:
    compiled, inputs = scene
    effects = tuple(
        replace(one.touching(contact_stiffness_n_per_m), gains=gains) if isinstance(one, Engine) else one
        for one in compiled.effects
    )
    run = replace(compiled, effects=effects)
    device = problem.device
    found = execute(run, run.parameter_values(NO_COUPLING), inputs, engine=engine_for(len(hands)))
    judged = judge(
        found["position_m"],
        found["velocity_m_per_s"],
        found["force_n"],
        device.sample_time_s,
        device.metres_per_unit,
        found.get("measured_m"),
        found.get("held_m_per_s"),
    )
    last = judged_samples(compiled.samples, device.sample_time_s)
    with np.errstate(invalid="ignore", over="ignore"):
        speed = np.abs(np.diff(found["tool_m"][:, -last:], axis=-1)).max(axis=-1) / device.sample_time_s
        slow = speed * device.metres_per_unit < AT_REST_M_PER_S
    limit = np.inf if device.max_force_n is None else device.max_force_n
    at_limit = np.abs(judged.mean_force_n) > 0.97 * limit
    return _Run(
        np.asarray(judged.stable & slow),
        np.where(at_limit, np.nan, judged.apparent_stiffness_n_per_m),
        np.abs(found["force_n"]).max(axis=-1),
    )
