"""The method `schedule`: gains over ln(omega) as one optimal-control problem.

States are the logarithms of the gains, controls their slopes; the stage cost is the squared relative error, the slope
penalty its smoothness, both averaged over ln(omega). Every stage meets its scope: Re Z_h >= margin at its frequency,
over its band, over all frequencies, or a loop that is stable with every hand of the set. A dynamic programme over a
lattice gives the start, a sparse NLP the solution; frequencies that violate a scope are added until none is left.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.design.schedule_programme import (
    BACKOFF,
    HandsTable,
    Programme,
    Slots,
    Solution,
    deciding_corners,
    realism_slack,
    worst_slack,
)
from avc_casadi.model.gains import GainSchedule, Status
from avc_casadi.model.problem import Problem
from avc_casadi.paper.equations import loop_at
from avc_casadi.paper.exact import exact_gains
from avc_casadi.paper.realism import bound_magnitudes
from avc_casadi.paper.rows import gain_schedule, row_status


def solve_schedule(problem: Problem, *, constant: bool = False, progress: Progress = SILENT) -> GainSchedule:
    """Solve the joint schedule of a problem for all its frequencies, which increase."""
    started = time.perf_counter()
    programme = Programme.of(problem, constant=constant)
    built = time.perf_counter()
    starts = _from_lattice(programme)
    missing = missing_rows(programme, starts[0])
    progress.advance(1, 2, "start on a lattice")
    found = None if missing.rows.all() else _solved(programme, missing, starts)
    solved, table = time.perf_counter(), _schedule(programme, missing, found)
    return replace(table, build_seconds=built - started, solve_seconds=solved - built)


def _from_lattice(programme: Programme) -> list[FloatArray]:
    """Return states (d, n) to start from: the cheapest path of a lattice first."""
    n, problem, x = len(programme.frequency_hz), programme.problem, programme.log_frequency
    chosen = np.unique(np.linspace(0, n - 1, min(n, 40)).round().astype(int))
    table = programme.hands
    # With hands on the nodes of the table, where it is exact.
    axes, nodes = (
        programme.states.lattice({2: (64, 64), 3: (22, 22, 10)}) if table is None else (table.axes, table.nodes)
    )
    gains, few = programme.states.gains(nodes), replace(programme, frequency_hz=programme.frequency_hz[chosen])
    slots = Slots.of(problem, few.frequency_hz, spread=True).frequency_hz
    costs = np.empty((len(chosen), nodes.shape[1]))
    spare = np.zeros(nodes.shape[1]) if table is None else table.values - programme.tolerance
    corner, margin = deciding_corners(problem)[0], problem.stability.margin_ns_per_m
    for stage in range(len(chosen)):
        one = few.at(np.array([stage]))
        if table is None and (stage == 0 or (slots[:, stage] != slots[:, stage - 1]).any()):
            spare = loop_at(corner, slots[:, stage, None]).perceived(*gains).real.min(axis=0) - margin
        scale = 1.0 if table is not None else one.scale_ns_per_m
        # Missing a constraint by its scale costs far more than any error, and a scope comes before realism.
        missed = 1e6 * np.maximum(0.0, -spare / scale) + 1e3 * np.maximum(0.0, -realism_slack(problem, one.loop, gains))
        costs[stage] = few.weight[stage] * (one.errors(gains) + missed)
    constant = np.repeat(nodes[:, [costs.sum(axis=0).argmin()]], n, axis=1)
    if programme.constant:
        return [constant]
    path = cheapest_path(costs, axes, x[chosen], problem.schedule.slope_penalty, programme.slope_limit)
    starts = [np.array([np.interp(x, x[chosen], row) for row in path])]
    if table is not None and len(axes) == 3:  # Its nodes are far apart, and constant gains need none between.
        starts.append(constant)
    if n == 1 or (problem.schedule.slope_penalty == 0 and problem.schedule.slope_limit is None):
        b, k, contact = (np.nan_to_num(gain) for gain in exact_gains(problem, programme.loop))
        starts.append(programme.states.states((b, k, contact)))
    return starts


def _solved(programme: Programme, missing: Missing, starts: list[FloatArray]) -> Solution:
    """Return the cheapest solution from all starts, the lattice's path itself, or the gains of tight stages at all."""
    tried = [_refined(programme, missing, start) for start in starts]
    found = [*tried, _checked(programme, missing, starts[0])]
    if all(one.failure for one in found):
        tight = missing.states[:, missing.tight].T[:, :, None]
        found += [_checked(programme, missing, np.repeat(state, len(missing.rows), axis=1)) for state in tight]
    best = min(found, key=lambda one: one.cost)
    if best.failure or programme.hands is None:
        return tried[0] if best.failure else best
    near = _about(programme, best, missing)
    # Where the solver fails few gains hold every hand: the first lattice was too coarse for them.
    also = _from_lattice(near) if tried[0].failure else []
    return min([best, *(_refined(near, missing, start) for start in (best.states, *also))], key=lambda one: one.cost)


