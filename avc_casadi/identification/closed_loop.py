"""Feedback in a log: whether force follows position, whether that biases a fit, whether it is the whole force.

Where the whole force is feedback of the position, the motion comes from an unlogged input, the operator's hand. Its
force is as large as the logged one, and a fit takes the one for a response to the other, whatever its prediction error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from avc_casadi._util.arrays import FloatArray, IndexArray
from avc_casadi._util.text import number
from avc_casadi._util.units import FORCE, N_PER_M, NS_PER_M, Wording
from avc_casadi.identification.model import Refusal
from avc_casadi.identification.record import Record

_AHEAD = 25
LAGS = 40
# The force is prewhitened by an autoregression of this order for each stretch of so many samples.
_OWN, _STRETCH = 60, 1000
# Correlations beyond so many standard deviations of white noise are significant.
_SURE = 5.0
# A prediction error as coloured as this is more than encoder noise.
_COLOURED = 0.25


def feeds_back(records: Sequence[Record], errors: Sequence[FloatArray]) -> bool:
    """Return whether the innovation of the force follows the prediction error of the position.

    A chirp has no innovation: what a poor model leaves unexplained of it is predictable, hence no feedback (Granger
    1969).

    Args:
        records: of one device.
        errors: prediction error of the end of each record, m.
    """
    size = sum(error.size - _AHEAD for error in errors)
    found = []
    news = [_news(record.force_n[-error.size :]) for record, error in zip(records, errors, strict=True)]
    for ahead in range(_AHEAD):
        sums = np.zeros(3)
        for force, error in zip(news, errors, strict=True):
            e, f = error[: error.size - _AHEAD], force[ahead : error.size - _AHEAD + ahead]
            e, f = e - e.mean(), f - f.mean()
            sums += (float(e @ f), float(e @ e), float(f @ f))
        found.append(sums[0] / np.sqrt(sums[1] * sums[2] + 1e-300))
    return bool(np.abs(found).max() > _SURE / np.sqrt(size))


def _news(force: FloatArray) -> FloatArray:
    """Return the innovation of a force given its own past, of the same size."""
    padded = np.concatenate([np.full(_OWN, force[0]), force])
    past = sliding_window_view(padded, _OWN)[:-1]
    left = np.empty_like(force)
    for rows in np.array_split(np.arange(force.size), max(1, force.size // _STRETCH)):
        left[rows] = force[rows] - past[rows] @ np.linalg.lstsq(past[rows], force[rows], rcond=None)[0]
    return left


def autocorrelation(errors: Sequence[FloatArray]) -> FloatArray:
    """Return the autocorrelation of prediction errors from lag 1 on, shape (LAGS,).

    Args:
        errors: of each record, m.
    """
    total = sum(float(error @ error) for error in errors) + 1e-300
    return np.array([sum(float(e[lag:] @ e[:-lag]) for e in errors) / total for lag in range(1, LAGS + 1)])


def coloured(lags: FloatArray, *, resampled: bool = False) -> bool:
    """Return whether a prediction error is far from white noise.

    Args:
        lags: its autocorrelation, from lag 1 on.
        resampled: whether positions were interpolated, which makes neighbours of white noise alike.
    """
    return bool(np.abs(lags[int(resampled) : 20]).max() > _COLOURED)


EXCITATION = Wording.of(
    lambda: f"a {FORCE} of its own beside the controller (a multisine, as avc excite plays one), hands off"
)
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
    """F(n) = -k x - b dx/dt + a constant, some samples later, its velocity filtered or not.

    Attributes:
        stiffness_n_per_m: k.
        damping_ns_per_m: b.
    """

    stiffness_n_per_m: float
    damping_ns_per_m: float

    def sentence(self, radius_m: float) -> str:
        """Describe the controller in one sentence.

        Args:
            radius_m: travel of the handle per unit of position.
        """
        k, b = (number(radius_m**2 * gain, 3) for gain in (self.stiffness_n_per_m, self.damping_ns_per_m))
        return (
            f"the {FORCE} is a spring of {k} {N_PER_M} and a damper of {b} {NS_PER_M} on the measured position, and "
            "nothing else"
        )


def refused_beside(keys: Sequence[str]) -> dict[str, Refusal]:
    """Return a refusal of every parameter where only feedback acts, by key.

    Args:
        keys: of the searched parameters; friction is one more, estimated or bounded.
    """
    why = f"the {FORCE} follows from the position alone, and what moves the device is not in the log"
    names = dict.fromkeys([*(key.partition(".")[0] for key in keys), "coulomb_friction_n"])
    return {key: Refusal(key, why, str(EXCITATION)) for key in names}


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
