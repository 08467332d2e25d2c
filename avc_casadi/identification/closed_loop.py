"""Whether the force follows the position, and whether what the model leaves over would then bias it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from avc_casadi._util.arrays import FloatArray
from avc_casadi.identification.record import Record

_AHEAD = 25
LAGS = 40
# Of the force is left out what it says of itself: a recursion of this order for each stretch of so many samples.
_OWN, _STRETCH = 60, 1000
# Correlations beyond so many standard deviations of white noise are there.
_SURE = 5.0
# A prediction error as coloured as this is not noise of the encoder alone.
_COLOURED = 0.25


def feeds_back(records: Sequence[Record], errors: Sequence[FloatArray]) -> bool:
    """Return whether what the force does not say of itself follows what the model could not foresee of the position.

    A chirp says all of itself. What a poor model leaves over of it goes on like it, and is no feedback (Granger 1969).

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
    """Return what a force does not foretell by its own past, of the same size."""
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


def coloured(lags: FloatArray) -> bool:
    """Return whether a prediction error is far from white noise."""
    return bool(np.abs(lags[:20]).max() > _COLOURED)
