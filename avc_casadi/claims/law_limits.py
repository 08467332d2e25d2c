"""Between which values a number of a law is stable with the others kept, over every plant of a family.

The root of the worst growth at the corners of the ranges; what a search of the ranges finds worse joins these.
D-decomposition (`loops.walls`) answers the same of k and b of a plain law, at once; other numbers enter a loop in no
such simple way. Pieces that are not linear are judged at every slope of their ranges.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum, auto
from functools import cached_property, partial
from typing import Any, Protocol

import numpy as np

from avc_casadi._util.arrays import FloatArray, IndexArray
from avc_casadi.claims.law_points import (
    LawPoint,
    PointSide,
    WorstPoint,
    corner_points,
    law_at,
    radius,
    slopes_at,
    worst,
)
from avc_casadi.claims.stable_interval import Interval, inside_ends, stable_interval
from avc_casadi.claims.stated_law import StatedSystem
from avc_casadi.loops.loop import Body
from avc_casadi.loops.plant_family import Measure as PlantMeasure
from avc_casadi.loops.wall import closed
from avc_casadi.model.control_law import ControlLaw, LawNumber
from avc_casadi.model.law import Law
from avc_casadi.model.plant import SampledPlant

LawsOf = Callable[[FloatArray], Sequence[Law]]
"""The laws that act, in contact and outside the wall, at m values of a number: each a `Law` of m."""

# Plants that a scan looks at: those of the largest radii. The others are looked at where it ends.
_PLANTS_OF_A_SCAN = 12
# A limit is confirmed by at most so many searches of the ranges.
_SEARCHES = 4


class JudgedPlants(Protocol):
    """A family of plants: a `PlantFamily`, or the handle of an admittance device."""

    @property
    def device(self) -> Any:
        """The device with its ranges."""

    @property
    def sides(self) -> Sequence[PointSide]:
        """The boxes of its ranges."""

    def plants(self, pairs: Sequence[Any]) -> SampledPlant:
        """Return the plants of pairs."""


@dataclass(frozen=True)
class NumberLaws:
    """The laws of a table in which one number takes other values.

    Attributes:
        table: the law.
        number: which of its numbers.
        acting: the laws that act, of a table.
    """

    table: ControlLaw
    number: LawNumber
    acting: Callable[[ControlLaw], Sequence[Law]]

    def __call__(self, values: FloatArray) -> list[Law]:
        """Return the laws at m values, each a `Law` of m."""
        if self.number.linear and values.all():
            first, second = self._of_two_values
            share = values / self.number.value - 1
            return [_between(*pair, share) for pair in zip(first, second, strict=True)]
        of_values = [self._at(value) for value in values.tolist()]
        return [stacked(laws) for laws in zip(*of_values, strict=True)]

    @cached_property
    def _of_two_values(self) -> tuple[Sequence[Law], Sequence[Law]]:
        """The laws at the value and at twice the value: of a gain, which every matrix is affine in, they say all."""
        return self._at(self.number.value), self._at(2 * self.number.value)

    def _at(self, value: float) -> Sequence[Law]:
        return self.acting(self.table.with_number(self.number.path, int(value) if self.number.whole else value))


def _between(first: Law, second: Law, share: FloatArray) -> Law:
    """Return the laws M_1 + share (M_2 - M_1) of each matrix M."""
    column = share[:, None, None]
    a, b, c, d = (
        getattr(first, name) + column * (getattr(second, name) - getattr(first, name)) for name in ("a", "b", "c", "d")
    )
    return Law(a, b, c, d, first.sample_time_s, first.sectors)


def stacked(laws: Sequence[Law]) -> Law:
    """Return laws of the same signals as one of many; a state that one does not have stays 0 there."""
    states = max(law.states for law in laws)

    def grown(matrix: FloatArray, rows: int, columns: int) -> FloatArray:
        return np.pad(matrix, ((0, rows - matrix.shape[0]), (0, columns - matrix.shape[1])))

    inputs, outputs = laws[0].b.shape[-1], laws[0].c.shape[-2]
    return Law(
        a=np.stack([grown(law.a, states, states) for law in laws]),
        b=np.stack([grown(law.b, states, inputs) for law in laws]),
        c=np.stack([grown(law.c, outputs, states) for law in laws]),
        d=np.stack([law.d for law in laws]),
        sample_time_s=laws[0].sample_time_s,
        sectors=laws[0].sectors,
    )


class LawLimits:
    """The plants of a family around laws with one number changed."""

    def __init__(
        self,
        family: JudgedPlants,
        acting: Sequence[Law] = (),
        measure: Callable[[Law], PlantMeasure] | None = None,
    ) -> None:
        self.family = family
        # Another measure than the radius alone: of several kinds of poles.
        self._measure = measure
        self._points: list[LawPoint] = []
        # Of the laws that act that with all of the sectors.
        self._sectors = max((law.sectors for law in acting), key=len, default=())
        self._keep([point for side in family.sides for point in corner_points(side, self._sectors)])
        self._chosen: IndexArray = np.arange(len(self._points))

    def _keep(self, points: Sequence[LawPoint]) -> None:
        """Keep further points; plants of unlike delays need one queue."""
        self._points += points
        self._bodies = Body.of(self.family.plants([(point.device, point.hand) for point in self._points])).flat()
        self._slopes = slopes_at(self._points, self._sectors)

    def interval(self, number: LawNumber, laws_of: LawsOf) -> Interval | None:
        """Return the stable interval of a number about its value, or nearest to it; None where no value is stable."""
        radii = self._radii(laws_of(np.array([number.value])), slice(None))[:, 0]
        self._chosen = np.argsort(radii)[-_PLANTS_OF_A_SCAN:]
        for _ in range(_SEARCHES):
            ends = stable_interval(number, partial(self._growth, laws_of))
            if ends is None or self._confirmed(laws_of, inside_ends(number, ends)):
                break
        return ends

    def _radii(self, laws: Sequence[Law], rows: slice | IndexArray) -> FloatArray:
        """Return the largest radius at each point over laws of m values, shape (points, m)."""
        body = self._bodies.axes(rows, None)
        linear = [law_at(law, self._slopes, rows, None) for law in laws]
        return np.asarray(np.max([closed(body, law).radius for law in linear], axis=0))

    def _growth(self, laws_of: LawsOf, values: FloatArray) -> FloatArray:
        """Return the largest radius at the chosen points less 1, at each of some values."""
        return np.asarray(self._radii(laws_of(values), self._chosen).max(axis=0) - 1)

    def _confirmed(self, laws_of: LawsOf, values: Sequence[float]) -> bool:
        """Look for points that are unstable at some values, at all corners and in the ranges; keep them."""
        confirmed = True
        for value in values:
            laws = laws_of(np.array([value]))
            worse = np.flatnonzero(self._radii(laws, slice(None))[:, 0] >= 1)
            if not worse.size:
                worse = self._searched([law.pick(0) for law in laws])
            confirmed = confirmed and not worse.size
            self._chosen = np.union1d(self._chosen, worse).astype(np.intp)
        return confirmed

    def _searched(self, laws: Sequence[Law]) -> IndexArray:
        """Return the rows of new points of the ranges that are unstable with some laws."""
        before = len(self._points)
        cases = [self._worst(law, side) for law in laws for side in self.family.sides]
        unstable = [case.point for case in cases if case.value >= 1]
        if unstable:
            self._keep(unstable)
        return np.arange(before, len(self._points))

    def _worst(self, law: Law, side: PointSide) -> WorstPoint:
        """Return the worst point of a side."""
        if self._measure is None:
            return worst(law, side, radius)
        case = side.worst_case(self._measure(law))
        return WorstPoint(LawPoint(*case.pair), case.radius)


class LimitSide(Enum):
    """Where a number of an unstable law lies."""

    BELOW = auto()
    """Below the lowest with which the law is stable."""
    ABOVE = auto()
    """Above the largest with which it is stable."""
    ABOVE_OUTSIDE = auto()
    """Above the largest with which it is stable outside the wall."""
    NONE_STABLE = auto()
    """No value of any single number makes it stable."""


@dataclass(frozen=True)
class BeyondLimit:
    """A number of an unstable law, and the limit that it is beyond.

    Attributes:
        side: where it lies.
        key: the number; empty where no single number makes the law stable.
        value: its value.
        limit: that limit; not a number where there is none.
    """

    side: LimitSide
    key: str = ""
    value: float = math.nan
    limit: float = math.nan


def nearest_limit(
    law: ControlLaw | StatedSystem, intervals: Mapping[str, Interval | None], sample_time_s: float
) -> BeyondLimit:
    """Return the number of an unstable law that is nearest to the limit that it is beyond."""
    beyond = []
    for number in law.numbers(sample_time_s):
        interval = intervals.get(number.key)
        if interval is not None:
            low, high = interval
            is_below = number.value < low
            side, limit = (LimitSide.BELOW, low) if is_below else (LimitSide.ABOVE, high)
            beyond.append(BeyondLimit(side, number.key, number.value, limit))

    def change(number: BeyondLimit) -> tuple[float, str]:
        return abs(number.value - number.limit) / abs(number.value), number.key

    return min(beyond, key=change, default=BeyondLimit(LimitSide.NONE_STABLE))
