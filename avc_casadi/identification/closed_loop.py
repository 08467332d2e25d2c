"""Feedback of the position as the force of a log, and whether a prediction error is white.

Where feedback is the whole force of a log, the motion comes from an input that is not logged, the operator's hand, and
a fit takes the one for a response to the other, whatever its prediction error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from avc_casadi._util.arrays import FloatArray, IndexArray
from avc_casadi.identification.log import Record

LAGS = 40
# A prediction error as coloured as this is more than encoder noise.
_COLOURED = 0.25
_MOST_LAG, _FEWEST, _MOST_KEPT = 4, 100, 0.98
# Residual of spring and damper, as a share of the force's changes from sample to sample, and of the force itself: an
# output of few bits rounds by more than the former. A force nearer to the largest is saturated.
_OF_CHANGES, _OF_FORCE, _WHOLE = 0.05, 5e-3, 0.999
# A released device settles: later it moves by less than this share of what it did before.
_GOES_ON = 0.1


def autocorrelation(errors: Sequence[FloatArray]) -> FloatArray:
    """Return the autocorrelation of prediction errors from lag 1 on, shape (LAGS,)."""
    total = sum(float(error @ error) for error in errors) + 1e-300
    return np.array([sum(float(e[lag:] @ e[:-lag]) for e in errors) / total for lag in range(1, LAGS + 1)])


def coloured(lags: FloatArray, *, resampled: bool = False) -> bool:
    """Return whether an error is far from white; interpolated positions make neighbours of white noise alike."""
    return bool(np.abs(lags[int(resampled) : 20]).max() > _COLOURED)


@dataclass(frozen=True)
class Feedback:
    """F(n) = k x(n-lag) + b v(n-lag) + offset, v(n) = keep v(n-1) + (1 - keep) (x(n) - x(n-1))/T, and its residual."""

    stiffness_n_per_m: float
    damping_ns_per_m: float
    keep: float
    offset_n: float
    left_n: float


def regression(columns: FloatArray, wanted: FloatArray) -> tuple[FloatArray, float] | None:
    """Return the factors of least squares and the residual, root mean square; None where columns are alike."""
    scale = np.sqrt(np.mean(columns**2, axis=0))
    if columns.shape[0] <= columns.shape[1] or not scale.all():
        return None
    factors, _, rank, _ = np.linalg.lstsq(columns / scale, wanted, rcond=1e-9)
    if rank < columns.shape[1]:
        return None
    return np.asarray(factors / scale), float(np.sqrt(np.mean((wanted - columns @ (factors / scale)) ** 2)))


def feedback(
    position: FloatArray, force: FloatArray, rows: IndexArray, lag: int, period_s: float, *, filtered: bool
) -> Feedback | None:
    """Return the spring and damper that explain a force best, with a filter of the velocity or without."""
    x, before = position[rows - lag], position[rows - lag - 1]
    columns = [x - x.mean(), x - before, np.ones(rows.size)] + ([force[rows - 1]] if filtered else [])
    found = regression(np.stack(columns, axis=1), force[rows])
    keep = float(found[0][3]) if found is not None and filtered else 0.0
    if found is None or not 0 <= keep < _MOST_KEPT:
        return None
    # F = keep F_before + k (1 - keep) x + (b (1 - keep)/T + k keep)(x - x_before)
    k = float(found[0][0]) / (1 - keep)
    b = (float(found[0][1]) - k * keep) * period_s / (1 - keep)
    return Feedback(k, b, keep, float(found[0][2]) / (1 - keep) - k * float(x.mean()), found[1])


def only_feedback(records: Sequence[Record]) -> bool:
    """Return whether a controller explains the whole force of every record, while the device goes on moving."""
    halves = [[float(np.ptp(part)) for part in np.array_split(one.position_m, 2)] for one in records]
    return any(late > _GOES_ON * early for early, late in halves) and all(map(_explained, records))


def _explained(record: Record) -> bool:
    position, force = record.position_m, record.force_n
    size = np.abs(force)
    whole = (size > 1e-9 * size.max()) & (size < _WHOLE * size.max())
    for lag in range(_MOST_LAG + 1):
        rows = np.flatnonzero(whole)
        rows = rows[rows > lag + 1]
        rows = rows[whole[rows - 1]]
        if rows.size < _FEWEST:
            return False
        for filtered in (False, True):
            one = feedback(position, force, rows, lag, record.sample_time_s, filtered=filtered)
            most = _OF_CHANGES * float(np.std(force[rows] - force[rows - 1]))
            most = most if filtered else max(most, _OF_FORCE * float(np.std(force[rows])))
            # Against the position, with a damper that does not drive it.
            against = one is not None and one.damping_ns_per_m < -one.stiffness_n_per_m * record.sample_time_s
            if one is not None and one.left_n <= most and one.stiffness_n_per_m < 0 and against:
                return True
    return False
