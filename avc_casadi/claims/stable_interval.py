"""Between which values a number of a loop is stable: a scan by even factors, then a root at its ends."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import zip_longest

import numpy as np
from scipy.optimize import brentq

from avc_casadi._util.arrays import FloatArray
from avc_casadi.model.control_law import LawNumber

Interval = tuple[float, float]
Growth = Callable[[FloatArray], FloatArray]
"""The largest spectral radius less 1 of all loops at some values of a number, shape (m,): below 0 all are stable."""

# Values of a scan: from a value up and down by a factor, in so many steps; a side of another sign has as many. So many
# are looked at together.
_REACH = 1e4
_STEPS = 64
_TOGETHER = 16
# An end is right to this share of the distance between a stable value and one that is not.
_PRECISION = 1e-8
_BISECTIONS = 27
JUST_INSIDE = 1e-6
"""Share of an end by which the value that confirms it lies inside."""


def stable_interval(number: LawNumber, growth: Growth) -> Interval | None:
    """Return the stable interval of a number about its value, or nearest to it; None where no value is stable."""
    stable = _nearest(number, growth)
    if stable is None:
        return None
    return _end(number, growth, stable, -1), _end(number, growth, stable, 1)


def _together(values: Sequence[float]) -> Iterator[Sequence[float]]:
    """Yield values that are looked at together."""
    for first in range(0, len(values), _TOGETHER):
        yield values[first : first + _TOGETHER]


def inside_ends(number: LawNumber, ends: Interval) -> list[float]:
    """Return the values just inside the ends at which something becomes unstable."""
    return [
        end if number.whole else end + sign * JUST_INSIDE * abs(end)
        for end, sign in zip(ends, (1, -1), strict=True)
        if end not in (number.lowest, number.highest) and not math.isinf(end)
    ]


def _nearest(number: LawNumber, growth: Growth) -> float | None:
    """Return the value of a number, or the stable one of the scan that is the fewest steps away."""
    sides = (_scan(number, number.value, sign) for sign in (-1, 1))
    near = [number.value, *(value for steps in zip_longest(*sides) for value in steps if value is not None)]
    for values in ([number.value], *_together(near[1:])):
        stable = growth(np.array(values)) < 0
        if stable.any():
            return float(values[int(stable.argmax())])
    return None


def _end(number: LawNumber, growth: Growth, stable: float, sign: int) -> float:
    """Return the last stable value on a side; infinite, or the bound of the number, where the scan meets none."""
    last = stable
    for values in _together(_scan(number, stable, sign)):
        unstable = growth(np.array(values)) >= 0
        if unstable.any():
            first = int(unstable.argmax())
            last = values[first - 1] if first else last
            return last if number.whole else _edge(growth, last, values[first])
        last = values[-1]
    return number.lowest if sign < 0 else number.highest


def _edge(growth: Growth, stable: float, unstable: float) -> float:
    """Return the last stable value between a stable and an unstable one: Brent's root, on its stable side."""

    def at(value: float) -> float:
        return float(growth(np.array([value]))[0])

    precision = _PRECISION * abs(unstable - stable)
    root = float(brentq(at, stable, unstable, xtol=precision, rtol=4 * np.finfo(np.float64).eps))
    for steps in (0, 2):
        value = root + steps * math.copysign(precision, stable - unstable)
        if min(stable, unstable) <= value <= max(stable, unstable) and at(value) < 0:
            return value
    for _ in range(_BISECTIONS):
        middle = 0.5 * (stable + unstable)
        stable, unstable = (middle, unstable) if at(middle) < 0 else (stable, middle)
    return stable


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
