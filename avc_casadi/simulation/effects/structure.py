"""A further resonance of the device, of a part away from the hand: a stage, a link, a cover."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.units import MASS, spoken_key
from avc_casadi.model.effects import EffectTable, StructureEffect
from avc_casadi.model.plant import Plant
from avc_casadi.model.problem import Problem
from avc_casadi.simulation.effects.base import SceneEffect, Station


@dataclass(frozen=True)
class Structure(SceneEffect):
    """A share of the device's mass on a spring beside the motor; sensor, actuator and hand are not on it.

    Attributes:
        frequency_hz: frequency of motor and part against each other, free of other loads.
        damping_ratio: damping of that mode, as a share of the critical.
        mass_ratio: share of the device's mass on the part.
    """

    kind: ClassVar[str] = "structure"
    keys: ClassVar[type[EffectTable]] = StructureEffect
    rank: ClassVar[float] = 5
    scene_alone: ClassVar[bool] = True
    station: ClassVar[Station] = Station.MECHANICS

    frequency_hz: float
    damping_ratio: float
    mass_ratio: float

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        """Build it from the table; a device without mass has no such part."""
        if problem.device.mass_kg == 0:
            message = (
                f"needs {spoken_key('device.mass_kg')} above 0; leave the effect out or give the device its {MASS}"
            )
            raise InputError([Fault(problem.name, None, place, message)])
        return cls(table.frequency_hz, table.damping_ratio, table.mass_ratio)

    def mechanics(self, plant: Plant) -> None:
        """Move a share of the device's mass to a separate body."""
        plant.hang(self.kind, self.frequency_hz, self.damping_ratio, self.mass_ratio)
