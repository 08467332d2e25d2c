"""Whether the force follows the position, and whether what the model leaves over would then bias it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from avc_casadi.identification._record import Record
from avc_casadi.support import FloatArray

_AHEAD = 25
LAGS = 40
# Correlations beyond so many standard deviations of white noise are there.
_SURE = 5.0
# A prediction error as coloured as this is not noise of the encoder alone.
_COLOURED = 0.25


def feeds_back(records: Sequence[Record], errors: Sequence[FloatArray]) -> bool:
    """Return whether changes of the force follow what the model could not foresee of the position.

    Args:
        records: of one device.
        errors: prediction error of the end of each record, m.
    """
    size = sum(error.size - _AHEAD for error in errors)
    found = []
    for ahead in range(_AHEAD):
        sums = np.zeros(3)
        for record, error in zip(records, errors, strict=True):
            change = np.diff(record.force_n[-error.size :], prepend=record.force_n[-error.size])
            e, f = error[: error.size - _AHEAD], change[ahead : error.size - _AHEAD + ahead]
            e, f = e - e.mean(), f - f.mean()
            sums += (float(e @ f), float(e @ e), float(f @ f))
        found.append(sums[0] / np.sqrt(sums[1] * sums[2] + 1e-300))
    return bool(np.abs(found).max() > _SURE / np.sqrt(size))


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
