"""Local improvement of admissible gains by windows in which the constraints are nearly quadratic."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Protocol

import numpy as np

from avc_casadi._util.arrays import FloatArray, IndexArray

Evaluate = Callable[[FloatArray], FloatArray]
"""Points (d, m, s) of m windows, each from -1 to 1 -> values (m, s)."""


class Bounds(Protocol):
    """Constraints on admissible points: columns of values, each at most ``most``, within a box."""

    @property
    def low(self) -> FloatArray:
        """Lower ends of the box, (d,)."""

    @property
    def high(self) -> FloatArray:
        """Upper ends, (d,)."""

    @property
    def most(self) -> float:
        """Upper bound of the columns."""

    @property
    def smooth(self) -> IndexArray:
        """Columns that a quadratic fits in a small window; the others are rarely active."""

    @property
    def held(self) -> int:
        """Number of these that a window considers beside the critical ones."""

    def at(self, points: FloatArray, some: IndexArray | None = None) -> FloatArray:
        """Return columns (m, h) at points (d, m): all of them, which is exact, or some of the smooth ones."""


class Goal(Protocol):
    """Objective, to be minimised."""

    def value(self, points: FloatArray, stage: IndexArray) -> FloatArray:
        """Return the value (m, s) at points (d, m, s), with the stage of each of the m."""

    def window(self, centre: FloatArray, half: FloatArray, stage: IndexArray) -> tuple[Evaluate, Evaluate]:
        """Return the value within windows of half widths (d, m), and an error whose zeros minimise the value."""


_SMALLEST = 1e-5
"""Width of a window, as a share of the first one's, at which a search ends."""
_GAINED, _IDLE = 1e-8, 4
"""Improvement and number of windows: after so many that improve less a search ends too."""
_STEPS = 30
_TRIALS = 2
"""Points tried in a window; the second keeps the violation of the first as a reserve."""
_RIM = 0.7
"""A window whose best point lies beyond this share of it grows again."""
_LINES = {2: 15, 3: 5}
_ZOOMS, _ZOOM = 4, 0.3
_ALONG = 0.5
_STEP = 1e-4
_FARTHEST = 2.0
_GUARD = 1e-11
_OUTSIDE = 1e3


def polished(bounds: Bounds, start: FloatArray, stage: IndexArray, goal: Goal, reach: FloatArray) -> FloatArray:
    """Improve admissible points, each separately.

    In a window about each point the potentially critical columns are fitted by quadratics through exact values; the
    goal is minimised where these stay below their bound. The point found is judged exactly: it is taken if admissible
    and better; its violation is kept as a reserve for a second one.

    Args:
        bounds: constraints.
        start: points, (d, m), admissible.
        stage: of each start, passed to the goal, (m,).
        goal: objective.
        reach: half the width of the first windows along each axis, (d,).

    Returns:
        Points (d, m), admissible and no worse than the start.
    """
    d, m = start.shape
    low, high = bounds.low[:, None], bounds.high[:, None]
    best, least = start.copy(), goal.value(start[:, :, None], stage)[:, 0]
    own = bounds.at(start)
    share, idle = np.ones(m), np.zeros(m)
    stencil = _stencil(d)
    inverse = np.linalg.pinv(_quadratics(stencil[:, None])[0])
    for _ in range(_STEPS):
        rows = np.flatnonzero((share > _SMALLEST) & (idle < _IDLE))
        if not rows.size:
            break
        held = bounds.smooth[_deciding(own[rows][:, bounds.smooth], bounds.held)]
        half = np.minimum(share[rows] * reach[:, None], (high - low) / 2)
        centre = np.clip(best[:, rows], low + half, high - half)
        around = centre[:, :, None] + half[:, :, None] * stencil[:, None]
        fitted = bounds.at(around.reshape(d, -1), held).reshape(len(rows), -1, len(held))
        model = np.einsum("qs,msh->mqh", inverse, fitted)
        here = np.where(half > 0, (best[:, rows] - centre) / np.where(half > 0, half, 1.0), 0.0)
        moved, gained, miss = np.zeros(len(rows)), np.zeros(len(rows)), np.zeros(len(rows))
        left = np.arange(len(rows))
        for _ in range(_TRIALS):
            window = centre[:, left], half[:, left]
            inside = goal.window(*window, stage[rows[left]])
            most = bounds.most - miss[left][:, None]
            at, expected = _least_in_window(model[left], most, here[:, left], inside)
            point = np.clip(window[0] + window[1] * at, low, high)
            value = goal.value(point[:, :, None], stage[rows[left]])[:, 0]
            exact = bounds.at(point, held).max(axis=1)
            better = np.flatnonzero((exact <= bounds.most) & (value < least[rows[left]]))
            judged = bounds.at(point[:, better])
            fits = judged.max(axis=1) <= bounds.most
            taken, which = left[better[fits]], better[fits]
            exact[better] = judged.max(axis=1)
            own[rows[left[better]]] = np.where(fits[:, None], judged, np.maximum(own[rows[left[better]]], judged))
            gained[taken] = least[rows[taken]] - value[which]
            best[:, rows[taken]], least[rows[taken]] = point[:, which], value[which]
            moved[taken] = np.abs(at[:, which]).max(axis=0)
            miss[left] = np.maximum(exact - expected, 0.0)
            left = left[exact > bounds.most]
            if not left.size:
                break
        idle[rows] = np.where(gained > _GAINED, 0, idle[rows] + 1)
        share[rows] *= np.where(moved > _RIM, 2.0, np.where(moved > 0, 0.5, 0.35))
        share = np.minimum(share, 1.0)
    return best


