"""Between which values a number of a loop is stable: a scan by even factors, then bisection at its ends."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import zip_longest

import numpy as np

from avc_casadi.model.control_law import LawNumber

Interval = tuple[float, float]
Holds = Callable[[float], bool]
"""Whether every loop is stable at a value."""

# Values of a scan: from a value up and down by a factor, in so many steps; a side of another sign has as many.
_REACH = 1e4
_STEPS = 64
# Bisections between a stable value and one that is not: to 1e-8 of their distance.
_BISECTIONS = 27
JUST_INSIDE = 1e-6
"""Share of an end by which the value that confirms it lies inside."""


def stable_interval(number: LawNumber, holds: Holds) -> Interval | None:
    """Return the stable interval of a number about its value, or nearest to it; None where no value is stable."""
    stable = _nearest(number, holds)
    if stable is None:
        return None
    return _end(number, holds, stable, -1), _end(number, holds, stable, 1)


def inside_ends(number: LawNumber, ends: Interval) -> list[float]:
    """Return the values just inside the ends at which something becomes unstable."""
    return [
        end if number.whole else end + sign * JUST_INSIDE * abs(end)
        for end, sign in zip(ends, (1, -1), strict=True)
        if end not in (number.lowest, number.highest) and not math.isinf(end)
    ]


def _nearest(number: LawNumber, holds: Holds) -> float | None:
    """Return the value of a number, or the stable one of the scan that is the fewest steps away."""
    if holds(number.value):
        return number.value
    sides = (_scan(number, number.value, sign) for sign in (-1, 1))
    near = (value for steps in zip_longest(*sides) for value in steps if value is not None)
    return next((value for value in near if holds(value)), None)


def _end(number: LawNumber, holds: Holds, stable: float, sign: int) -> float:
    """Return the last stable value on a side; infinite, or the bound of the number, where the scan meets none."""
    last = stable
    for value in _scan(number, stable, sign):
        if not holds(value):
            return last if number.whole else _edge(holds, last, value)
        last = value
    return number.lowest if sign < 0 else number.highest


def _edge(holds: Holds, stable: float, unstable: float) -> float:
    """Return the last stable value between a stable and an unstable one."""
    for _ in range(_BISECTIONS):
        middle = 0.5 * (stable + unstable)
        if holds(middle):
            stable = middle
        else:
            unstable = middle
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
