"""What many hands try: a coupling on its device with the simulated effects, compiled once for all of its structure."""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache, partial
from typing import Any

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.coupling import Coupling
from avc_casadi.model import EFFECTS
from avc_casadi.model.declared import declared_effects
from avc_casadi.model.device import Device
from avc_casadi.model.effects import Effect, ObserverEffect
from avc_casadi.model.gains import Gains, GainSchedule, GainTable
from avc_casadi.model.hands import Hand, StylusHand
from avc_casadi.model.problem import Problem
from avc_casadi.model.runtime import StateFeedback
from avc_casadi.model.scene import Motion, Scene
from avc_casadi.simulation.compile import CompiledScene, build_effects, compile_scene
from avc_casadi.simulation.effects.base import SceneEffect
from avc_casadi.simulation.effects.interface import Encoder
from avc_casadi.simulation.execute import execute
from avc_casadi.simulation.judge import Judgement, Traces
from avc_casadi.simulation.scene import resolve, with_hand

FRICTION = "coulomb-friction"
HANDS_AT_ONCE = 250
"""Hands simulated at a time."""
NUMBERS_AT_ONCE = 4_000_000
"""Samples of all hands simulated at a time, which bounds the memory of a long motion."""
DURATION_S = 3.0
FRICTION_STEP_M_PER_S = 1e-3
"""Change of speed by friction in a substep: a fifth of the speed below which a device counts as at rest."""
FEWEST_SUBSTEPS = 4
MOST_SUBSTEPS = 32
"""A bound on the time of a trial: only a device below 50 g with 1 N of friction would have more."""
"""Duration of a motion."""
_SCATTER = 1e3
"""Multiple of a hand's numbers whose fractional part scatters over an encoder step."""


@dataclass(frozen=True)
class Setup:
    """A device, gains, and the effects of a scene with a hand; encoders may stand anywhere between two steps."""

    problem: Problem
    gains: Gains | GainTable | GainSchedule
    effects: tuple[Effect, ...]
    law: StateFeedback | None = None
    steps_anywhere: bool = True

    @classmethod
    def of(cls, coupling: Coupling, device: Device | None = None, effects: tuple[Effect, ...] = ()) -> Setup:
        """Take a coupling's runtime and all that its problem declares, or another device; the controller stays."""
        problem, nominal = coupling.problem, coupling.problem.device
        problem = problem if device is None else problem.changed(device=device)
        table, law = coupling.table, coupling.runtime.state_feedback
        declared = [effect for effect in declared_effects(problem) if effect.kind != "detent"]
        has_steps = problem.device.encoder_resolution_m > 0
        for effect in coupling.runtime.model_copy(update={"state_feedback": None}).effects(constant=table.constant):
            if not isinstance(effect, ObserverEffect):
                declared.append(effect)
            elif has_steps:
                numbers = {
                    "resolution_m": nominal.encoder_resolution_m or None,
                    "ahead_samples": nominal.delay_samples,
                }
                declared.append(effect.model_copy(update=numbers))
        return cls(problem, table.at_rest if table.constant else table, (*declared, *effects), law)

    def without(self, kind: str) -> Setup:
        """Return the same without an effect."""
        return replace(self, effects=tuple(effect for effect in self.effects if effect.kind != kind))

    @property
    def rough(self) -> bool:
        """Whether there is dry friction."""
        return any(effect.kind == FRICTION for effect in self.effects)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of the effects in the order of the loop."""
        law = () if self.law is None else ("state-feedback",)
        return tuple(sorted((*(effect.kind for effect in self.effects), *law), key=list(EFFECTS).index))

    def stage(
        self, hands: Hand | StylusHand, motion: Motion, duration_s: float
    ) -> tuple[Problem, tuple[SceneEffect, ...]]:
        """Return the problem with the scene, and the effects with all hands in place of the declared one."""
        law = () if self.law is None else (self.law,)
        # Several times quicker for a stylus hand than exact events, with the same share of stable hands (58.8 against
        # 59.8 % of 500 where they differ most).
        how: dict[str, Any] = {}
        if self.rough:
            how = {"integrator": "projected", "substeps": friction_substeps(self.problem.device)}
        scene = Scene(duration_s=duration_s, motion=motion, effects=(*self.effects, *law), **how)
        run = self.problem.changed(scene=scene)
        effects = with_hand(run, build_effects(run), hands)
        if self.steps_anywhere:
            phase = _phases(hands, motion)
            effects = tuple(
                replace(effect, phase=phase) if isinstance(effect, Encoder) else effect for effect in effects
            )
        return run, effects


def friction_substeps(device: Device) -> int:
    """Return in how many parts of a sample dry friction is projected.

    In a part h friction changes the speed of the motor by fc h/m at most, and brings it to rest where that suffices. A
    part is so short that this is `FRICTION_STEP_M_PER_S` at the rim: longer ones stop a device that swings on.
    """
    share = 0.0 if device.resonance is None else device.resonance.mass_ratio
    motor_kg = (1 - share) * device.mass_kg
    change_per_s = device.coulomb_friction_n * device.sample_time_s / motor_kg if motor_kg > 0 else math.inf
    parts = change_per_s * device.metres_per_unit / FRICTION_STEP_M_PER_S
    return math.ceil(min(max(parts, FEWEST_SUBSTEPS), MOST_SUBSTEPS))


def _phases(hands: Hand | StylusHand, motion: Motion) -> FloatArray:
    """Return the phase of the wall's face between two encoder steps by motion and hand, whoever else is there."""
    values = np.array([np.atleast_1d(value) for value in vars(hands).values()], dtype=np.float64)
    # Multiples whose fractional parts scatter evenly (low discrepancy); equal hands, as none, by their number.
    primes = np.sqrt([2, 3, 5, 7, 11])[: len(values)]
    of_motion = zlib.crc32(motion.model_dump_json().encode()) / 2**32
    first, group = np.unique(values, axis=1, return_index=True, return_inverse=True)[1:]
    number_among_equals = np.arange(len(group)) - first[group]
    return np.asarray((of_motion + _SCATTER * primes @ values + math.sqrt(2) * number_among_equals) % 1.0)


