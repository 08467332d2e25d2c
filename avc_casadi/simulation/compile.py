"""From a scene to one CasADi function for one sample, made of the listed effects only."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from avc_casadi._errors import Fault, InputError, UnsupportedError
from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.counts import refuse_counts, seed_count
from avc_casadi._util.interrupt import DeferredInterrupt
from avc_casadi.coupling import contact_law
from avc_casadi.model import EFFECTS
from avc_casadi.model.declared import scene_effects
from avc_casadi.model.gains import NO_COUPLING, Gains, GainTable
from avc_casadi.model.plant import DEVICE, GROUND, HANDLE, LinearPlant, Plant
from avc_casadi.model.problem import Contact, Problem
from avc_casadi.model.scene import Free, Motion, Stroke, Tap
from avc_casadi.simulation.advance import Advance, Drive, MatrixExponential, TaylorSeries
from avc_casadi.simulation.contact import Environment, coupling_parameters, wall_force
from avc_casadi.simulation.effects.base import SceneEffect, Station
from avc_casadi.simulation.effects.computation import Adaptation
from avc_casadi.simulation.effects.environment import EngineEffect, SceneWall
from avc_casadi.simulation.effects.interface import Delay, Encoder, Jitter, VelocityFilter
from avc_casadi.simulation.effects.mechanics import Backlash, CoulombFriction
from avc_casadi.simulation.tick import Tick, ca, column


def build_effects(problem: Problem) -> tuple[SceneEffect, ...]:
    """Return the effects of a problem's scene, in the order of the loop; with none listed, all declared ones."""
    tables = scene_effects(problem)
    kinds = [table.kind for table in tables]
    messages = [f"{kind} is listed {count} times; allowed: once" for kind, count in Counter(kinds).items() if count > 1]
    messages += [
        f"{kind} and {other_kind} exclude each other; allowed: one of them"
        for kind, other_kind in combinations(sorted(set(kinds), key=list(EFFECTS).index), 2)
        if EFFECTS[kind].role and EFFECTS[kind].role == EFFECTS[other_kind].role
    ]
    faults: list[Fault] = []
    effects: list[SceneEffect] = []
    for index, table in enumerate(tables):
        try:
            effects.append(EFFECTS[table.kind].build(table, problem, f"scene.effects[{index}]"))
        except InputError as error:
            faults.extend(error.faults)
    messages += _clashes(effects)
    if messages or faults:
        raise InputError([Fault(problem.name, None, "scene.effects", message) for message in messages] + faults)
    return tuple(sorted(effects, key=lambda effect: effect.rank))


def _clashes(effects: list[SceneEffect]) -> list[str]:
    """Return which effects exclude each other by their numbers: jitter and part delays, filter and engine, backlash."""
    messages = []
    has_engine = any(isinstance(effect, EngineEffect) for effect in effects)
    has_backlash = any(isinstance(effect, Backlash) for effect in effects)
    delays = [effect.table.samples for effect in effects if isinstance(effect, Delay)]
    late = any(isinstance(effect, Jitter) and effect.table.rms_s > 0 for effect in effects)
    if late and any(samples != int(samples) for samples in delays):
        messages.append(
            f"a delay of {delays[0]:g} samples and random delays of the force (jitter) exclude each other; allowed: a "
            "delay of whole samples, or jitter with rms_s = 0"
        )
    has_filter = any(isinstance(effect, VelocityFilter) for effect in effects)
    if has_filter and has_engine:
        messages.append(
            "velocity-filter does not apply to a [simulation], whose engine uses plain differences; leave it out"
        )
    if has_backlash and _measured_body(effects) == HANDLE:
        messages.append("backlash and an encoder at the handle exclude each other; allowed: one of them")
    return messages


@dataclass(frozen=True)
class Target:
    """The target at the samples; between two samples it moves at constant velocity."""

    position_m: FloatArray
    velocity_m_per_s: FloatArray
    device_start_m: float


