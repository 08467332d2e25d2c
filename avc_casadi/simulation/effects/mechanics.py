"""Effects of the mechanics: the hand, resonance, friction, and play before the encoder."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Self

from avc_casadi._errors import Fault, InputError
from avc_casadi.model.effects import (
    BacklashEffect,
    CoulombFrictionEffect,
    HandEffect,
    ResonanceEffect,
    StylusHandEffect,
    ViscousFrictionEffect,
)
from avc_casadi.model.hands import Hand, StylusHand
from avc_casadi.model.plant import DEVICE, GROUND, Plant
from avc_casadi.model.problem import Problem
from avc_casadi.simulation.effects.base import SceneEffect, TableEffect, positive_number
from avc_casadi.simulation.tick import Tick, ca


@dataclass(frozen=True)
class Grip(SceneEffect, keys=HandEffect, rank=40, role="hand"):
    """The hand at the device; an array of hands stands for as many scenes."""

    hand: Hand | StylusHand

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:  # noqa: ARG003
        values = {item.name: getattr(table, item.name) for item in fields(Hand)}
        missing = [key for key, value in values.items() if value is None]
        return cls(Hand(**(values | {key: sum(getattr(problem.hands, key)) / 2 for key in missing})))

    def mechanics(self, plant: Plant) -> None:
        self.hand.mechanics(plant)


@dataclass(frozen=True)
class StylusGrip(Grip, keys=StylusHandEffect, rank=50, role="hand"):
    """The same with a hand on a stylus."""

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        positive_number(table.mass_kg, problem, f"{place}.mass_kg")
        return cls(StylusHand(**{item.name: getattr(table, item.name) for item in fields(StylusHand)}))


class Backlash(TableEffect, keys=BacklashEffect, rank=60, scene_alone=True, device_keys={"gap_m": "backlash_m"}):
    """The encoder at the motor follows the position only beyond half the play: a hysteresis (play operator)."""

    def sample(self, tick: Tick) -> None:
        name = "backlash_position_m"
        before = tick.state(name, tick.start_m, computed=False)
        half = self.table.gap_m / 2
        tick.position = ca.fmax(ca.fmin(before, tick.position + half), tick.position - half)
        tick.follow(name, tick.position)


class SceneResonance(TableEffect, keys=ResonanceEffect, rank=10, scene_alone=True):
    """The device's mass split in two: sensor and actuator on one, the hand on the other."""

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        """Build it; missing numbers are taken from the device; a device without mass has no resonance."""
        declared = {} if problem.device.resonance is None else dict(problem.device.resonance)
        values = declared | {key: value for key, value in table if key != "kind" and value is not None}
        faults = [
            (f".{key}", f"is missing, and so is device.resonance.{key}; give one of them")
            for key in ("frequency_hz", "damping_ratio", "mass_ratio")
            if key not in values
        ]
        if problem.device.mass_kg == 0:
            faults.append(("", "needs device.mass_kg above 0; leave the effect out or give the device its mass"))
        if faults:
            raise InputError([Fault(problem.name, None, f"{place}{key}", message) for key, message in faults])
        return cls(table.model_copy(update=values))

    def mechanics(self, plant: Plant) -> None:
        plant.split(self.table.frequency_hz, self.table.damping_ratio, self.table.mass_ratio)


class ViscousFriction(
    TableEffect, keys=ViscousFrictionEffect, rank=20, scene_alone=True, device_keys={"damping_ns_per_m": ""}
):
    """A damper between device and ground, in addition to ``device.damping_ns_per_m``, which is not counted twice."""

    def mechanics(self, plant: Plant) -> None:
        plant.join(DEVICE, GROUND, 0.0, self.table.damping_ns_per_m)


class CoulombFriction(TableEffect, keys=CoulombFrictionEffect, rank=30, device_keys={"force_n": "coulomb_friction_n"}):
    """A force of constant magnitude against the velocity; at rest it balances the load up to that magnitude."""
