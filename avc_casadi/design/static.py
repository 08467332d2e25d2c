"""Method `static`: the best constant coupling under a condition on all frequencies."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Literal

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi._util.text import quantity
from avc_casadi._util.units import Units
from avc_casadi.claims.llewellyn import llewellyn_margin
from avc_casadi.claims.worst_frequency import worst_margin
from avc_casadi.loops.wall import SampledLoop
from avc_casadi.model.gains import Gains, GainSchedule, Status
from avc_casadi.model.problem import Model, Problem
from avc_casadi.model.problem_ranges import margin_over_range
from avc_casadi.model.runtime import StateFeedback
from avc_casadi.paper.equations import loop_at
from avc_casadi.paper.realism import relative_errors
from avc_casadi.paper.rows import GainArrays, SolveRecord, gain_schedule, row_status

StaticCondition = Literal["llewellyn", "all"]
# Points are shares of the logarithmic range of each gain, 0 at its lower bound and 1 at its upper; so are steps.
_SMALLEST_STEP = 1e-10
# Costs that differ by less than this share are equal; a gain at its bound is then preferred.
_FLAT = 1e-9
# A share this near to 0 or 1 is the bound.
_AT_BOUND = 1e-9
# (6) allows b up to 8 and kT up to 9.4 times the damping of the device: upper ends of the search, with room to spare.
_LARGEST_DAMPING = 9
_LARGEST_STIFFNESS = 10
# The logarithmic scale of a gain begins at this share of its largest value.
_SCALE_SHARE = 1e-6
# Slack of the condition, as a share of the device's damping, at which the largest stiffness counts as reached.
_CLOSE_SLACK = 1e-13
_FALSE_POSITIONS = 24
# Every so many steps of false position one halves the bracket, whatever the shape of the margin.
_HALVE_EVERY = 4
# Nodes of the first grid along each gain, by the number of gains, and of the small grids that move about.
_COARSE_NODES = {2: 49, 3: 21}
_FINE_NODES = {2: 9, 3: 5}
# Step at which the best of the starts is chosen, to be refined alone, from a multiple of that step.
_RANKING_STEP = 2e-3
_RESTART_RATIO = 10
# Starts, and least distance between them in steps of the first grid.
_STARTS = 3
_APART = 1.5
# Moves of a small grid, and what its step shrinks by.
_MOVES = 200
_SHRINK = 0.4


class StaticSearch:
    """Search over (b, k[, b_p]), logarithmic shares of their ranges, by ever finer grids; points have shape (m, d)."""

    def __init__(self, problem: Problem, condition: StaticCondition, loop: SampledLoop) -> None:
        """Set up the ranges of the gains (b, k[, b_p]) of the box, and the loop in which the condition is judged.

        Under Llewellyn's condition b and k are bounded further, by 9 and 10/T times the damping of device and contact
        damper: more is never allowed.
        """
        self.problem = problem
        self.condition = condition
        self.loop = loop
        box = problem.coupling
        ends = [box.damping_ns_per_m, box.stiffness_n_per_m]
        if box.structure == "damped":
            ends.append(box.contact_damping_ns_per_m)
        # While searching, margins are left unrefined; the result is judged exactly.
        self.exact = False
        self.low, self.high = np.array(ends, dtype=np.float64).T
        if condition == "llewellyn":
            most = problem.device.damping_ns_per_m + box.contact_damping_ns_per_m[1]
            allowed = [_LARGEST_DAMPING * most, _LARGEST_STIFFNESS * most / loop.sample_time_s]
            self.high[:2] = np.clip(allowed, self.low[:2], self.high[:2])
        self.design = loop_at(problem, problem.frequencies_hz())

    def gains(self, points: FloatArray) -> FloatArray:
        """Return b, k and b_p of points x, shape (3, m): (low + c) ((high + c)/(low + c))^x - c, c = 1e-6 high.

        low and high are the ends of the range of each gain, N.s/m or N/m; x = 0 is the one, x = 1 the other.
        """
        scale = self.high * _SCALE_SHARE
        ratio = (self.high + scale) / np.where(self.high > 0, self.low + scale, 1.0)
        values = (self.low + scale) * np.where(self.high > 0, ratio, 1.0) ** points - scale
        values = np.where(points <= 0, self.low, np.where(points >= 1, self.high, values))
        values = np.clip(values, self.low, self.high)
        if values.shape[1] == 2:
            values = np.column_stack([values, np.zeros(len(values))])
        return np.asarray(values.T)

    def slack(self, points: FloatArray) -> FloatArray:
        """Return the least margin of the condition over frequency beyond the required one, N.s/m, shape (m,).

        The condition is Llewellyn's, for any passive environment, or Re Z_h >= 0 with the problem's own; the margin is
        device damping to spare.
        """
        b, k, contact = self.gains(points)
        if self.condition == "llewellyn":
            margin = llewellyn_margin(self.loop, b, k, contact)[0]
        else:
            margin = worst_margin(self.loop, b, k, contact, refine=self.exact).margin_ns_per_m
        return np.asarray(margin - margin_over_range(self.problem))

    def allowed(self, points: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return the points, with the stiffness reduced until the condition is met, and whether it is met, (m,)."""
        points = points.copy()
        met = self.slack(points) >= 0
        # Gains other than the stiffness, each combination once.
        dampers, group = np.unique(np.delete(points[~met], 1, axis=1), axis=0, return_inverse=True)
        if len(dampers) == 0:
            return points, met
        inside, reachable = self._edge(dampers)
        group = group.ravel()
        # The edge of another interval may lie above the point: stiffness is only ever reduced.
        reduced = inside[group, 1] <= points[~met, 1]
        points[~met] = np.where(reduced[:, None], inside[group], points[~met])
        met[~met] = reachable[group] & reduced
        return points, met

    def _edge(self, dampers: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return points with the largest admissible stiffness at each of the dampers, and whether there is one.

        `dampers` are b[, b_p], shape (m, d - 1). False position (Illinois) on the slack of the condition: that of an
        end that stays for a second step counts half. Every fourth step halves the bracket.
        """
        inside = np.insert(dampers, 1, 0.0, axis=1)
        outside = np.insert(dampers, 1, 1.0, axis=1)
        slack_in = self.slack(inside)
        slack_out = self.slack(outside)
        reachable = slack_in >= 0
        spare = slack_in
        last = np.zeros(len(inside), dtype=int)
        close = _CLOSE_SLACK * self.problem.device.damping_ns_per_m
        for step in range(_FALSE_POSITIONS):
            # Converged, or narrower than any later step.
            open_rows = reachable & (spare > close) & (outside[:, 1] - inside[:, 1] > _SMALLEST_STEP)
            if not open_rows.any():
                break
            fall = np.where(reachable & np.isfinite(slack_out), slack_in - slack_out, np.inf)
            share = np.where(np.isfinite(fall) & (fall > 0), slack_in / np.where(fall > 0, fall, 1.0), 0.5)
            if step % _HALVE_EVERY == 0:
                share = np.full(len(share), 0.5)
            middle = inside + share[:, None] * (outside - inside)
            slack = self.slack(middle)
            fits = slack >= 0
            spare = np.where(fits, slack, spare)
            side = np.where(fits, 1, -1)
            stale = np.where(side == last, 0.5, 1.0)
            slack_in = np.where(fits, slack, slack_in * stale)
            slack_out = np.where(fits, slack_out * stale, slack)
            inside = np.where(fits[:, None], middle, inside)
            outside = np.where(fits[:, None], outside, middle)
            last = side
        return inside, reachable

    def cost(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the mean squared relative error of the impedance, (m,), and the points as they are judged.

        Their stiffness is reduced until the condition is met. The error is infinite where no stiffness meets it.
        """
        points, met = self.allowed(points)
        cost = np.full(len(points), np.inf)
        if met.any():
            cost[met] = self.errors(points[met])
        return cost, points

    def errors(self, points: FloatArray) -> FloatArray:
        """Return the mean over the frequencies of the squared relative error of the perceived impedance, (m,)."""
        b, k, contact = (gain[:, None] for gain in self.gains(points))
        realism = self.problem.realism
        perceived = self.design.perceived(b, k, contact)
        errors = relative_errors(perceived, self.design.target[None], realism.objective, realism.jnd)
        return np.asarray(np.mean(errors**2, axis=1))

    def run(self) -> tuple[FloatArray, float]:
        """Return the point of least error and its error: the cheapest of a grid, refined by ever finer grids about it.

        If no point meets the condition, the error is infinite and the point is that of least violation.
        """
        size = len(self.low)
        grid = _grid(np.linspace(0, 1, _COARSE_NODES[size]), size)
        step = 1.0 / (_COARSE_NODES[size] - 1)
        cost, points = self.cost(grid)
        if not np.isfinite(cost).any():
            start = grid[np.argmax(self.slack(grid))]
            nearest, _ = _descend(start, lambda tried: (-self.slack(tried), tried), step)
            cost, points = self.cost(nearest[None])
            if not np.isfinite(cost).any():
                return nearest, np.inf
        cheapest = points[np.argsort(cost, kind="stable")][: np.count_nonzero(np.isfinite(cost))]
        starts = _apart(cheapest, _APART * step)
        ends = [_descend(start, self.cost, step, _RANKING_STEP) for start in starts]
        best_end, _ = min(ends, key=lambda end: end[1])
        best, _ = _descend(best_end, self.cost, _RESTART_RATIO * _RANKING_STEP)
        best = np.where(best < _AT_BOUND, 0.0, np.where(best > 1 - _AT_BOUND, 1.0, best))
        return self._at_bounds_if_as_good(best)

    def _at_bounds_if_as_good(self, best: FloatArray) -> tuple[FloatArray, float]:
        """Return a point and its exact error, or one with a damper at an end of its range whose error is no larger."""
        # A flat error may stop the search short of a bound.
        size = len(best)
        rounded = np.repeat(best[None], 2 * size - 1, axis=0)
        for row, (gain, end) in enumerate(product([0, *range(2, size)], (0.0, 1.0)), start=1):
            rounded[row, gain] = end
            rounded[row, 1] = 1.0
        self.exact = True
        costs, points = self.cost(rounded)
        as_good = np.flatnonzero(costs <= costs.min() * (1 + _FLAT))
        lowest = int(as_good[as_good > 0][0] if (as_good > 0).any() else 0)
        return points[lowest], float(costs[lowest])


def _grid(axis: FloatArray, size: int) -> FloatArray:
    """Return all points with coordinates of one axis, shape (len(axis)^size, size)."""
    return np.stack(np.meshgrid(*[axis] * size, indexing="ij"), axis=-1).reshape(-1, size)


def _apart(points: FloatArray, distance: float, count: int = _STARTS) -> FloatArray:
    """Return the first of the points, (m, d), and the next ones that are apart from those before, `count` at most.

    Points are apart where a coordinate differs by more than `distance`.
    """
    taken = points[:1]
    for point in points:
        if len(taken) == count:
            break
        if np.abs(taken - point).max(axis=1).min() > distance:
            taken = np.concatenate((taken, point[None]))
    return taken


def _descend(
    start: FloatArray,
    value: Callable[[FloatArray], tuple[FloatArray, FloatArray]],
    step: float,
    smallest: float = _SMALLEST_STEP,
) -> tuple[FloatArray, float]:
    """Return the lowest point that grids about a start lead to, and its value.

    Args:
        start: a point, shape (d,), of shares from 0 to 1.
        value: from points (m, d) to their values (m,), and to the points that were judged in their place.
        step: half the width of the first grid.
        smallest: width at which it ends.

    The grid moves to its best point, and shrinks to 0.4 where that is not at its rim.
    """
    offsets = _grid(np.linspace(-1, 1, _FINE_NODES[len(start)]), len(start))
    best = float(value(start[None])[0][0])
    for _ in range(_MOVES):
        if step < smallest:
            break
        values, points = value(np.clip(start + step * offsets, 0.0, 1.0))
        lowest = int(np.argmin(values))
        gained = best - values[lowest]
        if gained > 0:
            best = float(values[lowest])
            start = points[lowest]
        # At the rim the same step is repeated, unless the gain is negligible.
        if not gained > _FLAT * abs(best) or np.max(np.abs(offsets[lowest])) < 1:
            step *= _SHRINK
    return start, best


@dataclass(frozen=True)
class StaticCoupling:
    """A constant coupling.

    Attributes:
        condition: the condition on all frequencies that it meets, or comes nearest to.
        model: the model of the loop in which that is judged.
        damping_ns_per_m: damping b, N.s/m.
        stiffness_n_per_m: stiffness k, N/m.
        contact_damping_ns_per_m: contact damping b_p, N.s/m; 0 in the series structure.
        margin_ns_per_m: device damping to spare in the condition.
        error: root mean square of the relative error over the problem's frequencies; infinite if not feasible.
        feasible: whether the coupling meets the condition with the problem's margin.
    """

    condition: StaticCondition
    model: Model
    damping_ns_per_m: float
    stiffness_n_per_m: float
    contact_damping_ns_per_m: float
    margin_ns_per_m: float
    error: float
    feasible: bool

    def gains(self, units: Units) -> str:
        """Return damper and springs with their units."""
        damping = partial(quantity, unit=units.unit("N.s/m"), digits=4)
        stiffness = partial(quantity, unit=units.unit("N/m"), digits=4)
        contact = f", b_p {damping(self.contact_damping_ns_per_m)}" if self.contact_damping_ns_per_m else ""
        return f"b {damping(self.damping_ns_per_m)}, k {stiffness(self.stiffness_n_per_m)}{contact}"

    def sentence(self, units: Units) -> str:
        """Return a printed line."""
        names = {"llewellyn": "Llewellyn (6), any passive environment", "all": "passive with this environment alone"}
        name = f"{names[self.condition]}, {self.model} model"
        if not self.feasible:
            return f"{name}: no constant coupling of the gain box"
        return f"{name}: {self.gains(units)}, error {100 * self.error:.4g} %"


def static_coupling(problem: Problem, condition: StaticCondition = "llewellyn") -> StaticCoupling:
    """Return the constant coupling (b, k, b_p) of least mean squared error of the impedance that a condition allows.

    Raises:
        UnsupportedError: the device has no damping, so that no coupling is allowed.
    """
    if problem.device.damping_ns_per_m == 0:
        raise UnsupportedError(
            "device.damping_ns_per_m is 0; method static needs a value above 0: otherwise neither Llewellyn's "
            "condition (6) nor passivity at all frequencies allows a coupling; use closed-form, exact or direct",
            key="device.damping_ns_per_m",
        )
    search = StaticSearch(problem, condition, SampledLoop.of(problem))
    best, cost = search.run()
    b, k, contact = (float(value) for value in search.gains(best[None])[:, 0])
    margin = float(search.slack(best[None])[0]) + problem.stability.margin_ns_per_m
    return StaticCoupling(
        condition=condition,
        model=search.loop.model,
        damping_ns_per_m=b,
        stiffness_n_per_m=k,
        contact_damping_ns_per_m=contact,
        margin_ns_per_m=margin,
        error=float(np.sqrt(cost)),
        feasible=bool(np.isfinite(cost)),
    )


def solve_static(problem: Problem) -> GainSchedule:
    """Solve by a constant coupling under Llewellyn's condition; notes tell the best that is passive here alone."""
    started = time.perf_counter()
    units = problem.units
    certified = static_coupling(problem)
    special = static_coupling(problem, "all")
    gains = Gains(certified.damping_ns_per_m, certified.stiffness_n_per_m, certified.contact_damping_ns_per_m)
    lacking = problem.stability.margin_ns_per_m - certified.margin_ns_per_m
    why = (
        f"no constant coupling of the gain box meets Llewellyn's condition (6), {certified.model} model: the best, "
        f"{certified.gains(units)}, lacks {quantity(lacking, units.unit('N.s/m'))} of device damping"
    )
    n = len(problem.frequencies_hz())
    design = ConstantDesign(
        "static",
        gains if certified.feasible else None,
        reason="" if certified.feasible else why,
        notes=tuple(f"best constant coupling, {choice.sentence(units)}" for choice in (certified, special)),
    )
    return constant_schedule(problem, design, started, row_status(problem, *_repeated(gains, n)))


@dataclass(frozen=True)
class ConstantDesign:
    """Constant gains that a method found, or why it found none.

    Attributes:
        method: name of the method.
        gains: the gains; None where there are none.
        reason: why there are none; empty where there are.
        notes: facts on them, a sentence each.
        law: the law that runs behind them.
    """

    method: str
    gains: Gains | None
    reason: str = ""
    notes: tuple[str, ...] = ()
    law: StateFeedback | None = None


def constant_schedule(
    problem: Problem, design: ConstantDesign, started: float, status: tuple[Status, ...] | None = None
) -> GainSchedule:
    """Return the same gains at every frequency, infeasible for a reason where there are none."""
    n = len(problem.frequencies_hz())
    if design.gains is None:
        status = (Status.INFEASIBLE,) * n
    seconds = time.perf_counter() - started
    return gain_schedule(
        problem,
        design.method,
        _repeated(design.gains or Gains(0.0, 0.0), n),
        status or (Status.SOLVED,) * n,
        SolveRecord(reason=(design.reason,) * n, solve_seconds=seconds, notes=design.notes),
        state_feedback=design.law,
    )


def _repeated(gains: Gains, rows: int) -> GainArrays:
    """Return constant gains as arrays (b, k, b_p) of so many rows."""
    return (
        np.full(rows, gains.damping_ns_per_m),
        np.full(rows, gains.stiffness_n_per_m),
        np.full(rows, gains.contact_damping_ns_per_m),
    )
