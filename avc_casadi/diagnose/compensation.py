"""A force that the sign of a filtered velocity switches: friction that is compensated, or a relay, behind a filter."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy import signal

from avc_casadi._util.arrays import FloatArray, IndexArray

_FILTER_TICKS = (0.5, 60.0)
"""Shortest and longest time constant of a filter that is tried, ticks."""

_FILTERS = 14
"""Filters that are tried beside none."""

_WIDTHS = (0.0, 0.02, 0.06, 0.2, 0.6)
"""Widths v0 of tanh(v/v0) that are tried, per root mean square of the velocity; 0 is a sign."""

_BEST = 4
"""Trials that are refined."""

_REFINEMENTS = 8
"""Rounds in which filter and width are searched more finely."""

_MOST_ROWS = 1500
"""Samples by which the trials are compared."""


@dataclass(frozen=True)
class FilteredSign:
    """What switches a force: tanh(v/v0), or the sign of v where v0 is 0, with v(n) = keep v(n-1) + (1 - keep) u(n)."""

    lag: int
    """Age of the position that the law reads, ticks."""
    keep: float
    """Share of the velocity that the filter keeps in a tick."""
    width: float
    """v0, change of the position in a tick, m."""
    damper_filtered: bool
    """Whether the damper reads the filtered velocity too."""


def filtered_change(change: FloatArray, keep: float) -> FloatArray:
    """Return the change of the position in a tick behind a filter, shape (n,), m."""
    return np.asarray(signal.lfilter([1 - keep], [1, -keep], change), dtype=np.float64)


def switched(change: FloatArray, width: float) -> FloatArray:
    """Return tanh(v/v0), or the sign of v."""
    return np.tanh(change / width) if width else np.sign(change)


def find_filtered_sign(force: FloatArray, position: FloatArray, rows: IndexArray, most_lag: int) -> FilteredSign | None:
    """Return the filter, width and lag with which F = k x + b v + c tanh(v/v0) + offset explains a force best, or None.

    `force` and `position` are of all ticks, `rows` those that count. Of each trial k, b, c and the offset are one
    regression; the best ones are refined.
    """
    rows = rows[rows > most_lag]
    rows = rows[:: max(1, rows.size // _MOST_ROWS)]
    change = np.diff(position, prepend=position[:1])
    speed = float(np.sqrt(np.mean(change[rows] ** 2))) if rows.size else 0.0
    if not speed:
        return None

    def residual(trial: FilteredSign) -> float:
        filtered = filtered_change(change, trial.keep)
        read = rows - trial.lag
        damper = filtered[read] if trial.damper_filtered else change[read]
        columns = np.stack([position[read], damper, switched(filtered[read], trial.width), np.ones(rows.size)], axis=1)
        columns /= np.maximum(np.abs(columns).max(axis=0), 1e-300)
        gains = np.linalg.lstsq(columns, force[rows], rcond=1e-9)[0]
        return float(np.sum((columns @ gains - force[rows]) ** 2))

    shortest, longest = _FILTER_TICKS
    constants = np.geomspace(shortest, longest, _FILTERS).tolist()
    keeps = [0.0, *(math.exp(-1 / ticks) for ticks in constants)]
    options = itertools.product(range(most_lag + 1), keeps, _WIDTHS, (True, False))
    trials = [FilteredSign(lag, keep, width * speed, damper_filtered) for lag, keep, width, damper_filtered in options]
    trials.sort(key=residual)
    step = (longest / shortest) ** (1 / (_FILTERS - 1))
    return min((_refined(trial, residual, step) for trial in trials[:_BEST]), key=residual)


def _refined(trial: FilteredSign, residual: Callable[[FilteredSign], float], step: float) -> FilteredSign:
    """Return a trial of filter and width of a sign of the speed, refined in turn to the least residual.

    `step` is the factor between neighbours of the first scan; each round searches between the last ones.
    """
    spread = math.log(step)
    for _ in range(_REFINEMENTS):
        factors = np.exp(spread * np.linspace(-1, 1, 9)).tolist()
        if trial.keep:
            keeps = [math.exp(math.log(trial.keep) / factor) for factor in factors]
            trial = min((replace(trial, keep=keep) for keep in keeps), key=residual)
        if trial.width:
            trial = min((replace(trial, width=trial.width * factor) for factor in factors), key=residual)
        spread /= 2.5
    return trial
