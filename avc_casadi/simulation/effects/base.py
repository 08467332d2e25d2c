"""Interface of the effects of a scene: station in the loop and contribution there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, ClassVar, Self

import numpy as np

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.arrays import FloatArray
from avc_casadi.model import EFFECTS
from avc_casadi.model.effects import Effect
from avc_casadi.model.plant import Plant
from avc_casadi.model.problem import Problem
from avc_casadi.simulation.tick import Tick


class Station(IntEnum):
    """Stations of the loop in the order in which a signal passes them, by the rank from which they begin."""

    MECHANICS = 0
    HAND = 40
    SENSING = 60
    COMPUTATION = 100
    ENVIRONMENT = 160
    GUARD = 180
    ACTUATION = 200


@dataclass(frozen=True)
class SceneEffect:
    """One effect with its numbers known; a subclass with the class of its table is in the registry `EFFECTS`."""

    kind: ClassVar[str]
    keys: ClassVar[type[Effect]]
    rank: ClassVar[float]  # its order in the loop
    station: ClassVar[Station]
    role: ClassVar[str] = ""  # effects of one role exclude each other
    of_coupling: ClassVar[bool] = False
    scene_alone: ClassVar[bool] = False  # certificates do not know it
    # Keys that must not be 0, with those of the device that are taken where the table leaves them out.
    device_keys: ClassVar[Mapping[str, str]] = {}

    def __init_subclass__(cls, *, keys: type[Effect] | None = None, rank: float = 0, **options: Any) -> None:
        """Add an effect to the registry: its table of keys, its place in the loop by `rank`, and options."""
        super().__init_subclass__()
        if keys is None:
            return
        cls.kind = keys.model_fields["kind"].default
        cls.keys = keys
        cls.rank = rank
        cls.station = max(station for station in Station if station <= rank)
        for name, value in options.items():
            setattr(cls, name, value)
        EFFECTS.add(cls.kind, cls, rank)

    @property
    def numbers(self) -> FloatArray:
        """Its parameters of a run, shape (n,) or (hands, n), in the order in which it adds them."""
        return np.zeros(0)

    def mechanics(self, plant: Plant) -> None:
        """Add masses, springs and dampers."""

    def sample(self, tick: Tick) -> None:
        """Add states, inputs and expressions to the sample."""


@dataclass(frozen=True)
class TableEffect(SceneEffect):
    """An effect whose numbers are those of its table."""

    table: Any

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        """Return the effect of a table; what that leaves out is taken from the device."""
        numbers = {
            key: positive_number(getattr(table, key), problem, f"{place}.{key}", source)
            for key, source in cls.device_keys.items()
        }
        return cls(table.model_copy(update=numbers))


def positive_number(value: float | None, problem: Problem, place: str, source: str = "") -> float:
    """Return a number of a table, or what the device declares as `source`; InputError unless one is above 0."""
    number: float | None = getattr(problem.device, source) if value is None and source else value
    if not number:
        state = "missing" if value is None else "0"
        and_device = f" and so is device.{source}" if source else ""
        allowed = f"above 0{f' here or in device.{source}' if source else ''}, or leave the effect out"
        raise InputError([Fault(problem.name or "problem", None, place, f"is {state}{and_device}; allowed: {allowed}")])
    return number