def _checked(programme: Programme, missing: Missing, states: FloatArray) -> Solution:
    """Return states (d, n) as a solution, if all rows meet scope and realism and the slopes their limit."""
    spare, real = programme.spare(states)
    rounding = 1 + 1e-9
    steep = np.abs(np.diff(states, axis=1)) > programme.slope_limit * rounding * np.diff(programme.log_frequency)
    kept = not steep.any() and (((spare >= 0) & (real >= 0)) | missing.rows).all()
    return Solution(states, programme.cost_of(states)) if kept else Solution(states, np.inf, "violated scopes")


def _refined(programme: Programme, missing: Missing, states: FloatArray) -> Solution:
    """Solve from states (d, n), adding the worst frequencies, until every row meets its scope and realism exactly."""
    problem, slots = programme.problem, Slots.of(programme.problem, programme.frequency_hz)
    inside = np.where(missing.tight, 0.0, programme.tolerance), np.full(len(missing.rows), BACKOFF)
    backoff = np.where(missing.rows, -np.inf, inside)
    gains = programme.states.gains(states)
    slots.add(problem, gains, worst_slack(problem, programme.frequency_hz, gains), ~missing.rows)
    for _ in range(20):
        solution = programme.solve(slots, backoff, states)
        if solution.failure:
            return solution
        states, gains = solution.states, programme.states.gains(solution.states)
        worst = worst_slack(problem, programme.frequency_hz, gains)
        real = realism_slack(problem, programme.loop, gains)
        missed, unreal = ~worst.met & ~missing.rows, (real < 0) & ~missing.rows
        if not (missed | unreal).any():
            return solution
        slots.add(problem, gains, worst, missed)
        if programme.hands is None:
            # A small violation is removed by tightening; a larger one needs its frequency added first.
            short = -worst.slack / programme.scale_ns_per_m
            closer = backoff[0] + np.where(short < 1e-4, 2 * short, 0.0) + programme.tolerance
        else:
            # The table misses hands between the corners, and what lies between its nodes.
            table = programme.hands.spline(states).full()[0]
            closer = np.maximum(table, backoff[0]) - 1.1 * worst.slack + programme.tolerance
        backoff[0] = np.where(missed, closer, backoff[0])
        backoff[1] = np.where(unreal, backoff[1] - 2 * real + BACKOFF, backoff[1])
    return Solution(states, np.inf, "rows that keep violating their scope")


def _about(programme: Programme, found: Solution, missing: Missing) -> Programme:
    """Return the programme with a finer table of the hands, within a twentieth of the box about a path."""
    states = found.states[:, ~missing.rows]
    reach = 0.05 * (programme.states.high - programme.states.low)
    near = programme.states.within(states.min(axis=1) - reach, states.max(axis=1) + reach)
    return replace(programme, states=near, hands=HandsTable.of(programme.problem, near, {2: (32, 32), 3: (16, 16, 14)}))


def _schedule(programme: Programme, missing: Missing, found: Solution | None) -> GainSchedule:
    states, problem = missing.states if found is None else found.states, programme.problem
    b, k, contact = (np.where(missing.rows, np.nan, gain) for gain in programme.states.gains(states))
    status, reasons = row_status(problem, b, k, contact), missing.reasons
    notes = ["no row can meet its scope: no schedule"]
    if found is not None and found.failure:
        next_step = (
            "raise schedule.slope_limit, move schedule.slope_penalty towards 1e-3, or widen the box of [coupling]"
        )
        reasons = tuple(reason or f"ipopt stopped with {found.failure}; {next_step}" for reason in reasons)
        status = tuple(Status.FAILED if item.has_gains else item for item in status)
        notes = [f"ipopt stopped with {found.failure}: no schedule"]
    elif found is not None:
        notes = [f"cost {found.cost:.6g}: mean squared {problem.realism.objective} error and slope penalty, no unit"]
        notes.append("from the dynamic programme on a lattice; not proved to be the global optimum")
        if len(programme.frequency_hz) > 1 and not missing.rows.any():
            steepest = np.abs(np.diff(states, axis=1) / np.diff(programme.log_frequency)).max(axis=1)
            slopes = ", ".join(f"{name} {slope:.3g}" for name, slope in zip(("b", "k", "b_p"), steepest, strict=False))
            notes.append(f"steepest slopes d ln(gain + floor)/d ln(omega): {slopes}")
    return gain_schedule(
        problem, "schedule", (b, k, contact), status, solver="ipopt", reason=reasons, notes=tuple(notes)
    )


