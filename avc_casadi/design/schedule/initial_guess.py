"""Initial guesses of the NLP: the path of a dynamic programme over a lattice, constant gains, the separate optima."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from avc_casadi._util.arrays import FloatArray
from avc_casadi.design.schedule.hands import TABLE_POINTS, HandsRadii, admissible_states
from avc_casadi.design.schedule.infeasible import Missing
from avc_casadi.design.schedule.nlp import Data
from avc_casadi.design.schedule.scope import Slots
from avc_casadi.design.schedule.task import Task
from avc_casadi.paper.exact import exact_gains

_STAGES = 40
_CONSTANTS = 4
_POINTS = {2: (64, 64), 3: (22, 22, 10)}
_SMOOTHING = 0.1
"""Width in ln(omega) over which the separate optima are averaged: they jump, and the NLP would follow each jump."""
_MISSED = 1e6
"""Cost of any violation, where constant gains are ordered."""
_TRIED = 40
"""Number of constant gains checked exactly, the cheapest first."""

StageCosts = Callable[[FloatArray], Callable[[int], FloatArray]]
"""states (d, m) -> stage -> cost of each, (m,), with a penalty where it violates a constraint."""


@dataclass(frozen=True)
class LatticePath:
    """Results of a lattice.

    Attributes:
        path: states along the cheapest path, (d, n).
        constant: states of the cheapest constant gains, then of other local minima; (d, 1 to 4).
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
    """Return the cheapest path through the lattice, exact on the lattice.

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
    """Return the axes of the lattice between two corners of the box, and all its nodes, (d, m)."""
    counts = points or _POINTS[len(low)]
    axes = [np.linspace(a, b, count if b > a else 1) for a, b, count in zip(low, high, counts, strict=True)]
    return axes, np.array([grid.ravel() for grid in np.meshgrid(*axes, indexing="ij")])


def _local_minima(value: FloatArray) -> NDArray[np.intp]:
    """Return positions of local minima along the axes in the flattened array, the best first."""
    lowest = np.ones(value.shape, dtype=bool)
    for axis in range(value.ndim):
        along, kept = np.moveaxis(value, axis, 0), np.moveaxis(lowest, axis, 0)
        kept[1:] &= along[1:] <= along[:-1]
        kept[:-1] &= along[:-1] <= along[1:]
    found = np.flatnonzero(lowest)
    return found[np.argsort(value.ravel()[found], kind="stable")][:_CONSTANTS]


def _share(log_frequency: FloatArray, position: int, span: float) -> float:
    """Return the share of a stage in the mean over ln(omega), by trapezoids."""
    if len(log_frequency) == 1:
        return 1.0
    ends = log_frequency[max(position - 1, 0)], log_frequency[min(position + 1, len(log_frequency) - 1)]
    return float((ends[1] - ends[0]) / 2 / span)


def _move(axis: FloatArray, penalty: float, reach: float) -> FloatArray:
    """Return the cost of a move between two positions on an axis, (n, n): to the row from the column."""
    distance = np.abs(axis[:, None] - axis[None, :])
    spacing = axis[1] - axis[0] if len(axis) > 1 else 0.0
    return np.where(distance <= max(reach, 1.001 * spacing), penalty * distance**2, np.inf)


def _cheapest(value: FloatArray, move: FloatArray, dimension: int) -> FloatArray:
    """Minimise over the predecessors of one state."""
    lines = np.ascontiguousarray(np.moveaxis(value, dimension, 0)).reshape(len(move), -1)
    best, tried = np.full_like(lines, np.inf), np.empty_like(lines)
    for line, steps in zip(lines, move.T, strict=True):
        # One predecessor at a time, so that the arrays stay in the processor's cache.
        np.add(line, steps[:, None], out=tried)
        np.minimum(best, tried, out=best)
    shape = np.moveaxis(value, dimension, 0).shape
    return np.moveaxis(best.reshape(shape), 0, dimension)


def _trace(value: FloatArray, values: list[FloatArray], moves: list[FloatArray], axes: list[FloatArray]) -> FloatArray:
    """Trace the cheapest end back to the first stage; states (d, stages).

    Args:
        value: at the last stage.
        values: values that were minimised, one state after another.
        moves: costs of its moves.
        axes: positions of each state.
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


def initial_guesses(task: Task, missing: Missing) -> list[FloatArray]:
    """Return states (d, n) to start from: the lattice's path, its best constant gains, the separate optima.

    Args:
        task: the problem; where its gains may not vary with frequency, all guesses are constant.
        missing: stages without constraints.
    """
    data = task.data(Slots.of(task.problem, task.frequency_hz, spread=True), task.backoff(missing.rows, missing.tight))
    lattice = lattice_path(
        task.lattice_costs(data),
        (task.states.low, task.states.high),
        task.log_frequency,
        data.slope_penalty,
        data.slope_limit,
        # On the nodes of the table, where it is exact.
        None if task.hands is None else TABLE_POINTS[len(task.states.low)],
    )
    constants = [np.repeat(state[:, None], len(task.frequency_hz), axis=1) for state in lattice.constant.T]
    return constants if task.constant else [lattice.path, constants[0], _smoothed_optima(task)]


def _smoothed_optima(task: Task) -> FloatArray:
    """Return states (d, n) of the separate optima, averaged over neighbouring frequencies where these are coupled."""
    gains = exact_gains(task.problem, task.loop)
    known = np.isfinite(gains[0])
    x = task.log_frequency
    if not known.any():
        return np.repeat((task.states.low + task.states.high)[:, None] / 2, len(x), axis=1)
    filled = [np.interp(x, x[known], gain[known]) for gain in gains]
    states = task.states.states((filled[0], filled[1], filled[2]))
    settings = task.problem.schedule
    if len(x) == 1 or (settings.slope_penalty == 0 and settings.slope_limit is None):
        return states
    # Gaussian weights, truncated to nearby rows.
    reach = np.searchsorted(x, x + 3 * _SMOOTHING) - np.searchsorted(x, x - 3 * _SMOOTHING)
    half = int(reach.max()) // 2 + 1
    total, weight = np.zeros_like(states), np.zeros(len(x))
    for shift in range(-half, half + 1):
        own = np.arange(max(0, -shift), min(len(x), len(x) - shift))
        share = np.exp(-0.5 * ((x[own + shift] - x[own]) / _SMOOTHING) ** 2)
        total[:, own] += share * states[:, own + shift]
        weight[own] += share
    return np.asarray(total / weight)


def constant_candidates(task: Task, missing: Missing, data: Data) -> FloatArray:
    """Return states (d, m) of the cheapest constant gains of a lattice, and those of stages without interior."""
    if task.hands is not None:
        nodes = admissible_states(HandsRadii(task.problem, task.states))
    else:
        nodes = lattice_nodes(task.states.low, task.states.high)[1]
    at_stage, cost = task.lattice_costs(data, _MISSED)(nodes), np.zeros(nodes.shape[1])
    for stage in np.flatnonzero(~missing.rows):
        cost += data.weight[stage] * at_stage(int(stage))
    cheapest = nodes[:, np.argsort(cost, kind="stable")[:_TRIED]]
    return np.concatenate((cheapest, missing.states[:, missing.tight]), axis=1)
