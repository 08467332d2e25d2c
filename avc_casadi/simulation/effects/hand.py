"""A hand in a scene: it holds the device and follows its moving target."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Self

from avc_casadi.model.effects import HandEffect, StylusHandEffect
from avc_casadi.model.hands import Hand, StylusHand
from avc_casadi.model.plant import Plant
from avc_casadi.model.problem import Problem
from avc_casadi.simulation.effects.base import SceneEffect, declared_number


@dataclass(frozen=True)
class Grip(SceneEffect, keys=HandEffect, rank=40, role="hand"):
    """The hand at the device; an array of hands stands for as many scenes."""

    hand: Hand | StylusHand

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:  # noqa: ARG003
        """Build it; missing numbers are taken from the middle of the problem's set of hands."""
        given = {item.name: getattr(table, item.name) for item in fields(Hand)}
        return cls(
            Hand(**{key: sum(getattr(problem.hands, key)) / 2 if one is None else one for key, one in given.items()})
        )

    def mechanics(self, plant: Plant) -> None:
        """Add the hand to the handle."""
        self.hand.mechanics(plant)


@dataclass(frozen=True)
class StylusGrip(Grip, keys=StylusHandEffect, rank=50, role="hand"):
    """The same with a hand on a stylus."""

    @classmethod
    def build(cls, table: Any, problem: Problem, place: str) -> Self:
        """Build it from the table as given; the hand needs a mass."""
        declared_number(table.mass_kg, problem, f"{place}.mass_kg")
        return cls(StylusHand(**{item.name: getattr(table, item.name) for item in fields(StylusHand)}))
