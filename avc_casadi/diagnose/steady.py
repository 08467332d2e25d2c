"""Swings that fall to a size that they keep: limit cycles that begin from a larger swing."""

from __future__ import annotations

import math

import numpy as np

from avc_casadi._util.arrays import FloatArray

_KEPT_SHARE = 0.9
"""Size to which the sizes of a swing tend, per size at its end, from which on it keeps that size."""

_NEAR_RATE = 0.08
"""Change of ln(size) a cycle at the end up to which a swing that levels off is near the size that it keeps."""

_FEWEST_SWINGS = 3
"""Fewest swings in each third of a swing that levels off."""


def levels_off(sizes: FloatArray) -> int | None:
    """Return how many of the last swings have about the size to which all tend; None where that is far, or none.

    Sizes a + c r^n, as a swing has that falls to a limit cycle, have means m1, m2, m3 over their thirds of which
    a = (m1 m3 - m2^2)/(m1 + m3 - 2 m2). One that dies away by a damper tends to 0, and one by dry friction below it.
    """
    count = sizes.size // 3
    if count < _FEWEST_SWINGS:
        return None
    first, second, third = (float(part.mean()) for part in np.split(sizes[-3 * count :], 3))
    slows_down_by = first + third - 2 * second
    cycles = count / 2
    if not (first > second > third and slows_down_by > 0):
        return None
    if math.log(second / third) > _NEAR_RATE * cycles:
        return None
    tends_to = (first * third - second**2) / slows_down_by
    return count if tends_to > _KEPT_SHARE * third else None
