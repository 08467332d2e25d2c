"""One coupling before one wall, tried by many simulated people: do their hands come to rest?"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.coupling import Gains
from avc_casadi.problem import (
    AdaptationEffect,
    CoulombFrictionEffect,
    DelayEffect,
    Effect,
    EncoderEffect,
    EstimatorEffect,
    GuardEffect,
    HandEffect,
    Hold,
    JitterEffect,
    Motion,
    ObserverEffect,
    Press,
    SaturationEffect,
    StateFeedbackEffect,
    Stroke,
    WallEffect,
    declared_effects,
)
from avc_casadi.scene import (
    Engine,
    Judgement,
    compiler,
    execute,
    execute_to_speed,
    judge,
)
from avc_casadi.support import BoolArray, FloatArray, processors
from avc_casadi.trial._prepared import prepared, with_law

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling, GainSchedule, GainTable
    from avc_casadi.loop import Hand, StylusHand
    from avc_casadi.problem import Device, Problem
    from avc_casadi.runtime import StateFeedback


# A tap leaves the wall and strikes it again twice a second, and ends in contact: where it ended in free space, every
# coupling would be at rest.
MOTIONS: dict[str, Motion] = {"press": Press(), "tap": Stroke(frequency_hz=2.0, amplitude_m=0.015), "hold": Hold()}
STRIKE = Press(speed_m_per_s=0.3)
"""Beyond what a trial tells: a wall that is struck may be driven to the force limit and not come back."""

DURATION_S = 3.0
# Up to so many people, the scene's own choice of what runs it is left alone.
_FEW = 3
# People whose traces are held at a time.
PEOPLE_AT_ONCE = 250


def motions_at(device: Device) -> dict[str, Motion]:
    """Return the same motions of the hand at the handle of a device that turns, as angles."""
    return {name: at_handle(motion, device) for name, motion in MOTIONS.items()}


def at_handle(motion: Motion, device: Device) -> Motion:
    """Return a motion of the hand as the device counts it."""
    radius = device.metres_per_unit
    lengths = {"start_m", "end_m", "speed_m_per_s", "amplitude_m"}
    return type(motion).model_validate(
        {key: value / radius if key in lengths else value for key, value in motion.model_dump().items()}
    )


@dataclass(frozen=True)
class Conditions:
    """What of the device is simulated.

    Attributes:
        friction_n: dry friction.
        encoder_m: resolution of the encoder; 0 is none.
        delay_samples: delay.
        max_force_n: largest force of the actuator; None is no limit.
        dropped_share: share of the samples that the computer misses.
        observer: behind the encoder, with what it reckons with; None is no observer.
        state_feedback: observer and feedback behind the encoder; None is none.
        guarded: with the passivity controller in the time domain.
        runtime: what follows a gain table.
        others: what else the device declares, its values left to the problem.
    """

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

    @classmethod
    def declared(cls, problem: Problem) -> Conditions:
        """Take what the problem declares of its device."""
        device = problem.device
        return cls(device.coulomb_friction_n, device.encoder_resolution_m, device.delay_samples)

    @classmethod
    def of(cls, coupling: Coupling) -> Conditions:
        """Take all that the problem of a coupling declares of its device, and what runs beside the gains."""
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
        """Leave dry friction out."""
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


def _others(problem: Problem) -> tuple[Effect, ...]:
    """Return the declared effects that conditions have no number for; of encoders that without steps, at the handle."""
    numbered = {"hand", "wall", "detent", "coulomb-friction", "delay", "saturation"}
    if problem.device.encoder_resolution_m > 0:
        numbered.add("encoder")
    return tuple(effect for effect in declared_effects(problem) if effect.kind not in numbered)


@dataclass(frozen=True)
class Traces:
    """Traces of some people, each of shape (people, samples).

    Attributes:
        position_m: true position.
        velocity_m_per_s: true velocity.
        force_n: force of the actuator, positive against +x.
        sample_time_s: T.
        metres_per_unit: how far the hand moves for a unit of the position.
        measured_m: true position of the body that is measured; None where that is the one that moves.
    """

    position_m: FloatArray
    velocity_m_per_s: FloatArray
    force_n: FloatArray
    sample_time_s: float
    metres_per_unit: float = 1.0
    measured_m: FloatArray | None = None

    @property
    def depth_m(self) -> FloatArray:
        """How deep the body is that is measured, shape (people, samples)."""
        return self.position_m if self.measured_m is None else self.measured_m

    def judged(self) -> Judgement:
        """Judge every run."""
        return judge(
            self.position_m,
            self.velocity_m_per_s,
            self.force_n,
            self.sample_time_s,
            self.metres_per_unit,
            self.measured_m,
        )


def traces(
    problem: Problem,
    gains: Gains | GainTable | GainSchedule,
    subjects: Hand | StylusHand,
    motion: Motion,
    conditions: Conditions,
    duration_s: float = DURATION_S,
) -> Iterator[Traces]:
    """Simulate everybody, some at a time; arguments as for `simulations`."""
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
    """Prepare to simulate everybody, some at a time; each is simulated when it is called.

    Args:
        problem: device and environment.
        gains: constant gains; or a gain table, which is then followed by estimator and adaptation.
        subjects: the people.
        motion: motion of their hands' target.
        conditions: what of the device is simulated.
        duration_s: how long.
    """
    compiled, parameters, inputs = prepared(problem, gains, subjects, motion, conditions, duration_s)
    engine = _engine(len(parameters))

    def of(some: FloatArray) -> Traces:
        found = execute(compiled, some, inputs, engine=engine)
        position, device = found["position_m"], problem.device
        return Traces(
            position,
            found["velocity_m_per_s"],
            found.get("force_n", np.zeros_like(position)),
            device.sample_time_s,
            device.metres_per_unit,
            found.get("measured_m"),
        )

    for first in range(0, len(parameters), PEOPLE_AT_ONCE):
        yield partial(of, parameters[first : first + PEOPLE_AT_ONCE])


def resting(
    problem: Problem,
    gains: Gains | GainTable | GainSchedule,
    subjects: Hand | StylusHand,
    motion: Motion,
    conditions: Conditions,
    duration_s: float = DURATION_S,
) -> BoolArray:
    """Whether each of many comes to rest, on one thread and without traces; arguments as for `simulations`."""
    compiled, parameters, inputs = prepared(problem, gains, subjects, motion, conditions, duration_s)
    return execute_to_speed(compiled, parameters, inputs, engine=_engine(len(parameters))) < 1


class Ends:
    """How fast each of many ends the motion that ends fastest, with any state feedback of one structure.

    Args:
        problem: as for `simulations`.
        gains: constant gains.
        subjects: as for `simulations`.
        motions: of their hands' target.
        conditions: what of the device is simulated, with some state feedback of the structure, or none.
        duration_s: as for `simulations`.
    """

    def __init__(
        self,
        problem: Problem,
        gains: Gains,
        subjects: Hand | StylusHand,
        motions: Iterable[Motion],
        conditions: Conditions,
        duration_s: float = DURATION_S,
    ) -> None:
        self._gains, self.people = gains, len(subjects)
        self._scenes = [prepared(problem, gains, subjects, motion, conditions, duration_s) for motion in motions]

    def __call__(self, laws: Sequence[StateFeedback | None]) -> FloatArray:
        """Return the largest speed as of `execute_to_speed`, shape (laws, people)."""
        found = np.zeros((len(laws), self.people))
        for compiled, _, inputs in self._scenes:
            each = [replace(compiled, effects=with_law(compiled.effects, law)) for law in laws]
            parameters = np.concatenate([one.parameter_values(self._gains) for one in each])
            engine, workers = _engine(len(parameters)), processors()
            speed = execute_to_speed(compiled, parameters, inputs, engine=engine, workers=workers)
            found = np.maximum(found, np.reshape(speed, found.shape))
        return found


def _engine(runs: int) -> Engine:
    return "native" if compiler() is not None and runs > _FEW else "auto"


def judged(
    problem: Problem, gains: Gains | GainSchedule, subjects: Hand | StylusHand, motion: Motion, conditions: Conditions
) -> Judgement:
    """Judge everybody's run; every array has shape (people,)."""
    parts = [part.judged() for part in traces(problem, gains, subjects, motion, conditions)]
    return Judgement(**{name: np.concatenate([vars(part)[name] for part in parts]) for name in vars(parts[0])})


def all_motions(
    problem: Problem, gains: Gains | GainSchedule, subjects: Hand | StylusHand, conditions: Conditions
) -> BoolArray:
    """Whether each person comes to rest in every motion."""
    motions = motions_at(problem.device).values()
    runs = [judged(problem, gains, subjects, motion, conditions).stable for motion in motions]
    return np.asarray(np.all(runs, axis=0))
