"""Whether feedback of the position is the whole force of a log, and whether a prediction error is white.

Where the whole force is feedback of the position, the motion comes from an input that is not logged, the operator's
hand, and a fit takes the one for a response to the other, whatever its prediction error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from avc_casadi._util.arrays import FloatArray, IndexArray
from avc_casadi.identification.record import Record

LAGS = 40
# A prediction error as coloured as this is more than encoder noise.
_COLOURED = 0.25


def autocorrelation(errors: Sequence[FloatArray]) -> FloatArray:
    """Return the autocorrelation of prediction errors from lag 1 on, shape (LAGS,)."""
    total = sum(float(error @ error) for error in errors) + 1e-300
    return np.array([sum(float(e[lag:] @ e[:-lag]) for e in errors) / total for lag in range(1, LAGS + 1)])


def coloured(lags: FloatArray, *, resampled: bool = False) -> bool:
    """Return whether an error is far from white; interpolated positions make neighbours of white noise alike."""
    return bool(np.abs(lags[int(resampled) : 20]).max() > _COLOURED)


_MOST_LAG = 4
_FEWEST = 100
# Residual of spring and damper, as a share of the force's changes from sample to sample, and of the force itself: an
# output of few bits rounds by more than the former.
_OF_CHANGES, _OF_FORCE = 0.05, 5e-3
_MOST_KEPT = 0.98
# A force nearer to the largest is saturated.
_WHOLE = 0.999
# A released device settles: later it moves by less than this share of what it did before.
_GOES_ON = 0.1


@dataclass(frozen=True)
class OnlyFeedback:
    """F(n) = -k x - b dx/dt + a constant, some samples later, its velocity filtered or not."""

    stiffness_n_per_m: float
    damping_ns_per_m: float


def only_feedback(records: Sequence[Record]) -> OnlyFeedback | None:
    """Return the controller that explains the whole force of every record, or None."""
    found = [_controller(record) for record in records]
    moved = any(_goes_on(record.position_m) for record in records)
    return found[0] if moved and all(one is not None for one in found) else None


def _goes_on(position: FloatArray) -> bool:
    early, late = np.array_split(position, 2)
    return bool(np.ptp(late) > _GOES_ON * np.ptp(early))


def _controller(record: Record) -> OnlyFeedback | None:
    position, force = record.position_m, record.force_n
    size = np.abs(force)
    whole = (size > 1e-9 * size.max()) & (size < _WHOLE * size.max())
    for lag in range(_MOST_LAG + 1):
        for filtered in (False, True):
            rows = np.flatnonzero(whole)
            rows = rows[rows > lag + 1]
            rows = rows[whole[rows - 1]]
            if rows.size < _FEWEST:
                return None
            one = _fit(position, force, rows, lag, filtered, record.sample_time_s)
            if one is not None:
                return one
    return None


def regression(columns: FloatArray, wanted: FloatArray) -> tuple[FloatArray, float, int]:
    """Return least squares on columns scaled to one size: factors, root mean square residual, rank."""
    scale = np.sqrt(np.mean(columns**2, axis=0)) + 1e-300
    scaled, _, rank, _ = np.linalg.lstsq(columns / scale, wanted, rcond=1e-10)
    factors = np.asarray(scaled / scale)
    return factors, float(np.sqrt(np.mean((columns @ factors - wanted) ** 2))), int(rank)


def _fit(
    position: FloatArray, force: FloatArray, rows: IndexArray, lag: int, filtered: bool, period_s: float
) -> OnlyFeedback | None:
    x, before = position[rows - lag], position[rows - lag - 1]
    columns = [x - x.mean(), x - before, np.ones(rows.size)] + ([force[rows - 1]] if filtered else [])
    matrix = np.stack(columns, axis=1)
    told, left, _ = regression(matrix, force[rows])
    most = _OF_CHANGES * float(np.std(force[rows] - force[rows - 1]))
    if not filtered:
        most = max(most, _OF_FORCE * float(np.std(force[rows])))
    keep = float(told[3]) if filtered else 0.0
    if left > most or not 0 <= keep < _MOST_KEPT:
        return None
    # F = keep F_before - k (1 - keep) x - (b (1 - keep)/T + k keep)(x - x_before)
    k = -float(told[0]) / (1 - keep)
    b = -(float(told[1]) + k * keep) * period_s / (1 - keep)
    return OnlyFeedback(k, b) if k > 0 and b > -k * period_s else None
