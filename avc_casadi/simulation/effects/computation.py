"""Effects of the control computer: observers, estimator of the frequency, adaptation and guard."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from avc_casadi._errors import InputError
from avc_casadi._util.arrays import FloatArray
from avc_casadi.model.effects import (
    AdaptationEffect,
    DelayEffect,
    EncoderEffect,
    EstimatorEffect,
    GuardEffect,
    ObserverEffect,
)
from avc_casadi.model.gains import GainTable
from avc_casadi.model.problem import Problem
from avc_casadi.model.runtime import StateFeedback as StateFeedbackEffect
from avc_casadi.simulation.effects.base import SceneEffect, TableEffect, positive_number
from avc_casadi.simulation.runtime.adaptation import AdaptationSettings, adaptation_step, guard_step, hold_step
from avc_casadi.simulation.runtime.estimators import EstimatorSettings, estimator_step
from avc_casadi.simulation.runtime.observer import ObserverSettings, observer_step, state_feedback_step
from avc_casadi.simulation.tick import Expr, Tick, TickGains, ca, insert


@dataclass(frozen=True)
class Guard(SceneEffect, keys=GuardEffect, rank=190, of_coupling=True):
    """Monitors the energy through the held force and acts on a deficit."""

    method: str
    damping_limit_ns_per_m: float

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        del place
        return cls(table.method, problem.device.damping_ns_per_m)

    def sample(self, tick: Tick) -> None:
        if tick.command is None:
            return
        step = guard_step(self.method, tick.sample_time_s, self.damping_limit_ns_per_m)
        stored = tick.environment_energy_j + tick.coupling_energy_j
        outputs = insert(tick, "guard", step, [tick.command, tick.position, stored, tick.previous_force(delayed=True)])
        tick.command = outputs["force_n"]
        tick.trace("guard_reserve_j", outputs["reserve_j"])


class SceneStateFeedback(TableEffect, keys=StateFeedbackEffect, rank=120, role="observer", of_coupling=True):
    """Replaces the measured position by a weighted sum of the observer's states."""

    @property
    def numbers(self) -> FloatArray:
        """The matrices: scenes with others of the same size share their code."""
        return np.asarray(self.table.numbers())

    def sample(self, tick: Tick) -> None:
        step = state_feedback_step(self.table)
        numbers = [tick.parameter(f"state_feedback_{name}") for name in step.parameters]
        inputs = [tick.position, tick.previous_force(delayed=False)]
        tick.position = insert(tick, "state_feedback", step, inputs, numbers)["position_m"]
        tick.observing = tick.find_state("state_feedback_started")


OVER_LIGHTEST = 1.07
"""Default mass of an observer over that of the device and the lightest hand.

Too small a mass predicts too much motion; far above the lightest hand's, light hands buzz."""


@dataclass(frozen=True)
class Observer(SceneEffect, keys=ObserverEffect, rank=90, role="observer", of_coupling=True):
    """Replaces the counted position by one predicted from the commanded forces, at the time when the next one acts."""

    settings: ObserverSettings
    late: bool = False

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        """Build it; missing step and delay are taken from the loop, the mass from the device and the lightest hand."""
        encoder = next((effect for effect in problem.scene.effects if isinstance(effect, EncoderEffect)), None)
        if encoder is None:
            message = "needs encoder steps; add the effect encoder"
            raise InputError.of(message, file=problem.name, key=place)
        step_m = encoder.resolution_m if table.resolution_m is None else table.resolution_m
        resolution = positive_number(step_m, problem, f"{place}.resolution_m", "encoder_resolution_m")
        usual_kg = OVER_LIGHTEST * (problem.device.mass_kg + problem.hands.mass_kg[0])
        mass = positive_number(usual_kg if table.mass_kg is None else table.mass_kg, problem, f"{place}.mass_kg")
        delay = next((effect for effect in problem.scene.effects if isinstance(effect, DelayEffect)), None)
        late = 0 if delay is None else delay.samples or problem.device.delay_samples
        ahead = late if table.ahead_samples is None else table.ahead_samples
        return cls(ObserverSettings(resolution, mass, float(ahead)), bool(late))

    def sample(self, tick: Tick) -> None:
        step = observer_step(tick.sample_time_s, self.settings)
        force = tick.previous_force(delayed=not (self.settings.ahead or self.late))
        tick.position = insert(tick, "observer", step, [tick.position, force])["position_m"]


