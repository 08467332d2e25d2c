"""A dynamic programme over a lattice of states: a start that no local minimum can trap, and what it costs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from avc_casadi._util.arrays import FloatArray

_STAGES = 40
_CONSTANTS = 4
_POINTS = {2: (64, 64), 3: (22, 22, 10)}

StageCosts = Callable[[FloatArray], Callable[[int], FloatArray]]
"""states (d, m) -> stage -> cost of each, (m,), with a penalty where it misses a constraint."""


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
    costs: StageCosts,
    box: tuple[FloatArray, FloatArray],
    log_frequency: FloatArray,
    slope_penalty: float,
    slope_limit: float,
    points: tuple[int, ...] | None = None,
) -> LatticePath:
    """Find the cheapest path through the lattice, exactly for the lattice.

    The slope penalty is a sum over the states, so that the minimum over the predecessor is taken one state at a time.

    Args:
        costs: cost of states at a stage.
        box: ends of the states, (d,) each.
        log_frequency: ln(omega) of the stages, (n,).
        slope_penalty: weight of the mean squared slope.
        slope_limit: largest slope; one lattice step is always allowed.
        points: nodes along each state; None for the usual ones.
    """
    low, high = box
    n = len(log_frequency)
    chosen = np.unique(np.linspace(0, n - 1, min(n, _STAGES)).round().astype(int))
    axes, nodes = lattice_nodes(low, high, points)
    shape = tuple(len(axis) for axis in axes)
    span = max(log_frequency[-1] - log_frequency[0], 1e-12)
    values: list[FloatArray] = []
    moves: list[FloatArray] = []
    value = np.zeros(shape)
    everywhere = np.zeros(nodes.shape[1])
    at_stage = costs(nodes)
    for position, stage in enumerate(chosen):
        here = at_stage(int(stage))
        share = _share(log_frequency[chosen], position, span)
        everywhere += here * share
        if position:
            step = log_frequency[stage] - log_frequency[chosen[position - 1]]
            for dimension, axis in enumerate(axes):
                values.append(value)
                move = _move(axis, slope_penalty / (span * step), slope_limit * step)
                moves.append(move)
                value = _cheapest(value, move, dimension)
        value = value + (here * share).reshape(shape)
    path = _trace(value, values, moves, axes)
    along = [np.interp(log_frequency, log_frequency[chosen], row) for row in path]
    return LatticePath(np.array(along), nodes[:, _local_minima(everywhere.reshape(shape))])


def lattice_nodes(
    low: FloatArray, high: FloatArray, points: tuple[int, ...] | None = None
) -> tuple[list[FloatArray], FloatArray]:
    """Axes of the lattice between two corners of the box, and all its nodes, (d, m)."""
    counts = points or _POINTS[len(low)]
    axes = [np.linspace(a, b, count if b > a else 1) for a, b, count in zip(low, high, counts, strict=True)]
    return axes, np.array([grid.ravel() for grid in np.meshgrid(*axes, indexing="ij")])


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


def _move(axis: FloatArray, penalty: float, reach: float) -> FloatArray:
    """What a move between two places on an axis costs, (n, n): to the row from the column."""
    distance = np.abs(axis[:, None] - axis[None, :])
    spacing = axis[1] - axis[0] if len(axis) > 1 else 0.0
    return np.where(distance <= max(reach, 1.001 * spacing), penalty * distance**2, np.inf)


def _cheapest(value: FloatArray, move: FloatArray, dimension: int) -> FloatArray:
    """Minimise over where one state came from."""
    lines = np.ascontiguousarray(np.moveaxis(value, dimension, 0)).reshape(len(move), -1)
    best, tried = np.full_like(lines, np.inf), np.empty_like(lines)
    for line, steps in zip(lines, move.T, strict=True):
        # One place it may have come from at a time: all of it stays in the processor's cache.
        np.add(line, steps[:, None], out=tried)
        np.minimum(best, tried, out=best)
    shape = np.moveaxis(value, dimension, 0).shape
    return np.moveaxis(best.reshape(shape), 0, dimension)


def _trace(value: FloatArray, values: list[FloatArray], moves: list[FloatArray], axes: list[FloatArray]) -> FloatArray:
    """Follow the cheapest end back to the first stage; states (d, stages).

    Args:
        value: at the last stage.
        values: what each state was minimised from, one state after another.
        moves: what its moves cost.
        axes: places of each state.
    """
    at = list(np.unravel_index(int(value.argmin()), value.shape))
    states = [[axis[i] for axis, i in zip(axes, at, strict=True)]]
    for number in reversed(range(len(moves))):
        dimension = number % len(axes)
        line = values[number][tuple(slice(None) if axis == dimension else i for axis, i in enumerate(at))]
        at[dimension] = (line + moves[number][at[dimension]]).argmin()
        if dimension == 0:
            states.append([axis[i] for axis, i in zip(axes, at, strict=True)])
    return np.array(states[::-1]).T