@dataclass(frozen=True)
class Missing:
    """Stages without admissible gains and why, those with nothing to spare of their scope, and the best states."""

    rows: BoolArray
    reasons: tuple[str, ...]
    tight: BoolArray
    states: FloatArray


def missing_rows(programme: Programme, path: FloatArray) -> Missing:
    """Return the stages at which no gains meet scope and required realism; those of states (d, n) are tried first."""
    n, states = len(programme.frequency_hz), path.copy()
    rows, tight, reasons = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool), [""] * n
    softest = np.repeat(programme.states.low[:, None], n, axis=1)
    for elastic in ("scope", "realism") if programme.problem.realism.require != "none" else ("scope",):
        known = rows.copy()
        for tried in (path, softest):
            spare, real = programme.spare(tried)
            known |= (spare >= programme.tolerance) & (real >= 0 if elastic == "realism" else True)
        if known.all():
            continue
        some = replace(programme.at(~known), constant=False, elastic=elastic)
        best = _nearest(some, path[:, ~known])
        spare, real = some.spare(best)
        if elastic == "scope":  # A solver only approaches what meets a scope with nothing to spare.
            softer = some.spare(softest[:, ~known])[0]
            best, spare = np.where(softer > spare, softest[:, ~known], best), np.maximum(spare, softer)
        states[:, ~known] = best
        lost = (spare < 0) | ((real < 0) & (elastic == "realism"))
        tight[~known] |= (spare >= 0) & (spare < programme.tolerance)
        for place, row in enumerate(np.flatnonzero(~known)):
            rows[row] |= lost[place]
            reasons[row] = _reason(some, place, best) if lost[place] else ""
    return Missing(rows, tuple(reasons), tight & ~rows, states)


def _nearest(programme: Programme, start: FloatArray) -> FloatArray:
    """Return the states (d, n) that miss the least; worst frequencies are added."""
    slots, scope = Slots.of(programme.problem, programme.frequency_hz), programme.elastic == "scope"
    backoff = np.repeat([[0.0], [-np.inf]] if scope else [[1.5 * programme.tolerance], [0.0]], start.shape[1], axis=1)
    for _ in range(6):
        found = programme.solve(slots, backoff, start)
        start, gains = found.states, programme.states.gains(found.states)
        worst = worst_slack(programme.problem, programme.frequency_hz, gains)
        short = 1.001 * np.maximum(found.short, 0) + programme.tolerance
        missed = worst.slack < -short * programme.scale_ns_per_m
        if len(slots.frequency_hz) == slots.fixed or not missed.any():
            break
        slots.add(programme.problem, gains, worst, missed)
    return start


def _reason(programme: Programme, at: int, states: FloatArray) -> str:
    """Return what is short at a stage with the best gains there, and the next step."""
    problem, gains = programme.problem, programme.states.gains(states)
    b, k, p = (float(gain[at]) for gain in gains)
    damping, stiffness = (problem.units.unit(one) for one in ("N.s/m", "N/m"))
    best = f"with the best, b = {b:.6g} {damping}, k = {k:.6g} {stiffness}, b_p = {p:.6g} {damping}"
    told = f"no gains meet scope {problem.stability.scope} at {programme.frequency_hz[at]:.6g} Hz"
    next_step = "widen the box of [coupling], narrow the scope or add device damping"
    if programme.elastic == "realism":
        z, target = programme.loop.perceived(*gains)[at], np.asarray(programme.loop.target)[at]
        low, high = (float(end[at]) for end in bound_magnitudes(problem, programme.loop))
        wanted = {
            "bounds": f"|Z_h| is at best {abs(z):.6g} {damping}, not {low:.6g} to {high:.6g}",
            "jnd": f"|Z_h - Z_h_ds| is at best {abs(z / target - 1):.6g} |Z_h_ds|, not {problem.realism.jnd:g}",
        }
        return f"{told} and realism.require: {wanted[problem.realism.require]}, {best}; {next_step}"
    worst = worst_slack(problem, programme.frequency_hz, gains)
    short = f"Re Z_h is short by {-worst.slack[at]:.6g} {damping} at {worst.frequency_hz[at]:.6g} Hz"
    if programme.hands is not None:
        short = f"the spectral radius is {1 - worst.slack[at]:.6g}"
    return f"{told}: {short} {best}; {next_step}"


def cheapest_path(
    costs: FloatArray, axes: list[FloatArray], log_frequency: FloatArray, slope_penalty: float, slope_limit: float
) -> FloatArray:
    """Return the states (d, n) of the cheapest path through a lattice; ``costs`` (n, nodes in C order) are weighted."""
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