@dataclass(frozen=True)
class Adaptation(SceneEffect, keys=AdaptationEffect, rank=150, of_coupling=True):
    """Look-up with hold and decay, slew limit and passive change."""

    hold_s: float
    settings: AdaptationSettings
    gain_table: GainTable | None = None

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        if not any(effect.kind == "estimator" for effect in problem.scene.effects):
            message = "needs an estimate; add the effect estimator"
            raise InputError.of(message, file=problem.name, key=place)
        return cls(table.hold_s, AdaptationSettings(table.slew_per_s, table.passive))

    def sample(self, tick: Tick) -> None:
        """Look up the gains; they take effect when the coupling reads them."""
        if self.gain_table is None:
            return
        rows = self.gain_table
        step = hold_step(tick.sample_time_s, self.hold_s)
        # Without an estimator, as where its effect is screened, the gains are those at rest.
        estimate = [0.0, 0.0] if tick.frequency_hz is None else [tick.frequency_hz, tick.frequency_valid]
        target = rows.expressions(insert(tick, "hold", step, estimate, [rows.rest_hz])["frequency_hz"])
        rest = rows.rest_stiffness_n_per_m
        tick.adapt = lambda deflection, one_sided: self._change(tick, target, rest, deflection, one_sided=one_sided)

    def _change(self, tick: Tick, target: list[Expr], rest: Expr, deflection: Expr, *, one_sided: bool) -> TickGains:
        """Return the gains of this sample, on their way to the target within slew limit and passivity.

        With passive change, the energy stored in coupling and wall limits how fast gains may rise.
        """
        inputs = [*target, deflection]
        touching: Expr = 1
        if self.settings.passive:
            environment = tick.state("environment_energy_j")
            tick.at_end.append(lambda: tick.follow("environment_energy_j", tick.environment_energy_j))
            touching = tick.position > 0 if one_sided else 1
            depth = ca.fmax(tick.position, 0) if one_sided else tick.position
            inputs += [environment, tick.previous_force(delayed=False), depth, touching, rest]
        outputs = insert(tick, "adaptation", adaptation_step(tick.sample_time_s, self.settings), inputs)
        names = ("damping_ns_per_m", "stiffness_n_per_m", "contact_damping_ns_per_m", "anchor_m")
        for name in names:
            tick.trace(name, outputs[name])
        return TickGains(**{name: outputs[name] for name in names}, touching=touching)


@dataclass(frozen=True)
class Estimator(SceneEffect, keys=EstimatorEffect, rank=140, of_coupling=True):
    """Estimates the frequency from the velocity between samples."""

    method: str
    settings: EstimatorSettings

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:  # noqa: ARG003
        """Build it from the table; the floor lies above the noise of the encoder, where the scene has one."""
        encoders = [effect for effect in problem.scene.effects if isinstance(effect, EncoderEffect)]
        resolution = problem.device.encoder_resolution_m if encoders else 0.0
        if encoders and encoders[0].resolution_m is not None:
            resolution = encoders[0].resolution_m
        device = problem.device
        settings = EstimatorSettings.for_encoder(resolution or 0.0, device.sample_time_s, device.metres_per_unit)
        return cls(table.method, settings)

    def sample(self, tick: Tick) -> None:
        before = tick.state("estimator_position_m", tick.start_m)
        tick.follow("estimator_position_m", tick.position)
        velocity = (tick.position - before) / tick.sample_time_s
        step = estimator_step(self.method, tick.sample_time_s, self.settings)
        outputs = insert(tick, "estimator", step, [velocity])
        tick.frequency_hz, tick.frequency_valid = outputs["frequency_hz"], outputs["valid"]
        tick.trace("interaction_hz", tick.frequency_hz)
