"""Between which values a number of a loop is stable: a scan by even factors, then a root at its ends.

A number that counts samples is scanned by the same factors, then halved to the last stable count.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import zip_longest

import numpy as np
from scipy.optimize import brentq

from avc_casadi._util.arrays import FloatArray, Interval
from avc_casadi._util.open_end import AboveZero
from avc_casadi.model.control_law import LawNumber

Growth = Callable[[FloatArray], FloatArray]
"""The largest spectral radius less 1 of all loops at some values of a number, shape (m,): below 0 all are stable."""

Deciding = Callable[[float], Growth]
"""The growth of those loops alone that are unstable at a value: they decide where an interval ends before it."""

# Values of a scan: from a value up and down by a factor, in so many steps; a side of another sign has as many. A gain
# goes up by more: one of 1e-9 N.s/m is far below every limit. The first few are looked at together, then twice as many
# at a time up to the most.
_REACH = 1e4
_STEPS = 64
_REACH_OF_GAINS = 1e12
_FIRST_TOGETHER = 2
_MOST_TOGETHER = 16
# Every so many values of a scan all loops of a family are looked at: others may be unstable there than at the value.
_SAMPLED = 8
# An end is right to this share of the distance between a stable value and one that is not.
_PRECISION = 1e-8
_BISECTIONS = 27
# This share of the last value of the scan is the last above 0 that is judged: a loop that any damper damps is unstable
# without one alone, and the root is then where rounding leaves it.
_LEAST_END = 1e-2
# Share of a root by which an end lies inside: an end is a value that is judged stable.
_JUST_INSIDE = 1e-7


def stable_interval(number: LawNumber, growth: Growth, deciding: Deciding | None = None) -> Interval | None:
    """Return the stable interval of a number about its value, or nearest to it; None where no value is stable.

    Both ends are values that are judged stable, or bounds of the number, or infinite; one may be `AboveZero`.

    Args:
        number: with its value and its bounds.
        growth: of all loops.
        deciding: leaves loops out of the search of an end; by default none is.
    """
    search = _Search(number, growth, deciding or (lambda value: growth))  # noqa: ARG005 - all decide
    stable = search.nearest()
    return None if stable is None else (search.inside(stable, -1), search.inside(stable, 1))


def _together(values: Sequence[float]) -> Iterator[Sequence[float]]:
    """Yield values that are looked at together, ever more of them."""
    first, count = 0, _FIRST_TOGETHER
    while first < len(values):
        yield values[first : first + count]
        first, count = first + count, min(2 * count, _MOST_TOGETHER)


def sampled_values(number: LawNumber) -> FloatArray:
    """Return the value of a number, its bounds and values between, at which each loop of a family is looked at."""
    scans = [_scan(number, number.value, sign) for sign in (-1, 1)]
    sampled = [value for scan in scans for value in (*scan[::_SAMPLED], *scan[-1:])]
    return np.array([number.value, *sampled])


def searched_ends(number: LawNumber, ends: Interval) -> list[float]:
    """Return the ends beyond which something becomes unstable."""
    return [end for end in ends if end not in (number.lowest, number.highest) and not math.isinf(end)]


@dataclass(frozen=True)
class _Search:
    """A stable value of a number, and the ends of the interval about it."""

    number: LawNumber
    growth: Growth
    deciding: Deciding

    def nearest(self) -> float | None:
        """Return the value of the number, or the stable one of the scan that is the fewest steps away."""
        number = self.number
        if self._stable(number.value):
            return number.value
        deciding = self.deciding(number.value)
        sides = (_scan(number, number.value, sign) for sign in (-1, 1))
        near = [value for steps in zip_longest(*sides) for value in steps if value is not None]
        for values in _together(near):
            hopeful = np.array(values)[deciding(np.array(values)) < 0]
            stable = hopeful[self.growth(hopeful) < 0] if hopeful.size else hopeful
            if stable.size:
                return float(stable[0])
        return None

    def inside(self, stable: float, sign: int) -> float:
        """Return the end on a side: just inside a root, or the bound of the number, or infinite."""
        end = self._end(stable, sign)
        whole = self.number.whole or end in (0.0, self.number.lowest, self.number.highest) or math.isinf(end)
        if whole or isinstance(end, AboveZero):
            return end
        inside = end - sign * _JUST_INSIDE * abs(end)
        return inside if (inside - stable) * sign > 0 else stable

    def _end(self, stable: float, sign: int) -> float:
        """Return the last stable value on a side (`sign`); infinite, or the bound of the number, if all are stable."""
        last = stable
        for values in _together(_scan(self.number, stable, sign)):
            unstable = self.growth(np.array(values)) >= 0
            if unstable.any():
                first = int(unstable.argmax())
                last = values[first - 1] if first else last
                return self._last_count(last, values[first]) if self.number.whole else self._edge(last, values[first])
            last = values[-1]
        if sign > 0:
            return self.number.highest
        if self.number.lowest == 0 and self.number.sole:
            return AboveZero(last)
        return -math.inf if self.number.unlimited_below else self.number.lowest

    def _last_count(self, stable: float, unstable: float) -> float:
        """Return the last stable count between a stable and an unstable one, by halving."""
        while abs(unstable - stable) > 1:
            middle = (stable + unstable) // 2
            stable, unstable = (middle, unstable) if self._stable(middle) else (stable, middle)
        return stable

    def _edge(self, stable: float, unstable: float) -> float:
        """Return the last stable value between a stable and an unstable one: Brent's root, on its stable side.

        It is `AboveZero`, where no value above 0 that the scan can tell from it is unstable.
        """
        precision = _PRECISION * abs(unstable - stable)
        if unstable == 0 and self._stable(_LEAST_END * stable):
            return AboveZero(_LEAST_END * stable)
        deciding = self.deciding(unstable)

        def decided(value: float) -> float:
            return float(deciding(np.array([value]))[0])

        root = float(brentq(decided, stable, unstable, xtol=precision, rtol=4 * np.finfo(np.float64).eps))
        for steps in (0, 2):
            value = root + steps * math.copysign(precision, stable - unstable)
            if min(stable, unstable) <= value <= max(stable, unstable) and self._stable(value):
                return value
        for _ in range(_BISECTIONS):
            middle = 0.5 * (stable + unstable)
            stable, unstable = (middle, unstable) if self._stable(middle) else (stable, middle)
        return stable

    def _stable(self, value: float) -> bool:
        return float(self.growth(np.array([value]))[0]) < 0


def _scan(number: LawNumber, start: float, sign: int) -> list[float]:
    """Return values of a number from a start on, by even factors up or down, up to its bound on that side.

    A number of either sign passes 0, which is one of the values, and goes on by the factors of its own size.
    """
    bound = number.highest if sign > 0 else number.lowest
    factors = np.geomspace(1.0, _REACH, _STEPS + 1)[1:]
    farther = factors
    if number.linear and start * sign >= 0:
        decades = math.log10(_REACH_OF_GAINS) / math.log10(_REACH)
        farther = np.geomspace(1.0, _REACH_OF_GAINS, round(decades * _STEPS) + 1)[1:]
    if number.whole:
        counts = np.unique(np.round(start * factors**sign))
        between = counts[(counts * sign > start * sign) & (counts * sign < bound * sign)]
        return [*between[::sign].tolist(), *([bound] if start != bound else [])]
    size = abs(start) or abs(number.value)
    away = sign * size * farther
    back = -sign * size / factors
    if start * sign > 0:
        values = away
    elif start == 0:
        values = sign * size * np.concatenate([1 / factors[::-1], [1.0], farther])
    else:
        values = np.concatenate([back, [0.0], -back[::-1], [sign * size], away])
    inside = [float(value) for value in values if value * sign < bound * sign]
    return inside if math.isinf(bound) or (bound == 0 and number.sole) else [*inside, bound]
