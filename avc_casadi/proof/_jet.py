"""Values with their slopes along the sides of a cell, both enclosed: forward differentiation in intervals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, TypeVar

from avc_casadi.proof._interval import ComplexInterval, Interval
from avc_casadi.support import FloatArray

Number = TypeVar("Number", Interval, ComplexInterval)


@dataclass(frozen=True)
class Jet(Generic[Number]):
    """An enclosure of a function over n cells, and of its partial derivatives there.

    Attributes:
        value: shape (n,).
        slope: shape (variables, n).
    """

    value: Number
    slope: Number

    def __add__(self, other: Jet[Number]) -> Jet[Number]:
        return Jet(self.value + other.value, self.slope + other.slope)

    def __sub__(self, other: Jet[Number]) -> Jet[Number]:
        return Jet(self.value - other.value, self.slope - other.slope)

    def __neg__(self) -> Jet[Number]:
        return Jet(-self.value, -self.slope)

    def __mul__(self, other: Jet[Number]) -> Jet[Number]:
        return Jet(self.value * other.value, self.slope * other.value + other.slope * self.value)

    def times(self, number: Interval | FloatArray | float) -> Jet[Number]:
        """Multiply by a number that does not depend on the variables."""
        return Jet(self.value * number, self.slope * number)

    def plus(self, number: Interval | FloatArray | float) -> Jet[Number]:
        """Add a number that does not depend on the variables."""
        return Jet(self.value + number, self.slope)

    def square(self) -> Jet[Number]:
        """Return the square."""
        return Jet(self.value.square(), 2.0 * (self.slope * self.value))
