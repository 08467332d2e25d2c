"""Descent over corners and valleys: a linear programme of all that is near its largest, in a trust region.

Sequential linear programming for sums of largest values (Madsen and Schjaer-Jacobsen 1978; Fletcher 1987, 14.4).
Where as many things are at their largest as there are numbers to choose it ends as fast as Newton's method.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._util.arrays import FloatArray

if TYPE_CHECKING:
    from avc_casadi.design.robust.pieces import Piece

# Values and points.
Seen = list[tuple[float, FloatArray]]

# Trust region, in logarithms: the first, the widest, the one that ends it. It is taken wider or narrower by these,
# where more or less than these shares of what was promised came true; a point is taken from the least share on.
_REGION, _WIDEST, _NARROWEST = 0.3, 1.0, 5e-3
_WIDER, _NARROWER = 2.0, 0.4
_WELL, _BADLY, _TAKEN = 0.6, 0.25, 0.05
# It ends where the programme promises less than this share, also in no less than such a region.
_PROMISES, _SURELY_WITHIN = 3e-3, 0.1
_MOST_STEPS = 40
# So many steps that made it cheaper by less than this share together end it too, once nothing grows.
_TOGETHER, _SHARE, _GROWS = 6, 0.02, 500.0
# So many directions, and their opposites, in which points around the end are looked for.
_DIRECTIONS = 4


@dataclass(frozen=True)
class Descended:
    """Where a descent ended.

    Attributes:
        point: the best.
        cost: what it costs.
        pieces: summands of the goal there.
        seen: all points on the way, with what they cost.
    """

    point: FloatArray
    cost: float
    pieces: list[Piece]
    seen: Seen


def descend(
    pieces_at: Callable[[FloatArray], list[Piece] | None],
    start: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    region: float = _REGION,
) -> Descended | None:
    """Minimise a sum of largest values from a point on; None where the start has no value.

    Args:
        pieces_at: the summands at a point; None where there are none.
        start: where to begin.
        bounds: lower and upper.
        region: how far the first step may lead in each coordinate.
    """
    point = np.clip(start, *bounds)
    pieces = pieces_at(point)
    if pieces is None:
        return None
    cost = _sum(pieces)
    seen = [(cost, point)]
    for _ in range(_MOST_STEPS):
        step, promised = _programme(pieces, _box(point, bounds, region))
        if cost - promised <= _PROMISES * cost and region <= _SURELY_WITHIN:
            break
        there = point + step
        found = pieces_at(there)
        reached = np.inf if found is None else _sum(found)
        seen.append((reached, there))
        came_true = (cost - reached) / max(cost - promised, np.finfo(np.float64).tiny)
        if found is not None and came_true > _TAKEN:
            point, pieces, cost = there, found, reached
        if came_true > _WELL:
            region = min(_WIDEST, _WIDER * region)
        elif came_true < _BADLY:
            region *= _NARROWER
        if region < _NARROWEST or _hardly_cheaper(seen):
            break
    return Descended(point, cost, pieces, seen)


def _hardly_cheaper(seen: Seen) -> bool:
    costs = [cost for cost, _ in seen]
    before, now = min(costs[:-_TOGETHER], default=np.inf), min(costs)
    return now < _GROWS and now > (1 - _SHARE) * before


def _sum(pieces: list[Piece]) -> float:
    return sum(piece.cost for piece in pieces)


def _box(point: FloatArray, bounds: tuple[FloatArray, FloatArray], region: float) -> FloatArray:
    low, high = bounds
    return np.stack([np.maximum(low - point, -region), np.minimum(high - point, region)], axis=1)


def as_cheap(ended: Descended, bounds: tuple[FloatArray, FloatArray], times: float) -> list[FloatArray]:
    """Return points around the end of a descent that cost no more than so many times as much, by the slopes there.

    Args:
        ended: where it ended.
        bounds: lower and upper.
        times: the cost there.
    """
    box = _box(ended.point, bounds, _REGION)
    way = np.random.default_rng(0).standard_normal((_DIRECTIONS, len(box)))
    found = (_programme(ended.pieces, box, (towards, times * ended.cost))[0] for towards in (*way, *-way))
    return [ended.point + step for step in found]


def _programme(
    pieces: list[Piece], box: FloatArray, towards: tuple[FloatArray, float] | None = None
) -> tuple[FloatArray, float]:
    """Return the best step within a box by the slopes, and what it promises.

    Args:
        pieces: summands of the goal.
        box: bounds of the step, shape (knobs, 2).
        towards: a direction in which to go as far as the goal stays below a number, in place of the goal itself.
    """
    from scipy.optimize import linprog  # noqa: PLC0415

    reach = np.abs(box).max(axis=1)
    # What stays below 0 all over the box adds nothing.
    near = [(piece, piece.values + np.abs(piece.slopes) @ reach > 0) for piece in pieces]
    near = [(piece, kept) for piece, kept in near if kept.any()]
    if not near:
        return np.zeros(len(box)), 0.0
    counts = [int(kept.sum()) for _, kept in near]
    slopes = np.concatenate([piece.slopes[kept] for piece, kept in near])
    values = np.concatenate([piece.values[kept] for piece, kept in near])
    knobs, many = len(box), len(near)
    matrix = np.zeros((len(values), knobs + many))
    matrix[:, :knobs] = slopes
    matrix[np.arange(len(values)), knobs + np.repeat(np.arange(many), counts)] = -1.0
    bounds: list[tuple[float, float | None]] = [(low, high) for low, high in box.tolist()]
    bounds += [(0.0, None)] * many
    goal = np.concatenate([np.zeros(knobs), [piece.weight for piece, _ in near]])
    below = -values
    if towards is not None:
        matrix, below = np.concatenate([matrix, goal[None]]), np.append(below, towards[1])
        goal = np.concatenate([-towards[0], np.zeros(many)])
    found: Any = linprog(goal, matrix, below, bounds=bounds, method="highs-ds")
    if found.x is None:
        return np.zeros(knobs), _sum(pieces)
    return np.clip(found.x[:knobs], *box.T), float(found.fun)
