"""Dry friction between device and ground, with true sticking."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Self

from avc_casadi._errors import Fault, InputError
from avc_casadi.model.effects import (
    BacklashEffect,
    CoulombFrictionEffect,
    EffectTable,
    ResonanceEffect,
    ViscousFrictionEffect,
)
from avc_casadi.model.plant import DEVICE, GROUND, Plant
from avc_casadi.model.problem import Problem
from avc_casadi.simulation.effects.base import SceneEffect, Station, required_number
from avc_casadi.simulation.tick import Tick


@dataclass(frozen=True)
class Backlash(SceneEffect):
    """The encoder at the motor follows the position only beyond half the play either way: a hysteresis (play operator).

    The force passes without play, as in a gear under load; the play is taken up at the samples. A dead zone of the
    force would need the stiffness of the gear's flanks, which is not declared.
    """

    kind: ClassVar[str] = "backlash"
    keys: ClassVar[type[EffectTable]] = BacklashEffect
    rank: ClassVar[float] = 60
    scene_alone: ClassVar[bool] = True
    station: ClassVar[Station] = Station.SENSING

    gap_m: float

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        """Build it; missing numbers are taken from the device."""
        source, default = "device.backlash_m", problem.device.backlash_m
        return cls(required_number(table.gap_m, default, key="gap_m", place=place, problem=problem, source=source))

    def sample(self, tick: Tick) -> None:
        """Follow the position with play."""
        import casadi as ca  # noqa: PLC0415

        name = "backlash_position_m"
        before = tick.state(name, tick.start_m, computed=False)
        half = self.gap_m / 2
        tick.position = ca.fmax(ca.fmin(before, tick.position + half), tick.position - half)
        tick.follow(name, tick.position)


@dataclass(frozen=True)
class Resonance(SceneEffect):
    """The device's mass split in two: sensor and actuator on one, the hand on the other."""

    kind: ClassVar[str] = "resonance"
    keys: ClassVar[type[EffectTable]] = ResonanceEffect
    rank: ClassVar[float] = 10
    scene_alone: ClassVar[bool] = True
    station: ClassVar[Station] = Station.MECHANICS

    frequency_hz: float
    damping_ratio: float
    mass_ratio: float

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        """Build it; missing numbers are taken from the device; a device without mass has no resonance."""
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
        """Move a share of the device's mass to a second body, at the hand."""
        plant.split(self.frequency_hz, self.damping_ratio, self.mass_ratio)


@dataclass(frozen=True)
class ViscousFriction(SceneEffect):
    """A damper between device and ground, in addition to ``device.damping_ns_per_m``."""

    kind: ClassVar[str] = "viscous-friction"
    keys: ClassVar[type[EffectTable]] = ViscousFrictionEffect
    rank: ClassVar[float] = 20
    scene_alone: ClassVar[bool] = True
    station: ClassVar[Station] = Station.MECHANICS

    damping_ns_per_m: float

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        """Build it from the table; the damping of the device model is not counted twice."""
        key = "damping_ns_per_m"
        return cls(required_number(table.damping_ns_per_m, None, key=key, place=place, problem=problem, source=""))

    def mechanics(self, plant: Plant) -> None:
        """Add the damper."""
        plant.join(DEVICE, GROUND, 0.0, self.damping_ns_per_m)


@dataclass(frozen=True)
class CoulombFriction(SceneEffect):
    """A force of constant magnitude against the velocity; at rest it balances the load up to that magnitude."""

    kind: ClassVar[str] = "coulomb-friction"
    keys: ClassVar[type[EffectTable]] = CoulombFrictionEffect
    rank: ClassVar[float] = 30
    station: ClassVar[Station] = Station.MECHANICS

    force_n: float

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        """Build it; missing numbers are taken from the device."""
        source, default = "device.coulomb_friction_n", problem.device.coulomb_friction_n
        return cls(required_number(table.force_n, default, key="force_n", place=place, problem=problem, source=source))

    @property
    def friction_n(self) -> float:
        """Its magnitude."""
        return self.force_n
