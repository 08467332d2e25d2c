"""The estimator of the interaction frequency."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

from avc_casadi.problem import Problem
from avc_casadi.runtime import EstimatorSettings, estimator_step
from avc_casadi.scene.effects._base import SceneEffect, Station
from avc_casadi.scene.effects._step import insert
from avc_casadi.scene.loop import Tick


@dataclass(frozen=True)
class Estimator(SceneEffect):
    """Estimates the frequency from the velocity between samples.

    Attributes:
        method: name of the estimator.
        settings: what it takes for motion.
    """

    kind: ClassVar[str] = "estimator"
    station: ClassVar[Station] = Station.COMPUTATION

    method: str
    settings: EstimatorSettings

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:  # noqa: ARG003
        """Take the method; the floor stands above the noise of the encoder, where the scene has one."""
        encoders = [effect for effect in problem.scene.effects if effect.kind == "encoder"]
        resolution = problem.device.encoder_resolution_m if encoders else 0.0
        if encoders and encoders[0].resolution_m is not None:
            resolution = encoders[0].resolution_m
        device = problem.device
        seen = EstimatorSettings.for_encoder(resolution or 0.0, device.sample_time_s, device.metres_per_unit)
        return cls(table.method, seen)

    def sample(self, tick: Tick) -> None:
        """Add the estimator's states and the estimate."""
        before = tick.state("estimator_position_m", tick.start_m)
        tick.follow("estimator_position_m", tick.position)
        velocity = (tick.position - before) / tick.sample_time_s
        step = estimator_step(self.method, tick.sample_time_s, self.settings)
        tick.frequency_hz, tick.frequency_valid = insert(tick, "estimator", step, [velocity])[:2]
        tick.trace("interaction_hz", tick.frequency_hz)
