"""Scope `hands`: a table of the spectral radius as a smooth constraint, and the admissible region of the box."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np

from avc_casadi._util.arrays import FloatArray, IndexArray
from avc_casadi.claims.stability.declared_device import whole_stability
from avc_casadi.claims.stability.frozen_loop import RADIUS_TOLERANCE, frozen_parts
from avc_casadi.design.schedule.scope import deciding_corners
from avc_casadi.design.schedule.states import States
from avc_casadi.model.hands import Hand, hand_corners, hand_ranges, hand_set, joined
from avc_casadi.model.problem import Problem

TABLE_POINTS = {2: (64, 64), 3: (20, 20, 28)}
"""Nodes along each state; b_p, which the radius depends on most sharply, has more of them."""
_DEGREE = 3
_CLIP = 0.1
"""Slack at which table values are clipped as unstable: a spline would ring at the step behind it."""
LARGEST = 1 - 2 * RADIUS_TOLERANCE
"""Largest radius of a searched point: within the certificate's tolerance, so that rounding costs no row."""
_UNDEFINED = 10.0
_POINTS = {2: (40, 40), 3: (15, 15, 9)}
_FINE = {2: (240,), 3: (24, 24)}
"""Nodes of each face of the box: an optimum often lies on one, where the admissible region may be thin."""
_CLIMBS, _CLIMB_STEPS, _CLIMB_POINTS = 6, 24, {2: 5, 3: 3}
_SECANTS = 6
_ADDED, _ALIKE = 3, 0.15
"""Hands added at a time, and their least distance as a share of the ranges."""


def hands_slack(problem: Problem, states: States, at: FloatArray) -> FloatArray:
    """Return 1 - spectral radius of the frozen loop, the least over the hands' corners and the device's, (m,).

    Args:
        problem: device, environment, hands and margin.
        states: map from states to gains.
        at: states, (d, m).
    """
    b, k, contact = states.gains(at)
    hands, margin = hand_corners(problem.hands), problem.stability.margin_ns_per_m
    slack = [
        1 - whole_stability(corner.device, frozen_parts(corner, b, k), contact, hands, -margin).radius.max(axis=1)
        for corner in deciding_corners(problem)
    ]
    return np.asarray(np.clip(np.min(slack, axis=0), -_CLIP, _CLIP))


def hands_spline(problem: Problem, states: States, points: Mapping[int, tuple[int, ...]] = TABLE_POINTS) -> Any:
    """Return sigma -> slack as a CasADi function: a cubic spline through a table of exact values.

    The schedule checks its rows exactly afterwards, with more hands than the corners, and tightens where needed. A
    table is cached for problems that agree in all that it depends on, with the solvers built on it.
    """
    parts = problem.device, problem.environment, problem.hands, problem.stability.margin_ns_per_m
    key = "\n".join((*map(repr, parts), *(repr(part.tolist()) for part in (states.floors, states.low, states.high))))
    return _kept(_Table(key, points[len(states.low)], problem, states))


@dataclass(frozen=True)
class _Table:
    """Input of a table, identified by key and points."""

    key: str
    points: tuple[int, ...]
    problem: Problem = field(compare=False)
    states: States = field(compare=False)


@lru_cache(maxsize=8)
def _kept(table: _Table) -> Any:
    states = table.states
    axes = [
        np.linspace(low, high if high > low else low + 1e-3, points)
        for low, high, points in zip(states.low, states.high, table.points, strict=True)
    ]
    nodes = np.array([grid.ravel(order="F") for grid in np.meshgrid(*axes, indexing="ij")])
    values = hands_slack(table.problem, states, nodes).reshape([len(axis) for axis in axes], order="F")
    return _spline(axes, values)


def _spline(axes: list[FloatArray], values: FloatArray) -> Any:
    """Return CasADi's interpolating cubic spline; its coefficients come one axis after another, 300 times as fast."""
    from scipy.interpolate import make_interp_spline  # noqa: PLC0415 - half a second that few designs need

    knots, coefficients = [], values
    for place, axis in enumerate(axes):
        along = make_interp_spline(axis, np.moveaxis(coefficients, place, 0), k=_DEGREE)
        knots.append(along.t.tolist())
        coefficients = np.moveaxis(along.c, 0, place)
    degrees = [_DEGREE] * len(axes)
    return ca.Function.bspline("hands", knots, coefficients.ravel(order="F").tolist(), degrees, 1, {})


