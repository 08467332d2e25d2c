"""The compiled scene of a trial, shared by couplings of one structure."""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from avc_casadi.model.gains import Gains
from avc_casadi.model.scene import Scene
from avc_casadi.simulation.compile import CompiledScene
from avc_casadi.simulation.effects.registry import build_effects
from avc_casadi.simulation.effects.sensing import Encoder
from avc_casadi.simulation.scene import compile_for, held_by, settled

if TYPE_CHECKING:
    from avc_casadi._util.arrays import FloatArray
    from avc_casadi.model.gains import GainTable
    from avc_casadi.model.hands import Hand, StylusHand
    from avc_casadi.model.problem import Problem
    from avc_casadi.model.runtime import StateFeedback
    from avc_casadi.model.scene import Motion
    from avc_casadi.model.schedule import GainSchedule
    from avc_casadi.simulation.effects.base import SceneEffect
    from avc_casadi.simulation.population.trial import Conditions

# Friction projections per sample: several times quicker for a stylus hand than exact events, with the same share of
# stable hands (58.8 against 59.8 % of 500 where they differ most).
_FRICTION_SUBSTEPS = 4
# Multiples of a hand's parameters whose fractional parts scatter evenly (low discrepancy).
_SCATTER, _PRIMES = 1e3, (2, 3, 5, 7, 11)
# Cached scenes: all motions, of usual and long duration, with and without friction, on some two dozen devices of the
# ranges.
_KEPT = 512

Prepared: TypeAlias = tuple[CompiledScene, "FloatArray", "FloatArray"]
"""A scene, the parameters of each hand, and the inputs common to all."""


def prepared(
    problem: Problem,
    gains: Gains | GainTable | GainSchedule,
    subjects: Hand | StylusHand,
    motion: Motion,
    conditions: Conditions,
    duration_s: float,
) -> Prepared:
    """Return the scene, the parameters of each hand and the common inputs; arguments as for `simulations`."""
    if isinstance(gains, Gains):
        law = conditions.state_feedback
        structure = None if law is None else (law.states, law.positions, law.measures)
        coupling = (not gains.rigid, gains.stiffness_n_per_m > 0, gains.contact_damping_ns_per_m > 0)
        key = (problem, people_key(subjects), motion, duration_s, replace(conditions, state_feedback=None))

        def build() -> CompiledScene:
            effects, run = _staged(problem, subjects, motion, conditions, (), duration_s)
            return compile_for(run, effects, gains)

        compiled, inputs = shared(Shared((*key, structure, coupling), build))
        compiled = replace(compiled, effects=with_law(compiled.effects, law))
        return compiled, compiled.parameter_values(gains), inputs
    effects, run = _staged(problem, subjects, motion, conditions, conditions.runtime, duration_s)
    effects, chosen, _ = settled(run, effects, gains)
    compiled = compile_for(run, effects, chosen)
    return compiled, compiled.parameter_values(chosen), compiled.input_values()


def with_law(effects: tuple[SceneEffect, ...], law: StateFeedback | None) -> tuple[SceneEffect, ...]:
    """Return the effects with the numbers of another state feedback."""
    settings = {} if law is None else {"settings": law}
    return tuple(replace(one, **settings) if one.kind == "state-feedback" else one for one in effects)


@dataclass(frozen=True)
class Shared:
    """A scene that all of its structure share; the first builds it."""

    key: tuple[Any, ...]
    build: Callable[[], CompiledScene] = field(compare=False)


@lru_cache(_KEPT)
def shared(scene: Shared) -> tuple[CompiledScene, FloatArray]:
    """Return a scene with its inputs, compiled once."""
    compiled = scene.build()
    return compiled, compiled.input_values()


def people_key(subjects: Hand | StylusHand) -> tuple[Any, ...]:
    """Return hands as a key."""
    return type(subjects), *(np.asarray(one).tobytes() for one in vars(subjects).values())


def _staged(
    problem: Problem,
    subjects: Hand | StylusHand,
    motion: Motion,
    conditions: Conditions,
    runtime: tuple[Any, ...],
    duration_s: float,
) -> tuple[tuple[SceneEffect, ...], Problem]:
    """Return the effects with all hands in place of the declared one, and the problem with the scene."""
    how: dict[str, Any] = (
        {"integrator": "projected", "substeps": _FRICTION_SUBSTEPS} if conditions.friction_n > 0 else {}
    )
    scene = Scene(duration_s=duration_s, motion=motion, effects=conditions.effects() + runtime, **how)
    run = problem.changed(scene=scene)
    effects = held_by(run, build_effects(run), subjects)
    if conditions.steps_anywhere:
        phase = _phases(subjects, motion)
        effects = tuple(replace(one, phase=phase) if isinstance(one, Encoder) else one for one in effects)
    return effects, run


def _phases(subjects: Hand | StylusHand, motion: Motion) -> FloatArray:
    """Return the phase of the wall's face between two encoder steps, by hand and motion.

    It depends on the hand alone, so that the other hands of a run change nothing.
    """
    begin = zlib.crc32(motion.model_dump_json().encode()) / 2**32
    values = (np.atleast_1d(np.asarray(value, dtype=np.float64)) for value in vars(subjects).values())
    turned = sum(_SCATTER * math.sqrt(prime) * value for prime, value in zip(_PRIMES, values, strict=False))
    return np.asarray((begin + turned) % 1.0)
