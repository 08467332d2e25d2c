"""Thinning of gain tables: the fewest rows from which the others are interpolated within a tolerance."""

from __future__ import annotations

import numpy as np

from avc_casadi._util.arrays import FloatArray, IndexArray

_AT_ONCE = 64


def fewest_rows(table: FloatArray, tolerance: float) -> IndexArray:
    """Return positions of the fewest rows between which all others are within a tolerance of the gains."""
    # A line from a row is within tolerance while its slope lies in the interval of each row between: a narrowing cone.
    ln_frequency, gains = np.log(table[:, 0]), table[:, 1:]
    size = np.where(gains == 0, np.maximum(gains.max(axis=0), 1.0), gains)
    room = tolerance * size
    count = len(gains)
    steps = np.full(count, count)
    steps[0] = 0
    came = np.zeros(count, dtype=np.intp)
    at_once = _AT_ONCE
    for first in range(count - 1):
        low, high = np.full((1, gains.shape[1]), -np.inf), np.full((1, gains.shape[1]), np.inf)
        start = first + 1
        while start < count and bool((low <= high).all()):
            some = slice(start, start + at_once)
            away = (ln_frequency[some] - ln_frequency[first])[:, None]
            lows = np.maximum.accumulate(np.vstack([low, (gains[some] - room[some] - gains[first]) / away]))
            highs = np.minimum.accumulate(np.vstack([high, (gains[some] + room[some] - gains[first]) / away]))
            slope = (gains[some] - gains[first]) / away
            met = np.all((lows[:-1] <= slope) & (slope <= highs[:-1]), axis=1)
            last = start + np.flatnonzero(met & (steps[some] > steps[first] + 1))
            steps[last], came[last] = steps[first] + 1, first
            low, high, start = lows[-1:], highs[-1:], start + at_once
        # The next cone ends about where this one did.
        at_once = max(_AT_ONCE, start - at_once - first + int(np.count_nonzero((lows <= highs).all(axis=1))))
    path = [count - 1]
    while path[-1]:
        path.append(int(came[path[-1]]))
    return np.array(path[::-1], dtype=np.intp)
