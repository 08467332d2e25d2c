"""Between which values a number of a law is stable with the others kept, over every plant of a family.

Bisection on the worst case at the corners of the ranges; what a search of the ranges finds worse joins these.
D-decomposition (`loops.walls`) answers the same of k and b of a plain law, at once; other numbers enter a loop in no
such simple way.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum, auto
from itertools import product, zip_longest
from typing import Any, Protocol

import numpy as np

from avc_casadi._util.arrays import ComplexArray, FloatArray, IndexArray
from avc_casadi.claims.stated_law import StatedSystem
from avc_casadi.loops.loop import Body
from avc_casadi.loops.plant_family import Measure
from avc_casadi.loops.wall import closed
from avc_casadi.model.control_law import ControlLaw, LawNumber
from avc_casadi.model.hands import Hand
from avc_casadi.model.law import Law
from avc_casadi.model.plant import SampledPlant

LawsOf = Callable[[float], Sequence[Law]]
"""The laws that act, in contact and outside the wall, at a value of a number."""
Interval = tuple[float, float]

# Values of a scan: from a value up and down by a factor, in so many steps; a side of another sign has as many.
_REACH = 1e4
_STEPS = 64
# Bisections between a stable value and one that is not: to 1e-8 of their distance.
_BISECTIONS = 27
# Plants that a scan looks at: those of the largest radii. The others are looked at where it ends.
_PLANTS_OF_A_SCAN = 12
# A limit is confirmed by at most so many searches of the ranges, so far inside the boundary.
_SEARCHES = 4
_JUST_INSIDE = 1e-6


Pair = tuple[Any, Hand]
"""A device without ranges, of a force or of a velocity that is commanded, in a hand."""


class FoundCase(Protocol):
    """What a search of a side finds."""

    @property
    def radius(self) -> float:
        """The modulus of the measure."""

    @property
    def pair(self) -> Any:
        """The device and the hand."""


class Side(Protocol):
    """Plants of one box of ranges: in a hand, or released."""

    @property
    def devices(self) -> Sequence[Any]:
        """The corners of the device's ranges."""

    @property
    def held(self) -> Hand:
        """The hands that are tried before a search."""

    def worst_case(self, measure: Measure) -> FoundCase:
        """Return where a measure is largest."""


class JudgedPlants(Protocol):
    """A family of plants: a `PlantFamily`, or the handle of an admittance device."""

    @property
    def device(self) -> Any:
        """The device with its ranges."""

    @property
    def sides(self) -> Sequence[Side]:
        """The boxes of its ranges."""

    def plants(self, pairs: Sequence[Any]) -> SampledPlant:
        """Return the plants of pairs."""


