"""An observer of the position between two encoder steps, and over a delay."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

from avc_casadi._errors import Fault, InputError
from avc_casadi.problem import Problem
from avc_casadi.runtime import ObserverSettings, observer_step
from avc_casadi.scene.effects._base import SceneEffect, Station, required_number
from avc_casadi.scene.effects._step import insert
from avc_casadi.scene.loop import Tick

# A mass taken too small turns every force into too much motion; far above the lightest, light hands buzz.
_ABOVE = 1.07


@dataclass(frozen=True)
class Observer(SceneEffect):
    """Replaces the counted position by one that the commanded forces explain, at the time when the next one acts.

    Attributes:
        settings: what it knows.
        late: whether the loop has a delay: the force that acts is not the one that was asked for.
    """

    kind: ClassVar[str] = "observer"
    station: ClassVar[Station] = Station.SENSING

    settings: ObserverSettings
    late: bool = False

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        """Take step and delay from the loop, and the mass from the device and the lightest hand, if left out."""
        encoder = next((effect for effect in problem.scene.effects if effect.kind == "encoder"), None)
        if encoder is None:
            message = "has no steps to look between; allowed: beside the effect encoder"
            raise InputError([Fault(problem.name, None, place, message)])
        source, default = "device.encoder_resolution_m", problem.device.encoder_resolution_m
        told = encoder.resolution_m if table.resolution_m is None else table.resolution_m
        resolution = required_number(told, default, key="resolution_m", place=place, problem=problem, source=source)
        lightest = problem.device.mass_kg + problem.hands.mass_kg[0]
        source = "that of device and lightest hand"
        mass = required_number(
            table.mass_kg, _ABOVE * lightest, key="mass_kg", place=place, problem=problem, source=source
        )
        delay = next((effect for effect in problem.scene.effects if effect.kind == "delay"), None)
        late = 0 if delay is None else delay.samples or problem.device.delay_samples
        ahead = late if table.ahead_samples is None else table.ahead_samples
        return cls(ObserverSettings(resolution, mass, float(ahead)), bool(late))

    def sample(self, tick: Tick) -> None:
        """Replace the position."""
        step = observer_step(tick.sample_time_s, self.settings)
        force = tick.asked_force() if self.settings.ahead or self.late else tick.held_force()
        tick.position = insert(tick, "observer", step, [tick.position, force])[0]