def _deciding(own: FloatArray, held: int) -> IndexArray:
    """Return the columns that are largest at some point, and the next ones by their distance to that."""
    order = np.argsort(-(own - own.max(axis=1, keepdims=True)).max(axis=0), kind="stable")
    top = np.unique(np.argsort(-own, axis=1)[:, :2])
    return np.union1d(top, order[:held])


def _stencil(d: int) -> FloatArray:
    """Return the points of a window through which a quadratic is fitted, (d, s)."""
    axes = [sign * row for row in np.eye(d) for sign in (-1.0, 1.0)]
    corners = [np.array(corner) for corner in itertools.product((-0.8, 0.8), repeat=d)]
    return np.array([np.zeros(d), *axes, *corners]).T


def _quadratics(at: FloatArray) -> FloatArray:
    """Return constant, linear and quadratic terms of points (d, m, s), shape (m, s, q)."""
    products = [at[i] * at[j] for i in range(len(at)) for j in range(i + 1)]
    return np.stack([np.ones_like(at[0]), *at, *products], axis=-1)


def _least_in_window(
    model: FloatArray, most: FloatArray, here: FloatArray, inside: tuple[Evaluate, Evaluate]
) -> tuple[FloatArray, FloatArray]:
    """Return the point (d, m) in [-1, 1] of least goal where no column's model exceeds its bound, and the largest.

    Points are tried on lines along the gradient of the error, also where the model of each column meets its bound and
    where the error vanishes: the best ones often lie in a wedge that a grid misses. The lines contract about the best
    point.
    """
    d, m = here.shape
    goal, error = inside
    axis = np.linspace(-1, 1, _LINES[d])
    offsets = np.array([each.ravel() for each in np.meshgrid(*[axis] * (d - 1), indexing="ij")]).reshape(d - 1, -1)

    def valued(at: FloatArray) -> tuple[FloatArray, FloatArray]:
        expected = (_quadratics(at) @ model).max(axis=2)
        excess = np.maximum(0.0, expected - most)
        return np.where(excess > 0, _OUTSIDE + _OUTSIDE * excess, 0.0) + goal(at), expected

    at, spread, pick = here, 1.0, np.arange(m)
    radius = valued(at[:, :, None])[1][:, 0]
    for _ in range(_ZOOMS):
        along, across = _slope(error, at)
        base = at[:, :, None] + spread * np.einsum("dtm,tl->dml", across, offsets)
        line = _ALONG * spread
        ends = [base + s * along[:, :, None] for s in (-line, 0.0, line)]
        held = [_quadratics(at) @ model - (most[:, :, None] - _GUARD) for at in ends]
        roots = np.concatenate((_roots(held, line), _roots([error(at)[:, :, None] for at in ends], line)), axis=2)
        steps = np.concatenate((roots, _steps(spread, base.shape[1:])), axis=2)
        around = base[:, :, :, None] + along[:, :, None, None] * steps
        around = np.concatenate((np.clip(around, -1, 1).reshape(d, m, -1), at[:, :, None]), axis=2)
        value, expected = valued(around)
        chosen = value.argmin(axis=1)
        at, radius = around[:, pick, chosen], expected[pick, chosen]
        spread *= _ZOOM
    return at, radius


def _steps(spread: float, shape: tuple[int, ...]) -> FloatArray:
    """Return steps along lines regardless of the bounds, (m, l, s)."""
    return np.broadcast_to(spread * np.array([-1, -0.5, -0.2, -0.05, 0, 0.05, 0.2, 0.5, 1]), (*shape, 9))


def _roots(ends: list[FloatArray], line: float) -> FloatArray:
    """Return the zeros of quadratics with values (m, l, h) at -line, 0 and line, (m, l, 2 h); 0 where none."""
    bend, slope = (ends[0] + ends[2] - 2 * ends[1]) / 2 / line**2, (ends[2] - ends[0]) / 2 / line
    with np.errstate(divide="ignore", invalid="ignore"):
        half = -0.5 * (slope + np.copysign(np.sqrt(slope**2 - 4 * bend * ends[1]), slope))
        roots = np.concatenate((half / bend, ends[1] / half), axis=2)
    return np.where(np.abs(roots) <= _FARTHEST, roots, 0.0)


def _slope(error: Evaluate, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the descent direction of the error within the window, (d, m), and its normals, (d, d - 1, m)."""
    d, m = at.shape
    ends = np.stack([at + sign * _STEP * unit[:, None] for unit in np.eye(d) for sign in (-1.0, 1.0)], axis=2)
    value = error(ends).reshape(m, d, 2)
    fall = (value[:, :, 0] - value[:, :, 1]).T
    # Descent of the absolute error, without leaving the window.
    fall = np.where(error(at[:, :, None])[:, 0] < 0, -fall, fall)
    fall = np.where(((at >= 1) & (fall > 0)) | ((at <= -1) & (fall < 0)), 0.0, fall)
    size = np.sqrt((fall**2).sum(axis=0))
    fall = np.where(size > 0, fall / np.where(size > 0, size, 1.0), np.eye(d)[:, :1])
    # The reflection of the first axis onto the direction maps the others onto its normals.
    mirror = fall + np.copysign(1.0, fall[0]) * np.eye(d)[:, :1]
    square = (mirror**2).sum(axis=0)
    normals = np.eye(d)[:, 1:, None] - 2 * mirror[:, None] * mirror[1:] / square
    return fall, normals