def target_of(motion: Motion, samples: int, sample_time_s: float) -> Target:
    """Return the target of a motion; a held one begins with the device at rest at the surface, or before it."""
    time = np.arange(samples + 1, dtype=np.float64) * np.float64(sample_time_s)
    position = _position(motion, time)
    velocity = np.diff(position) / sample_time_s
    start = min(motion.end_m, 0.0) if motion.kind == "hold" else float(position[0])
    return Target(position[:-1], velocity, start)


def _position(motion: Motion, time: FloatArray) -> FloatArray:
    """Return the position, m, of what the hand aims at over time, s: hold, tap, free swing, press, press and swing."""
    start, end = motion.start_m, motion.end_m
    if motion.kind == "hold":
        return np.full(time.shape, end)
    if motion.kind == "tap":
        phase = np.minimum(time, _resting_from(time[-1], 0.0, motion)) * motion.frequency_hz
        return start + (end - start) * np.sin(np.pi * phase) ** 2
    if motion.kind == "free":
        phase = np.minimum(time, _resting_from(time[-1], 0.0, motion)) * motion.frequency_hz
        return start + motion.amplitude_m * np.sin(2 * np.pi * phase)
    arrival = abs(end - start) / motion.speed_m_per_s
    ramp = start + (end - start) * np.clip(time / arrival, 0.0, 1.0) if arrival > 0 else np.full(time.shape, end)
    if motion.kind == "press":
        return ramp
    resting = _resting_from(time[-1], arrival, motion)
    phase = np.clip(time, arrival, max(arrival, resting)) - arrival
    return ramp + motion.amplitude_m * np.sin(2 * np.pi * motion.frequency_hz * phase)


def _resting_from(duration_s: float, begin_s: float, motion: Tap | Stroke | Free) -> float:
    """Return the end of the last whole period before the pause, in which settling is judged, or of the first one."""
    periods = max(1.0, np.floor((duration_s - motion.rest_s - begin_s) * motion.frequency_hz))
    return float(begin_s + periods / motion.frequency_hz)


@dataclass(frozen=True)
class CompiledScene:
    """One sample of a scene, (states, inputs, parameters) -> (next states, traces), and the data common to its runs."""

    effects: tuple[SceneEffect, ...]
    function: Any
    states: tuple[str, ...]
    initial: FloatArray
    inputs: tuple[str, ...]
    traces: tuple[str, ...]
    coupled: bool
    damped: bool
    environment: Environment | None
    rate_gain_per_s: float
    target: Target
    sample_time_s: float
    samples: int
    metres_per_unit: float
    _tick: Tick
    _plant_numbers: FloatArray

    @property
    def instructions(self) -> int:
        """Number of instructions of one sample."""
        return int(self.function.n_instructions())

    @property
    def speeds(self) -> tuple[str, ...]:
        """Names of the velocity traces; they follow the first trace."""
        return tuple(name for name in self.traces if name in ("velocity_m_per_s", "handle_m_per_s"))

    def with_numbers(self, kind: str, **numbers: Any) -> CompiledScene:
        """Return the scene with other numbers of an effect, of one structure."""
        effects = tuple(replace(effect, **numbers) if effect.kind == kind else effect for effect in self.effects)
        return replace(self, effects=effects)

    def input_values(self, seed: int = 0) -> FloatArray:
        """Return the inputs at every sample, shape (inputs, samples)."""
        refuse_counts(seed_count(seed))
        columns = [slot.values(self.samples, seed) for slot in self._tick.inputs if slot.values is not None]
        return np.array(columns, dtype=np.float64).reshape(len(columns), self.samples)

    def parameter_values(self, gains: Gains) -> FloatArray:
        """Return the parameters of every hand, shape (hands, parameters): of effects, coupling, and the plant."""
        parts = [effect.numbers for effect in self.effects if effect.station < Station.ENVIRONMENT]
        if self.coupled and self.environment is not None:
            parts.append(
                coupling_parameters(
                    gains.damping_ns_per_m, gains.stiffness_n_per_m, self.environment, self.rate_gain_per_s
                )
            )
        if self.damped:
            parts.append(np.array([gains.contact_damping_ns_per_m]))
        rows = [np.broadcast_to(part, (len(self._plant_numbers), part.shape[-1])) for part in parts]
        return np.concatenate([*rows, self._plant_numbers], axis=1)


