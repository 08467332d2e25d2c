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
from avc_casadi.paper.rows import gain_schedule, row_status

StaticCondition = Literal["llewellyn", "all"]
_SMALLEST_STEP = 1e-10
# Costs that differ by less are equal; a gain at its bound is then preferred.
_FLAT = 1e-9


class StaticSearch:
    """Search over (b, k[, b_p]), logarithmic shares of their ranges, by ever finer grids; points have shape (m, d)."""

    def __init__(self, problem: Problem, condition: StaticCondition, loop: SampledLoop) -> None:
        self.problem, self.condition, self.loop = problem, condition, loop
        box = problem.coupling
        ends = [box.damping_ns_per_m, box.stiffness_n_per_m]
        if box.structure == "damped":
            ends.append(box.contact_damping_ns_per_m)
        # While searching, margins are left unrefined; the result is judged exactly.
        self.exact = False
        self.low, self.high = np.array(ends, dtype=np.float64).T
        if condition == "llewellyn":
            # (6) allows b up to 8 and kT up to 9.4 times the damping of the device.
            most = problem.device.damping_ns_per_m + box.contact_damping_ns_per_m[1]
            self.high[:2] = np.clip([9 * most, 10 * most / loop.sample_time_s], self.low[:2], self.high[:2])
        self.design = loop_at(problem, problem.frequencies_hz())

    def gains(self, points: FloatArray) -> FloatArray:
        """Return b, k and b_p of points, shape (3, m)."""
        # A logarithmic scale down to a millionth of the largest value, and the lower bound itself.
        scale = self.high * 1e-6
        ratio = (self.high + scale) / np.where(self.high > 0, self.low + scale, 1.0)
        values = (self.low + scale) * np.where(self.high > 0, ratio, 1.0) ** points - scale
        values = np.where(points <= 0, self.low, np.where(points >= 1, self.high, values))
        values = np.clip(values, self.low, self.high)
        if values.shape[1] == 2:
            values = np.column_stack([values, np.zeros(len(values))])
        return np.asarray(values.T)

    def slack(self, points: FloatArray) -> FloatArray:
        """Return the slack of the condition beyond the margin, N.s/m, shape (m,)."""
        b, k, contact = self.gains(points)
        if self.condition == "llewellyn":
            margin = llewellyn_margin(self.loop, b, k, contact)[0]
        else:
            margin = worst_margin(self.loop, b, k, contact, refine=self.exact).margin_ns_per_m
        return np.asarray(margin - margin_over_range(self.problem))

    def allowed(self, points: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Reduce stiffnesses until the condition is met; return the points and whether it is."""
        points = points.copy()
        met = self.slack(points) >= 0
        others, group = np.unique(np.delete(points[~met], 1, axis=1), axis=0, return_inverse=True)
        if len(others) == 0:
            return points, met
        inside, reachable = self._edge(others)
        group = group.ravel()
        # The edge of another interval may lie above the point: stiffness is only ever reduced.
        back = inside[group, 1] <= points[~met, 1]
        points[~met] = np.where(back[:, None], inside[group], points[~met])
        met[~met] = reachable[group] & back
        return points, met

    def _edge(self, others: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return the largest admissible stiffness at each of the other gains, by false position (Illinois)."""
        inside, outside = (np.insert(others, 1, end, axis=1) for end in (0.0, 1.0))
        slack_in, slack_out = self.slack(inside), self.slack(outside)
        reachable, spare = slack_in >= 0, slack_in
        last = np.zeros(len(inside), dtype=int)
        close = 1e-13 * self.problem.device.damping_ns_per_m
        for step in range(24):
            # Converged, or narrower than any later step.
            open_rows = reachable & (spare > close) & (outside[:, 1] - inside[:, 1] > _SMALLEST_STEP)
            if not open_rows.any():
                break
            fall = np.where(reachable & np.isfinite(slack_out), slack_in - slack_out, np.inf)
            share = np.where(np.isfinite(fall) & (fall > 0), slack_in / np.where(fall > 0, fall, 1.0), 0.5)
            # Every fourth step halves the bracket, whatever the shape of the margin.
            share = np.full(len(share), 0.5) if step % 4 == 0 else share
            middle = inside + share[:, None] * (outside - inside)
            slack = self.slack(middle)
            fits = slack >= 0
            spare = np.where(fits, slack, spare)
            side = np.where(fits, 1, -1)
            stale = np.where(side == last, 0.5, 1.0)
            slack_in, slack_out = np.where(fits, slack, slack_in * stale), np.where(fits, slack_out * stale, slack)
            inside, outside = np.where(fits[:, None], middle, inside), np.where(fits[:, None], outside, middle)
            last = side
        return inside, reachable

    def cost(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the mean squared relative error (m,), infinite where the condition is violated, and the points."""
        points, met = self.allowed(points)
        cost = np.full(len(points), np.inf)
        if met.any():
            cost[met] = self.errors(points[met])
        return cost, points

    def errors(self, points: FloatArray) -> FloatArray:
        """Return the mean squared relative error, (m,)."""
        b, k, contact = (gain[:, None] for gain in self.gains(points))
        realism = self.problem.realism
        perceived = self.design.perceived(b, k, contact)
        errors = relative_errors(perceived, self.design.target[None], realism.objective, realism.jnd)
        return np.asarray(np.mean(errors**2, axis=1))

    def run(self) -> tuple[FloatArray, float]:
        """Return the best point and its cost; if the cost is infinite, the point of least violation."""
        size = len(self.low)
        coarse, near_step = {2: 49, 3: 21}[size], 2e-3
        grid, step = _grid(np.linspace(0, 1, coarse), size), 1.0 / (coarse - 1)
        cost, points = self.cost(grid)
        if not np.isfinite(cost).any():
            start = grid[np.argmax(self.slack(grid))]
            nearest, _ = _descend(start, lambda some: (-self.slack(some), some), step)
            cost, points = self.cost(nearest[None])
            if not np.isfinite(cost).any():
                return nearest, np.inf
        starts = _apart(points[np.argsort(cost, kind="stable")][: np.count_nonzero(np.isfinite(cost))], 1.5 * step)
        near, _ = min((_descend(start, self.cost, step, near_step) for start in starts), key=lambda end: end[1])
        best, _ = _descend(near, self.cost, 10 * near_step)
        best = np.where(best < 1e-9, 0.0, np.where(best > 1 - 1e-9, 1.0, best))
        # A flat error may stop the search short of a bound.
        rounded = np.repeat(best[None], 2 * size - 1, axis=0)
        for row, (gain, end) in enumerate(product([0, *range(2, size)], (0.0, 1.0)), start=1):
            rounded[row, gain] = end
            rounded[row, 1] = 1.0
        self.exact = True
        costs, judged = self.cost(rounded)
        as_good = np.flatnonzero(costs <= costs.min() * (1 + _FLAT))
        lowest = int(as_good[as_good > 0][0] if (as_good > 0).any() else 0)
        return judged[lowest], float(costs[lowest])


def _grid(axis: FloatArray, size: int) -> FloatArray:
    return np.stack(np.meshgrid(*[axis] * size, indexing="ij"), axis=-1).reshape(-1, size)


def _apart(points: FloatArray, distance: float, count: int = 3) -> FloatArray:
    """Return the first of the points, (m, d), and the next ones distinct from those before."""
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
    """Move to the best point of a small grid about the present one; shrink the grid when the best is not at its rim."""
    offsets = _grid(np.linspace(-1, 1, {2: 9, 3: 5}[len(start)]), len(start))
    best = float(value(start[None])[0][0])
    for _ in range(200):
        if step < smallest:
            break
        values, points = value(np.clip(start + step * offsets, 0.0, 1.0))
        lowest = int(np.argmin(values))
        gained = best - values[lowest]
        if gained > 0:
            best, start = float(values[lowest]), points[lowest]
        # At the rim the same step is repeated, unless the gain is negligible.
        if not gained > _FLAT * abs(best) or np.max(np.abs(offsets[lowest])) < 1:
            step *= 0.4
    return start, best


@dataclass(frozen=True)
class StaticCoupling:
    """A constant coupling."""

    condition: StaticCondition
    model: Model
    damping_ns_per_m: float
    stiffness_n_per_m: float
    contact_damping_ns_per_m: float
    margin_ns_per_m: float
    error: float
    found: bool

    def gains(self, units: Units) -> str:
        """Return damper and springs with their units."""
        damping, stiffness = (partial(quantity, unit=units.unit(one), digits=4) for one in ("N.s/m", "N/m"))
        contact = f", b_p {damping(self.contact_damping_ns_per_m)}" if self.contact_damping_ns_per_m else ""
        return f"b {damping(self.damping_ns_per_m)}, k {stiffness(self.stiffness_n_per_m)}{contact}"

    def sentence(self, units: Units) -> str:
        """Return a printed line."""
        names = {"llewellyn": "Llewellyn (6), any passive environment", "all": "passive with this environment alone"}
        name = f"{names[self.condition]}, {self.model} model"
        if not self.found:
            return f"{name}: no constant coupling of the gain box"
        return f"{name}: {self.gains(units)}, error {100 * self.error:.4g} %"


def static_coupling(problem: Problem, condition: StaticCondition = "llewellyn") -> StaticCoupling:
    """Return the constant coupling of least mean squared relative error that a condition allows, without tolerance."""
    if problem.device.damping_ns_per_m == 0:
        raise UnsupportedError(
            "static needs device.damping_ns_per_m > 0: with 0 neither Llewellyn's condition (6) nor "
            "passivity at all frequencies allows a coupling; use closed-form, exact or direct, which judge one "
            "frequency alone",
            key="device.damping_ns_per_m",
        )
    search = StaticSearch(problem, condition, SampledLoop.of(problem))
    best, cost = search.run()
    b, k, contact = (float(value) for value in search.gains(best[None])[:, 0])
    margin = float(search.slack(best[None])[0]) + problem.stability.margin_ns_per_m
    return StaticCoupling(
        condition, search.loop.model, b, k, contact, margin, float(np.sqrt(cost)), bool(np.isfinite(cost))
    )


def solve_static(problem: Problem) -> GainSchedule:
    """Solve by a constant coupling under Llewellyn's condition; notes tell the best that is passive here alone."""
    started, units = time.perf_counter(), problem.units
    certified, special = static_coupling(problem), static_coupling(problem, "all")
    b, k, contact = certified.damping_ns_per_m, certified.stiffness_n_per_m, certified.contact_damping_ns_per_m
    lacking = problem.stability.margin_ns_per_m - certified.margin_ns_per_m
    why = (
        f"no constant coupling of the gain box meets Llewellyn's condition (6), {certified.model} model: the best, "
        f"{certified.gains(units)}, lacks {quantity(lacking, units.unit('N.s/m'))} of device damping"
    )
    n = len(problem.frequencies_hz())
    return constant_schedule(
        problem,
        "static",
        Gains(b, k, contact) if certified.found else None,
        started,
        reason="" if certified.found else why,
        status=row_status(problem, *(np.full(n, gain) for gain in (b, k, contact))),
        notes=tuple(f"best constant coupling, {choice.sentence(units)}" for choice in (certified, special)),
    )


def constant_schedule(
    problem: Problem,
    method: str,
    gains: Gains | None,
    started: float,
    *,
    reason: str = "",
    status: tuple[Status, ...] | None = None,
    notes: tuple[str, ...] = (),
    law: StateFeedback | None = None,
) -> GainSchedule:
    """Return the same gains at every frequency, infeasible for a reason where there are none."""
    n = len(problem.frequencies_hz())
    b, k, contact = (np.full(n, gain) for gain in vars(gains or Gains(0.0, 0.0)).values())
    return gain_schedule(
        problem,
        method,
        (b, k, contact),
        (Status.INFEASIBLE,) * n if gains is None else status or (Status.SOLVED,) * n,
        reason=(reason,) * n,
        solve_seconds=time.perf_counter() - started,
        notes=notes,
        state_feedback=law,
    )
