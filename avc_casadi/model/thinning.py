"""Thinning of gain tables: the least deviation for a number of rows, or the fewest rows for a tolerance."""

from __future__ import annotations

import numpy as np

from avc_casadi._errors import InputError
from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi.model.gains import interpolate

_CANDIDATES = 256
"""Number of candidate rows; of longer schedules as many are taken evenly, then those of largest deviation."""
_ADDED = 16
_AT_ONCE = 64
_ROUNDS = 20


def thinned_rows(deviation: Deviation, *, rows: int | None = None, tolerance: float | None = None) -> IndexArray:
    """Return rows, first and last among them, from which the others are interpolated.

    The choice is exactly the best one among all subsets of the rows, a shortest path whose edges are pairs of
    neighbouring rows. Of more than 256 rows it is the best among 256 candidates and those of largest deviation; or,
    with a tolerance of the gains alone, the fewest rows, whichever of these are the most accurate.

    Args:
        deviation: the table to choose from, with its measure of deviation.
        rows: at most so many, with the smallest largest deviation; or
        tolerance: the fewest rows with at most this largest deviation, and of those the most accurate.

    Returns:
        Positions of the rows among all, shape (m,).

    Raises:
        InputError: neither or both of ``rows`` and ``tolerance``, or no subset suffices.
    """
    if (rows is None) == (tolerance is None):
        raise InputError.of("give one of rows and tolerance", key="rows")
    if rows is not None and rows < 1:
        raise InputError.of(f"is {rows}; allowed: at least 1", key="rows")
    if tolerance is not None and not tolerance >= 0:
        raise InputError.of(f"is {tolerance:g}; allowed: at least 0", key="tolerance")
    n = len(deviation.table)
    if tolerance is not None and deviation.linear and n > _CANDIDATES:
        return _fewest(deviation, tolerance)
    candidates = np.unique(np.linspace(0, n - 1, min(n, _CANDIDATES)).round().astype(np.intp))
    for _ in range(_ROUNDS):
        kept = candidates[_best_path(_edges(deviation, candidates), rows, tolerance)]
        error = deviation.at(kept)
        if tolerance is None or error.max() <= tolerance:
            break
        worst = np.argsort(error)[-_ADDED:]
        candidates = np.union1d(candidates, worst[error[worst] > tolerance])
    return kept


class Deviation:
    """Deviation of other gains from those of a row: the largest relative one of b, k and b_p.

    Attributes:
        table: all rows, (n, 4).
        size: reference of each gain's relative deviation, (n, 3).
        linear: whether it is linear in the gains, so that a slope decides.
    """

    linear = True

    def __init__(self, table: FloatArray) -> None:
        self.table = table
        self.size = np.where(table[:, 1:] == 0, np.maximum(table[:, 1:].max(axis=0), 1.0), table[:, 1:])

    def of(self, row: IndexArray, gains: FloatArray) -> FloatArray:
        """Return the relative deviation of gains (..., 3) from those of the rows ``row`` (...,)."""
        return np.asarray((np.abs(gains - self.table[row, 1:]) / self.size[row]).max(axis=-1))

    def admitted(self, row: IndexArray, gains: FloatArray) -> BoolArray:
        """Return whether such gains may replace those of the row."""
        return np.ones(np.broadcast_shapes(row.shape, gains.shape[:-1]), dtype=bool)

    def at(self, kept: IndexArray) -> FloatArray:
        """Return the deviation of each row of the table when only some are kept, (n,)."""
        return self.of(np.arange(len(self.table)), interpolate(self.table[kept], self.table[:, 0]))


def _fewest(deviation: Deviation, tolerance: float) -> IndexArray:
    """Return positions of the fewest rows between which all others are within a tolerance of the gains.

    A line from one row is within tolerance up to another one if its slope lies in the interval of each row between, for
    every gain: a cone that only narrows, so that the search ends where it is empty. The fewest steps from first to last
    are found row after row.
    """
    ln_frequency, gains, room = np.log(deviation.table[:, 0]), deviation.table[:, 1:], tolerance * deviation.size
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


def _edges(deviation: Deviation, candidates: IndexArray) -> FloatArray:
    """Return the largest deviation at the candidates between two, (c, c); infinite where the pair is not admitted."""
    table = deviation.table[candidates]
    ln_frequency, gains = np.log(table[:, 0]), table[:, 1:]
    count = len(table)
    edges = np.full((count, count), np.inf)
    for first in range(count - 1):
        edges[first, first + 1] = 0.0
        last, between = np.meshgrid(np.arange(first + 2, count), np.arange(first + 1, count - 1), indexing="ij")
        inside = between < last
        last, between = last[inside], between[inside]
        if not last.size:
            continue
        share = (ln_frequency[between] - ln_frequency[first]) / (ln_frequency[last] - ln_frequency[first])
        guess = gains[first] + share[:, None] * (gains[last] - gains[first])
        row = candidates[between]
        error = np.where(deviation.admitted(row, guess), deviation.of(row, guess), np.inf)
        worst = np.zeros(count)
        np.maximum.at(worst, last, error)
        edges[first, first + 2 :] = worst[first + 2 :]
    return edges


def _best_path(edges: FloatArray, rows: int | None, tolerance: float | None) -> IndexArray:
    """Return positions of the best rows: a path from first to last with the smallest largest edge.

    value[j] after m steps is the smallest largest edge of a path to j of m edges, so that one sweep over m answers both
    questions.
    """
    count = len(edges)
    if count == 1 or rows == 1:
        return np.zeros(1, dtype=np.intp)
    value = np.where(np.arange(count) == 0, 0.0, np.inf)
    came: list[IndexArray] = []
    values: list[float] = []
    for _ in range(min(count, rows or count) - 1):
        through = np.maximum(value[:, None], edges)
        came.append(through.argmin(axis=0))
        value = through.min(axis=0)
        values.append(float(value[-1]))
        if tolerance is not None and value[-1] <= tolerance:
            break
    steps = int(np.argmin(values))
    if not np.isfinite(values[steps]):
        raise InputError.of(
            f"no table of {rows} rows keeps Re Z_h at the margin between its rows; allowed: more rows, up to {count}",
            key="rows",
        )
    path = [count - 1]
    for step in range(steps, -1, -1):
        path.append(int(came[step][path[-1]]))
    return np.array(path[::-1], dtype=np.intp)