def compile_scene(
    problem: Problem, effects: tuple[SceneEffect, ...] | None = None, gains: Gains = NO_COUPLING
) -> CompiledScene:
    """Compile the scene of a problem with the parameters that the gains need."""
    # CasADi calls Python for shapes while it builds an expression, and ignores exceptions there.
    with DeferredInterrupt():
        return _compile(problem, build_effects(problem) if effects is None else effects, gains)


def _compile(problem: Problem, effects: tuple[SceneEffect, ...], gains: Gains) -> CompiledScene:
    """Return one sample of a scene as a compiled function, with the data that its runs share.

    The mechanics give the state; the control computer's effects give the force in the order of their stations; a scheme
    then advances the plant to the next sample.
    """
    sample_time_s = problem.device.sample_time_s
    samples = max(1, round(problem.scene.duration_s / sample_time_s))
    target = target_of(problem.scene.motion, samples, sample_time_s)
    plant = mechanics_of(problem, effects)
    table = next((effect.gain_table for effect in effects if isinstance(effect, Adaptation)), None)
    environment = _environment_of(effects, gains, table)
    coupled = not gains.rigid and environment is not None
    damped = gains.contact_damping_ns_per_m > 0 and environment is not None
    adaptive = table is not None and environment is not None
    tick = Tick(sample_time_s, target.device_start_m)
    for name in plant.names:
        tick.state(name, target.device_start_m if name.endswith("_position_m") else 0.0, computed=False)
    tick.position = _measured_position(problem, effects, tick)
    damper = damped if table is None else bool(np.any(table.gains[2] > 0))
    _sample(tick, effects, environment, coupled=coupled or adaptive, damped=damper)
    advance = _advance(problem, effects, plant, tick)
    aim = _aim(tick, target) if np.any(plant.target) else None
    drive = Drive(force=tick.command, force_before=tick.command_before, late=tick.late, target=aim)
    now = [slot.symbol for slot in tick.states[: plant.states]]
    for name, value in zip(plant.names, advance.step(tick, now, drive), strict=True):
        tick.follow(name, value)
    return CompiledScene(
        effects=effects,
        function=_function_of(tick),
        states=tuple(slot.name for slot in tick.states),
        initial=np.array([slot.initial for slot in tick.states]),
        inputs=tuple(slot.name for slot in tick.inputs),
        traces=tuple(tick.traces),
        coupled=coupled and not adaptive,
        damped=damped and not adaptive,
        environment=environment,
        rate_gain_per_s=tick.rate_gain_per_s,
        target=target,
        sample_time_s=sample_time_s,
        samples=samples,
        metres_per_unit=problem.device.metres_per_unit,
        _tick=tick,
        _plant_numbers=np.atleast_2d(advance.parameters(plant, sample_time_s)),
    )


def _environment_of(effects: tuple[SceneEffect, ...], gains: Gains, table: GainTable | None) -> Environment | None:
    """Return the wall of a scene with the contact law that holds for these gains; None where it gives no force."""
    environment = next((effect.environment for effect in effects if isinstance(effect, SceneWall)), None)
    if environment is None:
        return None
    declared: Contact = "clip-last" if environment.clips_last else "gated"
    stiffness = gains.stiffness_n_per_m if table is None else table.gains[1]
    law = contact_law(declared, environment.stiffness_n_per_m, stiffness)
    return replace(environment, clips_last=law == "clip-last") if environment.present else None


def _aim(tick: Tick, target: Target) -> tuple[Any, Any]:
    """Add position and velocity of the target as inputs."""
    return (
        tick.input("target_position_m", lambda *_: target.position_m),
        tick.input("target_velocity_m_per_s", lambda *_: target.velocity_m_per_s),
    )


