"""An observer with a dead zone and state feedback."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

from avc_casadi._errors import Fault, InputError
from avc_casadi.problem import STATE_FEEDBACK_KEYS, Problem
from avc_casadi.problem import StateFeedback as Settings
from avc_casadi.runtime import state_feedback_step
from avc_casadi.scene.effects._base import SceneEffect, Station
from avc_casadi.scene.effects._step import insert
from avc_casadi.scene.loop import Tick
from avc_casadi.support import FloatArray


@dataclass(frozen=True)
class StateFeedback(SceneEffect):
    """Replaces the measured position by a weighted sum of what the observer believes.

    Attributes:
        settings: its matrices.
    """

    kind: ClassVar[str] = "state-feedback"
    station: ClassVar[Station] = Station.COMPUTATION

    settings: Settings

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        """Take the table; its rows must be of one size."""
        try:
            return cls(Settings(**{key: getattr(table, key) for key in STATE_FEEDBACK_KEYS}))
        except InputError as error:
            faults = [Fault(problem.name, None, f"{place}.{one.key}", one.message) for one in error.faults]
            raise InputError(faults) from None

    @property
    def numbers(self) -> FloatArray:
        """The matrices: scenes with others of the same size are the same code."""
        return self.settings.numbers()

    def sample(self, tick: Tick) -> None:
        """Replace the position."""
        step = state_feedback_step(self.settings)
        numbers = tuple(tick.parameter(f"state_feedback_{name}") for name in step.parameters)
        tick.position = insert(tick, "state_feedback", step, [tick.position, tick.asked_force()], numbers)[0]