@dataclass(eq=False)
class LawLimits:
    """The plants of a family around a law with one number changed."""

    family: JudgedPlants
    measure: Callable[[Law], Measure] = field(default_factory=lambda: _leading_pole)

    def __post_init__(self) -> None:
        self._pairs: list[Pair] = []
        self._keep([pair for side in self.family.sides for pair in corner_pairs(side)])
        self._chosen: IndexArray = np.arange(len(self._pairs))

    def _keep(self, pairs: Sequence[Pair]) -> None:
        """Keep further plants; those of unlike delays need one queue."""
        self._pairs += pairs
        self._bodies = Body.of(self.family.plants(self._pairs)).flat()

    def of_numbers(self, own: ControlLaw | StatedSystem, *, one_sided: bool) -> dict[str, Interval | None]:
        """Return the stable interval of each number of a law, by its key; `one_sided`: it acts outside too."""
        period = self.family.device.sample_time_s

        def interval(number: LawNumber, table: ControlLaw) -> Interval | None:
            def laws_of(value: float) -> list[Law]:
                changed = table.with_number(number.path, int(value) if number.whole else value)
                return [changed.law(period), changed.outside(period)] if one_sided else [changed.law(period)]

            return self.interval(number, laws_of)

        if isinstance(own, StatedSystem):
            return {}
        return {number.key: interval(number, own) for number in own.numbers(period)}

    def interval(self, number: LawNumber, laws_of: LawsOf) -> Interval | None:
        """Return the stable interval of a number about its value, or nearest to it; None where no value is stable."""
        radii = self._radii(laws_of(number.value), slice(None))
        self._chosen = np.argsort(radii)[-_PLANTS_OF_A_SCAN:]
        for _ in range(_SEARCHES):
            stable = self._nearest(number, laws_of)
            if stable is None:
                return None
            ends = self._end(number, laws_of, stable, -1), self._end(number, laws_of, stable, 1)
            if self._confirmed(laws_of, ends, number):
                break
        return ends

    def _radii(self, laws: Sequence[Law], rows: slice | IndexArray) -> FloatArray:
        body = self._bodies.axes(rows)
        return np.asarray(np.max([closed(body, law).radius for law in laws], axis=0))

    def _holds(self, laws_of: LawsOf, value: float) -> bool:
        return bool(self._radii(laws_of(value), self._chosen).max() < 1)

    def _nearest(self, number: LawNumber, laws_of: LawsOf) -> float | None:
        """Return the value of a number, or the stable one of the scan that is the fewest steps away."""
        if self._holds(laws_of, number.value):
            return number.value
        sides = (_scan(number, number.value, sign) for sign in (-1, 1))
        near = (value for steps in zip_longest(*sides) for value in steps if value is not None)
        return next((value for value in near if self._holds(laws_of, value)), None)

    def _end(self, number: LawNumber, laws_of: LawsOf, stable: float, sign: int) -> float:
        """Return the last stable value on a side; infinite, or the bound of the number, where the scan meets none."""
        last = stable
        for value in _scan(number, stable, sign):
            if not self._holds(laws_of, value):
                return last if number.whole else self._edge(laws_of, last, value)
            last = value
        return number.lowest if sign < 0 else number.highest

    def _edge(self, laws_of: LawsOf, stable: float, unstable: float) -> float:
        """Return the last stable value between a stable and an unstable one."""
        for _ in range(_BISECTIONS):
            middle = 0.5 * (stable + unstable)
            if self._holds(laws_of, middle):
                stable = middle
            else:
                unstable = middle
        return stable

    def _confirmed(self, laws_of: LawsOf, ends: Interval, number: LawNumber) -> bool:
        """Look for plants that are unstable just inside an interval, at all corners and in the ranges; keep them."""
        confirmed = True
        for end, sign in zip(ends, (1, -1), strict=True):
            if end in (number.lowest, number.highest) or math.isinf(end):
                continue
            inside = end if number.whole else end + sign * _JUST_INSIDE * abs(end)
            laws = laws_of(inside)
            worse = np.flatnonzero(self._radii(laws, slice(None)) >= 1)
            if not worse.size:
                worse = self._searched(laws)
            confirmed = confirmed and not worse.size
            self._chosen = np.union1d(self._chosen, worse).astype(np.intp)
        return confirmed

    def _searched(self, laws: Sequence[Law]) -> IndexArray:
        """Return the rows of new plants of the ranges that are unstable with some laws."""
        before = len(self._pairs)
        cases = [side.worst_case(self.measure(law)) for law in laws for side in self.family.sides]
        unstable = [case for case in cases if case.radius >= 1]
        if unstable:
            self._keep([case.pair for case in unstable])
        return np.arange(before, len(self._pairs))


def corner_pairs(side: Side) -> list[Pair]:
    """Return every corner of the device with every corner of the hands, or with none."""
    hands = [side.held.pick(slice(row, row + 1)) for row in range(len(side.held))]
    return list(product(side.devices, hands))


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


def _leading_pole(law: Law) -> Measure:
    def of_plants(plant: SampledPlant, _: object) -> ComplexArray:
        return closed(Body.of(plant).flat(), law).leading

    return of_plants


def _scan(number: LawNumber, start: float, sign: int) -> list[float]:
    """Return values of a number from a start on, by even factors up or down, up to its bound on that side.

    A number of either sign passes 0, which is one of the values, and goes on by the factors of its own size.
    """
    bound = number.highest if sign > 0 else number.lowest
    if number.whole:
        return [float(value) for value in range(int(start) + sign, int(bound) + sign, sign)]
    factors = np.geomspace(1.0, _REACH, _STEPS + 1)[1:]
    size = abs(start) or abs(number.value)
    away, back = sign * size * factors, -sign * size / factors
    if start * sign > 0:
        values = away
    elif start == 0:
        values = sign * size * np.concatenate([1 / factors[::-1], [1.0], factors])
    else:
        values = np.concatenate([back, [0.0], -back[::-1], [sign * size], away])
    inside = [float(value) for value in values if value * sign < bound * sign]
    return inside if math.isinf(bound) else [*inside, bound]
