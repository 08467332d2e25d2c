"""Simulation of a coupling at a wall with many hands: which of them settle."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi._util.parallel import processors
from avc_casadi.model.declared import declared_effects
from avc_casadi.model.effects import (
    AdaptationEffect,
    CoulombFrictionEffect,
    DelayEffect,
    Effect,
    EncoderEffect,
    EstimatorEffect,
    GuardEffect,
    HandEffect,
    JitterEffect,
    ObserverEffect,
    SaturationEffect,
    StateFeedbackEffect,
    WallEffect,
)
from avc_casadi.model.gains import Gains
from avc_casadi.simulation.execute import Engine, execute, execute_to_speed
from avc_casadi.simulation.judge import Judgement, judge
from avc_casadi.simulation.native import compile_ahead, compiler
from avc_casadi.simulation.population.motions import Watched, felt_vibration, motions_at
from avc_casadi.simulation.population.prepared import prepared, with_law

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling
    from avc_casadi.model.device import Device
    from avc_casadi.model.gains import GainTable
    from avc_casadi.model.hands import Hand, StylusHand
    from avc_casadi.model.problem import Problem
    from avc_casadi.model.runtime import StateFeedback
    from avc_casadi.model.scene import Motion
    from avc_casadi.model.schedule import GainSchedule


DURATION_S = 3.0
# Up to so many hands, the scene chooses its engine itself.
_FEW = 3
# Hands whose traces are held at a time, and samples of them all.
HANDS_AT_ONCE = 250
_SAMPLES_AT_ONCE = 4_000_000


@dataclass(frozen=True)
class Conditions:
    """Simulated effects of the device."""

    friction_n: float = 0.0
    encoder_m: float = 0.0
    delay_samples: float = 0
    max_force_n: float | None = None
    dropped_share: float = 0.0
    observer: ObserverEffect | None = None
    state_feedback: StateFeedback | None = None
    guarded: bool = False
    runtime: tuple[Effect, ...] = (EstimatorEffect(), AdaptationEffect())
    others: tuple[Effect, ...] = ()
    steps_anywhere: bool = True

    @classmethod
    def declared(cls, problem: Problem) -> Conditions:
        """Take what the problem declares of its device."""
        device = problem.device
        return cls(device.coulomb_friction_n, device.encoder_resolution_m, device.delay_samples)

    @classmethod
    def of(cls, coupling: Coupling) -> Conditions:
        """Take all that the problem of a coupling declares of its device, and the coupling's runtime."""
        device, runtime = coupling.problem.device, coupling.runtime
        return cls(
            device.coulomb_friction_n,
            device.encoder_resolution_m,
            device.delay_samples,
            device.max_force_n,
            observer=None if runtime.observer_mass_kg is None else ObserverEffect(mass_kg=runtime.observer_mass_kg),
            state_feedback=runtime.state_feedback,
            guarded=runtime.guard is not None,
            runtime=tuple(
                effect for effect in runtime.effects(constant=False) if effect.kind in {"estimator", "adaptation"}
            ),
            others=_others(coupling.problem),
        )

    def without_friction(self) -> Conditions:
        """Return the same without dry friction."""
        return replace(self, friction_n=0.0)

    def effects(self) -> tuple[Effect, ...]:
        """Return the effects of a scene with a hand and a one-sided wall; what is 0 is not listed."""
        listed: list[Effect] = [HandEffect(), WallEffect(), *self.others]
        if self.friction_n > 0:
            listed.append(CoulombFrictionEffect(force_n=self.friction_n))
        if self.encoder_m > 0:
            # Of motor or handle, as the problem says.
            listed.append(EncoderEffect(resolution_m=self.encoder_m))
            if self.observer is not None:
                listed.append(self.observer)
        if self.state_feedback is not None:
            listed.append(StateFeedbackEffect(**vars(self.state_feedback)))
        if self.guarded:
            listed.append(GuardEffect())
        if self.delay_samples > 0:
            listed.append(DelayEffect(samples=self.delay_samples))
        if self.max_force_n is not None:
            listed.append(SaturationEffect(force_n=self.max_force_n))
        if self.dropped_share > 0:
            listed.append(JitterEffect(rms_s=0.0, dropped_share=self.dropped_share))
        return tuple(listed)


def on_device(
    coupling: Coupling, device: Device | None, effects: tuple[Effect, ...] = ()
) -> tuple[Coupling, Conditions]:
    """Return a coupling designed for one device on another, and the simulated conditions."""
    met = coupling if device is None else replace(coupling, problem=coupling.problem.changed(device=device))
    conditions, made_for = Conditions.of(met), coupling.problem.device
    observer = conditions.observer
    if device is not None and observer is not None:
        # The controller keeps the declared model, whatever the device.
        observer = ObserverEffect(
            mass_kg=observer.mass_kg,
            resolution_m=made_for.encoder_resolution_m or None,
            ahead_samples=made_for.delay_samples,
        )
    return met, replace(conditions, observer=observer, others=(*conditions.others, *effects))


def _others(problem: Problem) -> tuple[Effect, ...]:
    """Return the declared effects without a field of `Conditions`; of encoders the one without steps, at the handle."""
    numbered = {"hand", "wall", "detent", "coulomb-friction", "delay", "saturation"}
    if problem.device.encoder_resolution_m > 0:
        numbered.add("encoder")
    return tuple(effect for effect in declared_effects(problem) if effect.kind not in numbered)


