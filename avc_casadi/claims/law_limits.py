"""Between which values a number of a law is stable with the others kept, over every plant of a family.

The root of the worst growth at the corners of the ranges; what a search of the ranges finds worse joins these.
D-decomposition (`loops.stable_walls`) answers the same of k and b of a plain law, at once; other numbers enter a loop
in no such simple way. Pieces that are not linear are judged at every slope of their ranges.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum, auto
from functools import cached_property, partial
from typing import Any, Protocol

import numpy as np

from avc_casadi._util.arrays import FloatArray, IndexArray, Interval
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
from avc_casadi.claims.stable_interval import Growth, sampled_values, searched_ends, stable_interval
from avc_casadi.claims.stated_law import StatedSystem
from avc_casadi.loops.loop import Body
from avc_casadi.loops.plant_family import RADIUS_TOLERANCE
from avc_casadi.loops.plant_family import Measure as PlantMeasure
from avc_casadi.loops.wall import closed
from avc_casadi.model.control_law import ControlLaw, LawNumber
from avc_casadi.model.law import Law
from avc_casadi.model.plant import SampledPlant

LawsOf = Callable[[FloatArray], Sequence[Law]]
"""The laws that act, in contact and outside the wall, at m values of a number: each a `Law` of m."""

# Plants that a scan looks at: those of the largest radii at the value of a number, and the worst of other values over
# its range. All plants are looked at where the scan ends.
_PLANTS_OF_A_SCAN = 12
# A loop with this radius is not stable: the same as in a verdict, so that an end of an interval has the verdict yes.
_UNSTABLE_FROM = 1 - RADIUS_TOLERANCE
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
    """Return laws of the same signals as one with a leading axis; states and sectors that a law lacks stay 0."""
    most = max(laws, key=lambda law: law.states)
    sectors = max((law.sectors for law in laws), key=len)
    names = [sector.name for sector in sectors]

    def places(signals: int, law: Law) -> list[int]:
        return [*range(signals), *(signals + names.index(sector.name) for sector in law.sectors)]

    states, inputs, outputs = most.states, most.measured + len(sectors), most.outputs + len(sectors)
    a = np.zeros((len(laws), states, states))
    b = np.zeros((len(laws), states, inputs))
    c = np.zeros((len(laws), outputs, states))
    d = np.zeros((len(laws), outputs, inputs))
    for row, law in enumerate(laws):
        into, out = places(law.measured, law), places(law.outputs, law)
        a[row, : law.states, : law.states] = law.a
        b[row, : law.states, into] = law.b.T
        c[row, out, : law.states] = law.c
        d[row, np.ix_(out, into)[0], np.ix_(out, into)[1]] = law.d
    return Law(a, b, c, d, laws[0].sample_time_s, sectors)


class LawLimits:
    """The plants of a family around laws with one number changed."""

    def __init__(
        self,
        family: JudgedPlants,
        acting: Sequence[Law] = (),
        measure: Callable[[Law], PlantMeasure] | None = None,
    ) -> None:
        """Set up the points, corners of the ranges and of the sectors, at which laws are judged.

        Args:
            family: the plants.
            acting: laws that act, of which that with the most sectors names them.
            measure: poles that count in place of the largest; None for it.
        """
        self.family = family
        # Another measure than the radius alone: of several kinds of poles.
        self._measure = measure
        self._points: list[LawPoint] = []
        # Matrices of laws that a search of the ranges found stable.
        self._stable_laws: set[tuple[bytes, ...]] = set()
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
        """Return the interval of a number about its value, or nearest to it, in which laws are stable; None if empty.

        `laws_of` gives the laws that act at values of the number. The ends are confirmed by searches of the ranges.
        """
        radii = self._radii(laws_of(sampled_values(number)), slice(None))
        self._chosen = np.union1d(np.argsort(radii[:, 0])[-_PLANTS_OF_A_SCAN:], radii.argmax(axis=0)).astype(np.intp)
        for _ in range(_SEARCHES):
            ends = stable_interval(number, partial(self._growth, laws_of), partial(self._deciding, laws_of))
            if ends is None or self._confirmed(laws_of, searched_ends(number, ends)):
                break
        return ends

    def _radii(self, laws: Sequence[Law], rows: slice | IndexArray) -> FloatArray:
        """Return the largest radius at each point over laws of m values, shape (points, m)."""
        return np.asarray(np.max(self._radii_of_each(laws, rows), axis=0))

    def _radii_of_each(self, laws: Sequence[Law], rows: slice | IndexArray) -> FloatArray:
        """Return the radius at each point with each law of m values, shape (laws, points, m)."""
        body = self._bodies.axes(rows, None)
        radii = [closed(body, law_at(law, self._slopes, rows, None)).radius for law in laws]
        return np.array(np.broadcast_arrays(*radii))

    def _growth(self, laws_of: LawsOf, values: FloatArray) -> FloatArray:
        """Return the largest radius at the chosen points less that of a stable loop, at each of some values."""
        return np.asarray(self._radii(laws_of(values), self._chosen).max(axis=0) - _UNSTABLE_FROM)

    def _deciding(self, laws_of: LawsOf, value: float) -> Growth:
        """Return the growth over values of a number, of those laws and points alone that are unstable at one value."""
        unstable = self._radii_of_each(laws_of(np.array([value])), self._chosen)[..., 0] >= _UNSTABLE_FROM
        points = self._chosen[unstable.any(axis=0)]
        places = np.flatnonzero(unstable.any(axis=1)).tolist()

        def growth(values: FloatArray) -> FloatArray:
            laws = laws_of(values)
            return np.asarray(self._radii([laws[place] for place in places], points).max(axis=0) - _UNSTABLE_FROM)

        return growth

    def _confirmed(self, laws_of: LawsOf, values: Sequence[float]) -> bool:
        """Return whether the laws at each value of a number are stable at all points: those kept, else searched ones.

        Points of device and hand that are not are kept, and belong to those that decide from then on.
        """
        confirmed = True
        for value in values:
            laws = laws_of(np.array([value]))
            worse = np.flatnonzero(self._radii(laws, slice(None))[:, 0] >= _UNSTABLE_FROM)
            if not worse.size:
                worse = self._searched([law.pick(0) for law in laws])
            confirmed = confirmed and not worse.size
            self._chosen = np.union1d(self._chosen, worse).astype(np.intp)
        return confirmed

    def _searched(self, laws: Sequence[Law]) -> IndexArray:
        """Return the rows of new points of the ranges that are unstable with some laws.

        A law that a search found stable is not searched again: outside the wall many numbers change nothing.
        """
        before = len(self._points)
        unstable = []
        for law in laws:
            matrices = tuple(matrix.tobytes() for matrix in (law.a, law.b, law.c, law.d))
            if matrices in self._stable_laws:
                continue
            points = [
                case.point for case in map(partial(self._worst, law), self.family.sides) if case.value >= _UNSTABLE_FROM
            ]
            unstable += points
            if not points:
                self._stable_laws.add(matrices)
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

    @classmethod
    def of(cls, key: str, value: float, stable: Interval) -> BeyondLimit:
        """Return a number and the end of its stable interval that it is beyond."""
        low, high = stable
        return cls(LimitSide.BELOW, key, value, low) if value < low else cls(LimitSide.ABOVE, key, value, high)


def nearest_limit(
    law: ControlLaw | StatedSystem, intervals: Mapping[str, Interval | None], sample_time_s: float
) -> BeyondLimit:
    """Return the number of an unstable law that is the least share of itself beyond an end of its stable interval."""
    beyond = []
    for number in law.numbers(sample_time_s):
        interval = intervals.get(number.key)
        if interval is not None:
            beyond.append(BeyondLimit.of(number.key, number.value, interval))

    def change(number: BeyondLimit) -> tuple[float, str]:
        return abs(number.value - number.limit) / abs(number.value), number.key

    return min(beyond, key=change, default=BeyondLimit(LimitSide.NONE_STABLE))