def _function_of(tick: Tick) -> Any:
    """Return the sample as a function (states, inputs, parameters) -> (next, traces)."""
    return ca.Function(
        "sample",
        [column(*(slot.symbol for slot in slots)) for slots in (tick.states, tick.inputs, tick.parameters)],
        [ca.vertcat(*tick.successors()), ca.vertcat(*tick.traces.values())],
        ["states", "inputs", "parameters"],
        ["next", "traces"],
    )


def mechanics_of(problem: Problem, effects: tuple[SceneEffect, ...]) -> LinearPlant:
    """Return the linear plant of device, hand, resonance and what else effects add, without contact and friction."""
    plant = Plant()
    plant.add_mass(DEVICE, problem.device.mass_kg)
    plant.join(DEVICE, GROUND, 0.0, problem.device.damping_ns_per_m)
    for effect in effects:
        effect.mechanics(plant)
    if np.min(plant.mass_kg(DEVICE)) <= 0:
        raise InputError.of(
            "device and hand have no mass, and cannot be simulated; allowed: device.mass_kg above 0, or a hand with a "
            "mass",
            file=problem.name,
            key="scene.effects",
        )
    return plant.linear()


def _measured_body(effects: Sequence[SceneEffect]) -> str:
    return next((effect.body for effect in effects if isinstance(effect, Encoder)), DEVICE)


def _measured_position(problem: Problem, effects: tuple[SceneEffect, ...], tick: Tick) -> Any:
    """Record the motion of device and handle; return the measured position: the motor's, unless an effect names one."""
    moves = {slot.name: slot.symbol for slot in tick.states}
    tick.trace("position_m", moves[f"{DEVICE}_position_m"])
    tick.trace("velocity_m_per_s", moves[f"{DEVICE}_velocity_m_per_s"])
    if f"{HANDLE}_position_m" in moves:
        tick.trace("handle_m_per_s", moves[f"{HANDLE}_velocity_m_per_s"])
        tick.trace("handle_m", moves[f"{HANDLE}_position_m"])
    body = _measured_body(effects)
    if f"{body}_position_m" not in moves:
        message = f"measure the {body}, but the scene has no {body}; add the effect resonance"
        raise InputError.of(message, file=problem.name, key="scene.effects")
    position = moves[f"{body}_position_m"]
    if body != DEVICE:
        tick.trace("measured_m", position)
    return position


def _sample(
    tick: Tick, effects: tuple[SceneEffect, ...], environment: Environment | None, *, coupled: bool, damped: bool
) -> None:
    """Add the effects of the control computer to a sample: those before the wall, its force, then those behind it."""
    for effect in effects:
        if effect.station < Station.ENVIRONMENT:
            effect.sample(tick)
    if environment is not None:
        tick.command = wall_force(tick, environment, rigid=not coupled, damped=damped)
    for effect in effects:
        if effect.station > Station.ENVIRONMENT:
            effect.sample(tick)
    for settle in tick.at_end:
        settle()
    if tick.command is not None:
        tick.trace("force_n", tick.command)


def _advance(problem: Problem, effects: tuple[SceneEffect, ...], plant: LinearPlant, tick: Tick) -> Advance:
    """Return the scheme that advances the plant by a sample: a matrix exponential, or a power series.

    The series is for dry friction that is not projected, and for forces whose arrival varies.
    """
    friction = sum(effect.table.force_n for effect in effects if isinstance(effect, CoulombFriction))
    integrator, substeps = problem.scene.integrator, problem.scene.substeps
    constant = tick.late if isinstance(tick.late, float) else 0.0
    varying = tick.late is not None and constant == 0
    has_force = tick.command is not None
    has_target = bool(np.any(plant.target))
    projection = integrator == "projected" and friction > 0
    if projection and varying:
        raise UnsupportedError(
            f'{problem.name}: scene.integrator = "projected" does not support random delays of the force (jitter); use '
            '"exact", or jitter with rms_s = 0'
        )
    if varying or (friction > 0 and not projection):
        return TaylorSeries.of(plant, tick.sample_time_s, friction, substeps)
    return MatrixExponential(substeps, has_force, has_target, constant, friction)
