"""A coarse dynamic programme over a lattice of states: a start that no local minimum can trap."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from avc_casadi.support import FloatArray

_STAGES = 40
_CONSTANTS = 4
_POINTS = {2: (24, 24), 3: (14, 14, 7)}

StageCost = Callable[[FloatArray, int], FloatArray]
"""(states (d, m), stage) -> cost of each, (m,), with a penalty where it misses a constraint."""


@dataclass(frozen=True)
class LatticePath:
    """What a lattice knows.

    Attributes:
        path: states along the cheapest path, (d, n).
        constant: states of the cheapest constant gains, then of others that no neighbour betters; (d, 1 to 4).
    """

    path: FloatArray
    constant: FloatArray


def lattice_path(
    cost: StageCost,
    box: tuple[FloatArray, FloatArray],
    log_frequency: FloatArray,
    slope_penalty: float,
    slope_limit: float,
) -> LatticePath:
    """Find the cheapest path through the lattice, exactly for the lattice.

    The slope penalty is a sum over the states, so that the minimum over the predecessor is taken one state at a time.

    Args:
        cost: cost of states at a stage.
        box: ends of the states, (d,) each.
        log_frequency: ln(omega) of the stages, (n,).
        slope_penalty: weight of the mean squared slope.
        slope_limit: largest slope; one lattice step is always allowed.
    """
    low, high = box
    n = len(log_frequency)
    chosen = np.unique(np.linspace(0, n - 1, min(n, _STAGES)).round().astype(int))
    axes = [
        np.linspace(a, b, points if b > a else 1) for a, b, points in zip(low, high, _POINTS[len(low)], strict=True)
    ]
    shape = tuple(len(axis) for axis in axes)
    nodes = np.array([grid.ravel() for grid in np.meshgrid(*axes, indexing="ij")])
    span = max(log_frequency[-1] - log_frequency[0], 1e-12)
    back: list[list[NDArray[np.intp]]] = []
    value = np.zeros(shape)
    everywhere = np.zeros(nodes.shape[1])
    for position, stage in enumerate(chosen):
        here = cost(nodes, int(stage))
        share = _share(log_frequency[chosen], position, span)
        everywhere += here * share
        moves = []
        if position:
            step = log_frequency[stage] - log_frequency[chosen[position - 1]]
            for dimension, axis in enumerate(axes):
                value, came = _cheapest(value, axis, dimension, slope_penalty / (span * step), slope_limit * step)
                moves.append(came)
        value = value + (here * share).reshape(shape)
        back.append(moves)
    path = _trace(value, back, axes)
    along = [np.interp(log_frequency, log_frequency[chosen], row) for row in path]
    return LatticePath(np.array(along), nodes[:, _local_minima(everywhere.reshape(shape))])


def _local_minima(value: FloatArray) -> NDArray[np.intp]:
    """Positions in the flattened array that no neighbour along an axis betters, the best first."""
    lowest = np.ones(value.shape, dtype=bool)
    for axis in range(value.ndim):
        along, kept = np.moveaxis(value, axis, 0), np.moveaxis(lowest, axis, 0)
        kept[1:] &= along[1:] <= along[:-1]
        kept[:-1] &= along[:-1] <= along[1:]
    found = np.flatnonzero(lowest)
    return found[np.argsort(value.ravel()[found], kind="stable")][:_CONSTANTS]


def _share(log_frequency: FloatArray, position: int, span: float) -> float:
    """Share of a stage in the mean over ln(omega), by trapezoids."""
    if len(log_frequency) == 1:
        return 1.0
    ends = log_frequency[max(position - 1, 0)], log_frequency[min(position + 1, len(log_frequency) - 1)]
    return float((ends[1] - ends[0]) / 2 / span)


def _cheapest(
    value: FloatArray, axis: FloatArray, dimension: int, penalty: float, reach: float
) -> tuple[FloatArray, NDArray[np.intp]]:
    """Minimise over where one state came from; returns the values and the positions it came from."""
    distance = np.abs(axis[:, None] - axis[None, :])
    spacing = axis[1] - axis[0] if len(axis) > 1 else 0.0
    move = np.where(distance <= max(reach, 1.001 * spacing), penalty * distance**2, np.inf)
    moved = np.moveaxis(value, dimension, -1)[..., None, :] + move
    came = moved.argmin(axis=-1)
    best = np.take_along_axis(moved, came[..., None], axis=-1)[..., 0]
    return np.moveaxis(best, -1, dimension), np.moveaxis(came, -1, dimension)


def _trace(value: FloatArray, back: list[list[NDArray[np.intp]]], axes: list[FloatArray]) -> FloatArray:
    """Follow the cheapest end back to the first stage; states (d, stages)."""
    at = list(np.unravel_index(int(value.argmin()), value.shape))
    states = []
    for moves in reversed(back):
        states.append([axis[i] for axis, i in zip(axes, at, strict=True)])
        # The states were minimised one after another, so that they are undone in the opposite order.
        for dimension in reversed(range(len(moves))):
            at[dimension] = moves[dimension][tuple(at)]
    return np.array(states[::-1]).T
