"""Interface of the effects of a scene: station in the loop and contribution there."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, ClassVar, Self

import numpy as np

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.arrays import FloatArray
from avc_casadi.model.effects import EffectTable
from avc_casadi.model.gains import GainTable
from avc_casadi.model.plant import Plant
from avc_casadi.model.problem import Problem
from avc_casadi.model.registries import EFFECTS
from avc_casadi.simulation.contact import Environment
from avc_casadi.simulation.runtime.step import Step
from avc_casadi.simulation.tick import Expr, Tick


def insert(tick: Tick, prefix: str, step: Step, inputs: list[Expr], parameters: tuple[Expr, ...] = ()) -> list[Expr]:
    """Add a step's states to the sample and return its outputs."""
    names = [f"{prefix}_{name}" for name in step.states]
    state = [tick.state(name, initial) for name, initial in zip(names, step.initial, strict=True)]
    following, outputs = step.apply(state, inputs, list(parameters))
    for name, value in zip(names, following, strict=True):
        tick.follow(name, value)
    return outputs


class Station(IntEnum):
    """Stations of the loop in the order in which a signal passes them."""

    MECHANICS = 0
    HAND = 1
    SENSING = 2
    COMPUTATION = 3
    ENVIRONMENT = 4
    GUARD = 5
    ACTUATION = 6


@dataclass(frozen=True)
class SceneEffect(ABC):
    """One effect with its numbers resolved. A subclass that gives its kind is in the registry `EFFECTS`."""

    kind: ClassVar[str]
    keys: ClassVar[type[EffectTable]]
    rank: ClassVar[float]
    station: ClassVar[Station]
    role: ClassVar[str] = ""
    of_coupling: ClassVar[bool] = False
    scene_alone: ClassVar[bool] = False

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if "kind" in vars(cls):
            EFFECTS.add(cls.kind, cls, cls.rank)

    @classmethod
    @abstractmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        """Resolve the numbers: what the table leaves out is taken from the problem."""

    @property
    def environment(self) -> Environment | None:
        """The virtual environment, of the effect that defines one."""
        return None

    @property
    def gain_table(self) -> GainTable | None:
        """The table from which it sets the gains of the coupling at every sample."""
        return None

    @property
    def sensed_body(self) -> str | None:
        """The body whose position is measured; None leaves it to other effects."""
        return None

    @property
    def numbers(self) -> FloatArray:
        """Its parameters of a run, in the order in which it adds them to the sample; none where they are constants.

        Shape (n,), or (hands, n) where they differ between hands.
        """
        return np.zeros(0)

    @property
    def friction_n(self) -> float:
        """Dry friction between device and ground."""
        return 0.0

    def mechanics(self, plant: Plant) -> None:  # noqa: B027 - most effects add nothing here
        """Add masses, springs and dampers."""

    def sample(self, tick: Tick) -> None:  # noqa: B027 - nor here
        """Add states, inputs and expressions to the sample."""


def required_number(
    value: float | None, default: float | None, *, key: str, place: str, problem: Problem, source: str
) -> float:
    """Return the value of a table or its default, which must not both be 0."""
    number = default if value is None else value
    if not number:
        message = f"is {'missing' if value is None else '0'}{f' and so is {source}' if source else ''}; allowed: "
        message += f"above 0{f' here or in {source}' if source else ''}, or leave the effect out"
        raise InputError([Fault(problem.name or "problem", None, f"{place}.{key}", message)])
    return number