@dataclass(frozen=True)
class Traces:
    """Traces of some hands, each of shape (hands, samples)."""

    position_m: FloatArray
    velocity_m_per_s: FloatArray
    force_n: FloatArray
    sample_time_s: float
    metres_per_unit: float = 1.0
    measured_m: FloatArray | None = None
    held_m: FloatArray | None = None
    held_m_per_s: FloatArray | None = None

    @property
    def depth_m(self) -> FloatArray:
        """Penetration of the measured body, shape (hands, samples)."""
        return self.position_m if self.measured_m is None else self.measured_m

    @property
    def vibration(self) -> FloatArray:
        """Vibration at the hand at the end, in multiples of the detection threshold, shape (hands,)."""
        held = self.position_m if self.held_m is None else self.held_m
        return felt_vibration(held * self.metres_per_unit, self.sample_time_s)

    def judged(self) -> Judgement:
        """Return the verdicts of every run."""
        return judge(
            self.position_m,
            self.velocity_m_per_s,
            self.force_n,
            self.sample_time_s,
            self.metres_per_unit,
            self.measured_m,
            self.held_m_per_s,
        )


def traces(
    problem: Problem,
    gains: Gains | GainTable | GainSchedule,
    subjects: Hand | StylusHand,
    motion: Motion,
    conditions: Conditions,
    duration_s: float = DURATION_S,
) -> Iterator[Traces]:
    """Simulate all hands, in blocks; arguments as for `simulations`."""
    for simulation in simulations(problem, gains, subjects, motion, conditions, duration_s):
        yield simulation()


def simulations(
    problem: Problem,
    gains: Gains | GainTable | GainSchedule,
    subjects: Hand | StylusHand,
    motion: Motion,
    conditions: Conditions,
    duration_s: float = DURATION_S,
) -> Iterator[Callable[[], Traces]]:
    """Prepare to simulate all hands, in blocks; each block is simulated when it is called."""
    compiled, parameters, inputs = prepared(problem, gains, subjects, motion, conditions, duration_s)
    engine = engine_for(len(parameters))

    def of(people: slice) -> Traces:
        found = execute(compiled, parameters[people], inputs, engine=engine)
        position, device = found["position_m"], problem.device
        return Traces(
            position,
            found["velocity_m_per_s"],
            found.get("force_n", np.zeros_like(position)),
            device.sample_time_s,
            device.metres_per_unit,
            found.get("measured_m"),
            found.get("held_m"),
            found.get("held_m_per_s"),
        )

    at_once = min(HANDS_AT_ONCE, max(1, _SAMPLES_AT_ONCE // inputs.shape[-1]))
    for first in range(0, len(parameters), at_once):
        yield partial(of, slice(first, first + at_once))


def resting(
    problem: Problem,
    gains: Gains | GainTable | GainSchedule,
    subjects: Hand | StylusHand,
    motion: Watched,
    conditions: Conditions,
) -> BoolArray:
    """Return whether each hand settles, on one thread and without traces; arguments as for `simulations`."""
    compiled, parameters, inputs = prepared(problem, gains, subjects, motion[0], conditions, motion[1])
    return execute_to_speed(compiled, parameters, inputs, engine=engine_for(len(subjects))) < 1


class Ends:
    """Largest residual speed of each hand over all motions, with any state feedback of one structure."""

    def __init__(
        self,
        problem: Problem,
        gains: Gains,
        subjects: Hand | StylusHand,
        motions: Iterable[tuple[Watched, Conditions]],
        *,
        racing: bool = False,
    ) -> None:
        self._gains, self.people, self._racing = gains, len(subjects), racing
        self._scenes = [
            prepared(problem, gains, subjects, motion, conditions, duration_s)
            for (motion, duration_s), conditions in motions
        ]
        if engine_for(self.people) == "native":
            for compiled, *_ in self._scenes:
                compile_ahead(compiled)

    def __call__(self, laws: Sequence[StateFeedback | None]) -> FloatArray:
        """Return the largest speed as of `execute_to_speed` over the simulated motions, shape (laws, hands)."""
        found, left = np.zeros((len(laws), self.people)), np.arange(len(laws))
        for scene in self._scenes:
            compiled, _, inputs = scene
            each = [replace(compiled, effects=with_law(compiled.effects, laws[row])) for row in left.tolist()]
            parameters = np.concatenate([one.parameter_values(self._gains) for one in each])
            engine = engine_for(len(parameters))
            speed = execute_to_speed(compiled, parameters, inputs, engine=engine, workers=processors())
            found[left] = np.maximum(found[left], np.reshape(speed, (len(left), self.people)))
            if self._racing and scene is not self._scenes[-1]:
                rest = (found < 1).all(axis=1)
                found[~rest] = np.maximum(found[~rest], 1.0)
                left = np.flatnonzero(rest)
            if len(left) == 0:
                break
        return found


def engine_for(runs: int) -> Engine:
    """Return the engine for many scenes at once: generated C where there is a compiler and more than a few runs."""
    return "native" if compiler() is not None and runs > _FEW else "auto"


def judged(
    problem: Problem, gains: Gains | GainSchedule, subjects: Hand | StylusHand, motion: Motion, conditions: Conditions
) -> Judgement:
    """Return the verdicts of all hands; every array has shape (hands,)."""
    parts = [part.judged() for part in traces(problem, gains, subjects, motion, conditions)]
    return Judgement(**{name: np.concatenate([vars(part)[name] for part in parts]) for name in vars(parts[0])})


def all_motions(
    problem: Problem, gains: Gains | GainSchedule, subjects: Hand | StylusHand, conditions: Conditions
) -> BoolArray:
    """Return whether each hand settles in every motion."""
    motions = motions_at(problem.device).values()
    runs = [judged(problem, gains, subjects, motion, conditions).stable for motion in motions]
    return np.asarray(np.all(runs, axis=0))
