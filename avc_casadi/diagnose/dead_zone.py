"""The dead zone of a spring: the positions between which its force is none."""

from __future__ import annotations

import numpy as np

from avc_casadi._util.arrays import FloatArray

_STARTS = (0.1, 0.35, 0.7)
"""Shares of the range of the position that a dead zone takes at the begin of a search."""

_STEPS = 25
"""Most steps of a search."""

_SETTLED = 1e-9
"""Share of the range of the position up to which an edge moves no more."""

_FEWEST_ON_A_SIDE = 6
"""Samples that lie beyond either edge at least; a device that soon rests leaves most of a log on one side."""


def outside(position: FloatArray, edges: tuple[float, float]) -> FloatArray:
    """Return how far positions lie outside a dead zone, with their sign, m."""
    return position - np.clip(position, *edges)


def dead_zone(force: FloatArray, position: FloatArray, change: FloatArray) -> tuple[float, float] | None:
    """Return the edges, m, of the dead zone with which F = k outside(x) + b v explains a force best, or None.

    F is nearly linear in the edges: k outside(x) + b v - k (move of the upper) [x > upper] - k (move of the lower)
    [x < lower]. Each regression of these four columns tells how far the edges move (Gauss and Newton).
    """
    travel = float(np.ptp(position))
    if not travel:
        return None
    middle = float(position.max() + position.min()) / 2
    best, least = None, float("inf")
    for share in _STARTS:
        low, high = middle - share * travel / 2, middle + share * travel / 2
        residual = float("inf")
        for _ in range(_STEPS):
            above, below = position > high, position < low
            if min(np.count_nonzero(above), np.count_nonzero(below)) < _FEWEST_ON_A_SIDE:
                break
            columns = np.stack([outside(position, (low, high)), change, above, below], axis=1)
            size = np.maximum(np.abs(columns).max(axis=0), 1e-300)
            gains = np.linalg.lstsq(columns / size, force, rcond=1e-12)[0] / size
            residual = float(np.std(force - columns @ gains))
            if gains[0] <= 0:
                break
            up, down = (-gains[2:] / gains[0]).tolist()
            low, high = low + down, high + up
            if low >= high or max(abs(up), abs(down)) < _SETTLED * travel:
                break
        if low < high and residual < least:
            best, least = (low, high), residual
    return best