@dataclass(frozen=True)
class _SceneKey:
    """A scene that all of its structure share; the first builds it."""

    key: tuple[Any, ...]
    build: Callable[[], CompiledScene] = field(compare=False)


# All motions, of usual and long duration, with and without friction, on some two dozen devices of the ranges.
@lru_cache(512)
def _compile(key: _SceneKey) -> tuple[CompiledScene, FloatArray]:
    scene = key.build()
    return scene, scene.input_values()


def prepare(
    setup: Setup, hands: Hand | StylusHand, motion: Motion, duration_s: float
) -> tuple[CompiledScene, FloatArray, FloatArray]:
    """Return the scene, the parameters of each hand and the common inputs; constant gains of one structure share it."""
    gains, law = setup.gains, setup.law
    if not isinstance(gains, Gains):
        run, effects = setup.stage(hands, motion, duration_s)
        effects, at_start, _ = resolve(run, effects, gains)
        scene = compile_scene(run, effects, at_start)
        return scene, scene.parameter_values(at_start), scene.input_values()
    structure = (
        None if law is None else (law.states, law.positions, law.measures),
        (not gains.rigid, gains.stiffness_n_per_m > 0, gains.contact_damping_ns_per_m > 0),
    )
    hand_values = type(hands), *(np.asarray(getattr(hands, field.name)).tobytes() for field in fields(hands))
    key = (setup.problem, setup.effects, setup.steps_anywhere, structure, hand_values, motion, duration_s)
    scene, inputs = _compile(_SceneKey(key, lambda: compile_scene(*setup.stage(hands, motion, duration_s), gains)))
    if law is not None:
        scene = scene.with_numbers("state-feedback", table=law)
    return scene, scene.parameter_values(gains), inputs


def simulations(
    setup: Setup, hands: Hand | StylusHand, motion: Motion, duration_s: float = DURATION_S
) -> Iterator[Callable[[], Traces]]:
    """Prepare to simulate all hands, in blocks; each block is simulated when it is called."""
    scene, parameters, inputs = prepare(setup, hands, motion, duration_s)

    def traces_of(block: FloatArray) -> Traces:
        return Traces.of(execute(scene, block, inputs), setup.problem.device)

    at_once = _at_once(inputs.shape[-1])
    for first in range(0, len(parameters), at_once):
        yield partial(traces_of, parameters[first : first + at_once])


def _at_once(samples: int) -> int:
    """Return how many hands are simulated at a time over so many samples."""
    return min(HANDS_AT_ONCE, max(1, NUMBERS_AT_ONCE // samples))


def block_count(hands: int, duration_s: float, sample_time_s: float) -> int:
    """Return in about how many blocks hands are simulated."""
    return math.ceil(hands / _at_once(max(1, round(duration_s / sample_time_s))))


def traces(setup: Setup, hands: Hand | StylusHand, motion: Motion, duration_s: float = DURATION_S) -> Iterator[Traces]:
    """Simulate all hands, in blocks."""
    return (simulation() for simulation in simulations(setup, hands, motion, duration_s))


def judge(setup: Setup, hands: Hand | StylusHand, motion: Motion, duration_s: float = DURATION_S) -> Judgement:
    """Return the verdicts of all hands; every array has shape (hands,)."""
    return Judgement.join([part.judge() for part in traces(setup, hands, motion, duration_s)])