@dataclass(frozen=True)
class HandsRadii:
    """Spectral radii over the states of a problem with scope hands.

    Attributes:
        problem: device, environment, hands and margin.
        states: map from states to gains.
        found: interior hands unstable with earlier gains; None where there are none.
        latest: how many of them were added last.
        reserve: margin of the radii below 1, for hands between the known ones.
    """

    problem: Problem
    states: States
    found: Hand | None = None
    latest: int = 0
    reserve: float = 0.0

    held = 4
    """Number of hands that a polish considers beside the critical ones."""

    @property
    def most(self) -> float:
        """Upper bound of the radii."""
        return LARGEST - self.reserve

    @property
    def low(self) -> FloatArray:
        """Lower ends of the states, (d,)."""
        return self.states.low

    @property
    def high(self) -> FloatArray:
        """Upper ends of the states, (d,)."""
        return self.states.high

    @cached_property
    def smooth(self) -> IndexArray:
        """Positions of all radii: each is smooth on its own."""
        return np.arange(self.count)

    @cached_property
    def count(self) -> int:
        """Hands times corners of the device."""
        return len(self._hands) * len(deciding_corners(self.problem))

    @cached_property
    def corners(self) -> IndexArray:
        """Positions of the corners of the hands, which are nearly always critical."""
        own = np.arange(len(hand_corners(self.problem.hands)))
        device = np.arange(len(deciding_corners(self.problem))) * len(self._hands)
        return np.asarray((device[:, None] + own).ravel())

    @cached_property
    def _hands(self) -> Hand:
        hands = hand_set(self.problem.hands)
        return hands if self.found is None else joined(hands, self.found)

    def with_hands(self, hands: Hand, slack: FloatArray, reserve: float) -> HandsRadii:
        """Return radii with the worst of several hands added: the one of least slack (m,), then distinct ones."""
        ranges = hand_ranges(self.problem.hands)
        width = np.ptp(ranges, axis=1)[:, None]
        share = np.array([np.atleast_1d(value) for value in vars(hands).values()]) / np.where(width > 0, width, 1.0)
        left = slack.copy()
        chosen: list[int] = []
        while len(chosen) < _ADDED and np.isfinite(left).any():
            chosen.append(int(left.argmin()))
            left = np.where(np.abs(share - share[:, chosen[-1:]]).max(axis=0) < _ALIKE, np.inf, left)
        new = hands.pick(np.array(chosen))
        return replace(
            self, found=new if self.found is None else joined(self.found, new), latest=len(chosen), reserve=reserve
        )

    def kept_by_the_latest(self, points: FloatArray) -> FloatArray:
        """Return those of states (d, m) that are stable with the hands added last."""
        last = np.arange(len(self._hands) - self.latest, len(self._hands))
        device = np.arange(len(deciding_corners(self.problem))) * len(self._hands)
        some = None if self.reserve else np.asarray((device[:, None] + last).ravel())
        held = self.at(points, some).max(axis=1) <= self.most
        return np.asarray(points[:, held])

    def at(self, points: FloatArray, some: IndexArray | None = None) -> FloatArray:
        """Return radii (m, h) at states (d, m), with all hands on every device, or some of them."""
        b, k, contact = self.states.gains(points)
        margin, total = self.problem.stability.margin_ns_per_m, len(self._hands)
        wanted = np.arange(self.count) if some is None else some
        radii = np.empty((points.shape[1], len(wanted)))
        for number, corner in enumerate(deciding_corners(self.problem)):
            own = np.flatnonzero(wanted // total == number)
            if own.size:
                hands = self._hands.pick(wanted[own] % total)
                parts = frozen_parts(corner, b, k)
                radii[:, own] = whole_stability(corner.device, parts, contact, hands, -margin).radius
        return np.minimum(radii, _UNDEFINED)

    def largest(self, points: FloatArray) -> FloatArray:
        """Return the largest radius (m,); where a corner of the hands is unstable already, that of the corners."""
        radius = np.asarray(self.at(points, self.corners).max(axis=1))
        rest = np.setdiff1d(np.arange(self.count), self.corners)
        inside = np.flatnonzero(radius <= LARGEST)
        if rest.size and inside.size:
            radius[inside] = np.maximum(radius[inside], self.at(points[:, inside], rest).max(axis=1))
        return radius


def admissible_states(radii: HandsRadii) -> FloatArray:
    """Return states (d, m) stable with every hand, throughout the box and near the border of the admissible region.

    A lattice and a finer one on each face of the box; between a stable node and an unstable neighbour
    a point near the border; where no node is stable, or one nearly is, a descent to the least radius about it.
    """
    low, high = radii.states.low, radii.states.high
    inside = []
    for axes in _lattices(low, high):
        shape = tuple(len(axis) for axis in axes)
        nodes = np.array([grid.ravel() for grid in np.meshgrid(*axes, indexing="ij")])
        radius = radii.largest(nodes)
        grid = radius.reshape(shape)
        inside.append(nodes[:, radius <= LARGEST])
        inside.append(_at_border(radii, nodes, grid))
        if len(inside) == 2:  # The first lattice covers the whole box.
            inside.append(_climbed(radii, nodes, grid))
    return np.concatenate(inside, axis=1)


def _lattices(low: FloatArray, high: FloatArray) -> list[list[FloatArray]]:
    """Return the axes of a lattice over the box and of one on each face."""
    d = len(low)
    width = high > low
    axes = [np.linspace(low[i], high[i], n if width[i] else 1) for i, n in enumerate(_POINTS[d])]
    found = [axes]
    for fixed in range(d):
        others = [i for i in range(d) if i != fixed]
        for end in {low[fixed], high[fixed]}:
            face = [np.full(1, end)] * d
            for i, n in zip(others, _FINE[d], strict=True):
                face[i] = np.linspace(low[i], high[i], n if width[i] else 1)
            found.append(face)
    return found


def _neighbours(shape: tuple[int, ...]) -> tuple[IndexArray, IndexArray]:
    """Return positions in the flattened lattice of all pairs of neighbours along its axes."""
    at = np.arange(int(np.prod(shape))).reshape(shape)
    pairs = [
        (np.take(at, range(size - 1), axis).ravel(), np.take(at, range(1, size), axis).ravel())
        for axis, size in enumerate(shape)
    ]
    return np.concatenate([pair[0] for pair in pairs]), np.concatenate([pair[1] for pair in pairs])


def _at_border(radii: HandsRadii, nodes: FloatArray, radius: FloatArray) -> FloatArray:
    """Return admissible states near the border, by false position between neighbours on either side of it."""
    one, other = _neighbours(radius.shape)
    value = radius.ravel() - LARGEST
    crossed = (value[one] <= 0) != (value[other] <= 0)
    one, other = one[crossed], other[crossed]
    swap = value[one] > 0
    one, other = np.where(swap, other, one), np.where(swap, one, other)
    inner, outer = nodes[:, one], nodes[:, other]
    in_value, out_value = value[one], value[other]
    for step in range(_SECANTS if len(one) else 0):
        share = np.clip(in_value / (in_value - out_value), 0.05, 0.95) if step % 2 else np.full(len(one), 0.5)
        middle = inner + share * (outer - inner)
        found = radii.largest(middle) - LARGEST
        fits = found <= 0
        inner, outer = np.where(fits, middle, inner), np.where(fits, outer, middle)
        in_value, out_value = np.where(fits, found, in_value), np.where(fits, out_value, found)
    return inner


def _climbed(radii: HandsRadii, nodes: FloatArray, radius: FloatArray) -> FloatArray:
    """Return admissible states about nodes that are nearly stable and local minima of the radius."""
    value, d = radius.ravel(), len(nodes)
    one, other = _neighbours(radius.shape)
    lowest = np.ones(value.size, dtype=bool)
    np.logical_and.at(lowest, one, value[one] <= value[other])
    np.logical_and.at(lowest, other, value[other] <= value[one])
    found = np.flatnonzero(lowest & (value > LARGEST))
    found = found[np.argsort(value[found], kind="stable")][:_CLIMBS]
    low, high = radii.states.low[:, None, None], radii.states.high[:, None, None]
    axis = np.linspace(-1, 1, _CLIMB_POINTS[d])
    window = np.array([grid.ravel() for grid in np.meshgrid(*[axis] * d, indexing="ij")])
    at, least = nodes[:, found], value[found]
    reach = (high - low) / (np.array(_POINTS[d]) - 1)[:, None, None] * np.ones((1, 1, len(found)))
    pick = np.arange(len(found))
    for _ in range(_CLIMB_STEPS if len(found) else 0):
        if (least <= LARGEST).all():
            break
        around = np.clip(at[:, None] + reach * window[:, :, None], low, high)
        values = radii.largest(around.reshape(d, -1)).reshape(window.shape[1], -1)
        chosen = values.argmin(axis=0)
        better = values[chosen, pick] < least
        at, least = np.where(better, around[:, chosen, pick], at), np.minimum(values[chosen, pick], least)
        reach = np.where(better, reach, reach / 2)
    return np.asarray(at[:, least <= LARGEST])
