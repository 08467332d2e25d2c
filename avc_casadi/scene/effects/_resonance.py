"""A structural resonance: the handle hangs on the device by a spring."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

from avc_casadi._errors import Fault, InputError
from avc_casadi.loop import Plant
from avc_casadi.problem import Problem
from avc_casadi.scene.effects._base import SceneEffect, Station


@dataclass(frozen=True)
class Resonance(SceneEffect):
    """The device's mass split in two: sensor and actuator on one, the hand on the other.

    Attributes:
        frequency_hz: frequency of the two masses against each other, the device free.
        damping_ratio: damping of that mode, as a share of the critical.
        mass_ratio: share of the device's mass on the side of the hand.
    """

    kind: ClassVar[str] = "resonance"
    station: ClassVar[Station] = Station.MECHANICS

    frequency_hz: float
    damping_ratio: float
    mass_ratio: float

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        """Take what is left out from the device; a device without mass has no resonance."""
        keys = ("frequency_hz", "damping_ratio", "mass_ratio")
        declared = [getattr(problem.device.resonance, key, None) for key in keys]
        values = [getattr(table, key) for key in keys]
        values = [default if value is None else value for value, default in zip(values, declared, strict=True)]
        faults = [
            Fault(
                problem.name,
                None,
                f"{place}.{key}",
                f"is missing and so is device.resonance.{key}; allowed: one of both",
            )
            for key, value in zip(keys, values, strict=True)
            if value is None
        ]
        frequency, damping, mass_ratio = values
        if mass_ratio is not None and not 0 < mass_ratio < 1:
            message = f"is {mass_ratio}; allowed: above 0 and below 1, the share on the side of the hand"
            faults.append(Fault(problem.name, None, f"{place}.mass_ratio", message))
        if problem.device.mass_kg == 0:
            message = "needs device.mass_kg above 0; leave the effect out or give the device its mass"
            faults.append(Fault(problem.name, None, place, message))
        if faults:
            raise InputError(faults)
        return cls(frequency, damping, mass_ratio)

    def mechanics(self, plant: Plant) -> None:
        """Move a share of the device's mass to a second body, which the hand holds."""
        plant.split(self.frequency_hz, self.damping_ratio, self.mass_ratio)
