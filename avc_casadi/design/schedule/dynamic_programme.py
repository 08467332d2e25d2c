"""The cheapest path through a lattice of states, by dynamic programming."""

from __future__ import annotations

import numpy as np

from avc_casadi._util.arrays import FloatArray


def cheapest_path(
    costs: FloatArray, axes: list[FloatArray], log_frequency: FloatArray, slope_penalty: float, slope_limit: float
) -> FloatArray:
    """Return the states (d, n) of the cheapest path through a lattice; ``costs`` (n, nodes in C order) are weighted.

    The slope penalty is a sum over the states: the minimum over the predecessor is taken one state at a time.
    """
    shape = tuple(len(axis) for axis in axes)
    span = log_frequency[-1] - log_frequency[0]
    value, values, moves = costs[0].reshape(shape), [], []
    for here, step in zip(costs[1:], np.diff(log_frequency), strict=True):
        for dimension, axis in enumerate(axes):
            distance = np.abs(axis[:, None] - axis)
            within = distance <= max(slope_limit * step, 1.001 * np.diff(axis[:2]).sum())
            values.append(value)
            moves.append(np.where(within, slope_penalty / (span * step) * distance**2, np.inf))
            lines = np.ascontiguousarray(np.moveaxis(value, dimension, 0))
            best = np.full_like(lines, np.inf)
            for line, move in zip(lines, moves[-1].T, strict=True):
                np.minimum(best, line + move.reshape(-1, *([1] * line.ndim)), out=best)
            value = np.moveaxis(best, 0, dimension)
        value = value + here.reshape(shape)
    at = list(np.unravel_index(int(value.argmin()), shape))
    states = [[axis[i] for axis, i in zip(axes, at, strict=True)]]
    for number in reversed(range(len(moves))):
        dimension = number % len(axes)
        line = values[number][tuple(slice(None) if axis == dimension else i for axis, i in enumerate(at))]
        at[dimension] = (line + moves[number][at[dimension]]).argmin()
        if dimension == 0:
            states.append([axis[i] for axis, i in zip(axes, at, strict=True)])
    return np.array(states[::-1]).T
