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

from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
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
from avc_casadi.paper.rows import SolveRecord, gain_schedule, row_status

LATTICE_STAGES = 40
"""Largest number of frequencies at which the dynamic programme chooses a state; between them it interpolates."""
LATTICE_NODES = {2: (64, 64), 3: (22, 22, 10)}
"""Nodes of the dynamic programme's lattice along each state, by the number of states (b, k, and b_p if admitted)."""
FINER_NODES = {2: (32, 32), 3: (16, 16, 14)}
"""Nodes along each state of the finer table of the hands about a solution."""
FINER_REACH = 0.05
"""How far that finer table reaches beyond the solution's states, as a share of the box."""
SCOPE_PENALTY = 1e6
"""Cost in the lattice of missing the scope by its scale: far more than any error, and a scope precedes realism."""
REALISM_PENALTY = 1e3
"""Cost in the lattice of missing the required realism by 1 (relative)."""
SLOPE_ROUNDING = 1e-9
"""Share of the slope limit by which a path may exceed it: rounding."""
REFINEMENTS = 20
"""Solutions of the NLP, each with more frequencies or a tighter bound, before a start is given up."""
SMALL_VIOLATION = 1e-4
"""Violation of Re Z_h, over its scale, below which the bound is tightened; a larger one gets its frequency first."""
HANDS_TIGHTENING = 1.1
"""Multiple of a violation in spectral radius by which the bound of the hands' table is raised."""
ELASTIC_SOLUTIONS = 6
"""Solutions of the elastic NLP, each with more frequencies, that look for the gains that miss a scope the least."""
ELASTIC_TOLERANCES = 1.5
"""Tolerances by which the scope is kept while the elastic NLP looks for the gains that miss realism the least."""
SHORT_ROUNDING = 1.001
"""Multiple of the shortfall that the elastic NLP reports up to which an exact one counts as the same."""


def solve_schedule(problem: Problem, *, constant: bool = False, progress: Progress = SILENT) -> GainSchedule:
    """Return the gains of the joint schedule of a problem at all its frequencies, which increase.

    With ``constant`` they are the same at all of them.
    """
    started = time.perf_counter()
    programme = Programme.of(problem, constant=constant)
    built = time.perf_counter()
    starts = _from_lattice(programme)
    missing = missing_rows(programme, starts[0])
    progress.advance(1, 2, "start on a lattice")
    solution = None if missing.rows.all() else _solved(programme, missing, starts)
    solved = time.perf_counter()
    table = _schedule(programme, missing, solution)
    return replace(table, build_seconds=built - started, solve_seconds=solved - built)


def _from_lattice(programme: Programme) -> list[FloatArray]:
    """Return states (d, n) to start the NLP from: first the cheapest path of a dynamic programme over a lattice.

    Where they may help, constant states and the exact gains of each frequency follow.
    """
    problem = programme.problem
    n = len(programme.frequency_hz)
    x = programme.log_frequency
    chosen = np.unique(np.linspace(0, n - 1, min(n, LATTICE_STAGES)).round().astype(int))
    table = programme.hands
    if table is None:
        axes, nodes = programme.states.lattice(LATTICE_NODES)
    else:  # the nodes of the hands' table, where it is exact
        axes, nodes = table.axes, table.nodes
    costs = _lattice_costs(programme, chosen, nodes)
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


def _lattice_costs(programme: Programme, chosen: IndexArray, nodes: FloatArray) -> FloatArray:
    """Return the weighted cost of each node (d, m) at the chosen stages, shape (stages, m), a missed scope penalised.

    The cost is w (l + 1e6 max(0, -spare of the scope/scale) + 1e3 max(0, -slack of realism)), l the stage cost.
    """
    problem = programme.problem
    table = programme.hands
    gains = programme.states.gains(nodes)
    coarse = replace(programme, frequency_hz=programme.frequency_hz[chosen])
    slots = Slots.of(problem, coarse.frequency_hz, spread=True).frequency_hz
    corner = deciding_corners(problem)[0]
    margin = problem.stability.margin_ns_per_m
    costs = np.empty((len(chosen), nodes.shape[1]))
    spare = np.zeros(nodes.shape[1]) if table is None else table.values - programme.tolerance
    for place in range(len(chosen)):
        stage = coarse.at(np.array([place]))
        if table is None and (place == 0 or (slots[:, place] != slots[:, place - 1]).any()):
            spare = loop_at(corner, slots[:, place, None]).perceived(*gains).real.min(axis=0) - margin
        scale = 1.0 if table is not None else stage.scale_ns_per_m
        missed_scope = SCOPE_PENALTY * np.maximum(0.0, -spare / scale)
        missed_realism = REALISM_PENALTY * np.maximum(0.0, -realism_slack(problem, stage.loop, gains))
        costs[place] = coarse.weight[place] * (stage.errors(gains) + (missed_scope + missed_realism))
    return costs


def _solved(programme: Programme, missing: Missing, starts: list[FloatArray]) -> Solution:
    """Return the cheapest of the solutions from all starts and of the lattice's path itself.

    If none meets every scope, the gains of stages with nothing to spare are tried at all stages. With scope hands the
    best is solved again with a finer table of the hands about it.
    """
    refined = [_refined(programme, missing, start) for start in starts]
    solutions = [*refined, _checked(programme, missing, starts[0])]
    if all(solution.failure for solution in solutions):
        tight = missing.states[:, missing.tight].T[:, :, None]
        solutions += [_checked(programme, missing, np.repeat(state, len(missing.rows), axis=1)) for state in tight]
    best = min(solutions, key=_cost)
    if best.failure or programme.hands is None:
        return refined[0] if best.failure else best
    finer = _about(programme, best, missing)
    # Where the solver fails few gains hold every hand: the first lattice was too coarse for them.
    more_starts = _from_lattice(finer) if refined[0].failure else []
    return min([best, *(_refined(finer, missing, start) for start in (best.states, *more_starts))], key=_cost)


def _cost(solution: Solution) -> float:
    return solution.cost


def _checked(programme: Programme, missing: Missing, states: FloatArray) -> Solution:
    """Return states (d, n) as a solution, if all rows meet scope and realism and the slopes their limit."""
    spare, realism = programme.spare(states)
    largest_step = programme.slope_limit * (1 + SLOPE_ROUNDING) * np.diff(programme.log_frequency)
    steep = np.abs(np.diff(states, axis=1)) > largest_step
    kept = not steep.any() and (((spare >= 0) & (realism >= 0)) | missing.rows).all()
    return Solution(states, programme.cost_of(states)) if kept else Solution(states, np.inf, "violated scopes")


def _refined(programme: Programme, missing: Missing, states: FloatArray) -> Solution:
    """Solve from states (d, n), adding the worst frequencies, until every row meets its scope and realism exactly."""
    problem = programme.problem
    slots = Slots.of(problem, programme.frequency_hz)
    scope_backoff = np.where(missing.tight, 0.0, programme.tolerance)
    realism_backoff = np.full(len(missing.rows), BACKOFF)
    backoff = np.where(missing.rows, -np.inf, (scope_backoff, realism_backoff))
    gains = programme.states.gains(states)
    slots.add(problem, gains, worst_slack(problem, programme.frequency_hz, gains), ~missing.rows)
    for _ in range(REFINEMENTS):
        solution = programme.solve(slots, backoff, states)
        if solution.failure:
            return solution
        states = solution.states
        gains = programme.states.gains(states)
        worst = worst_slack(problem, programme.frequency_hz, gains)
        realism = realism_slack(problem, programme.loop, gains)
        missed = ~worst.met & ~missing.rows
        unreal = (realism < 0) & ~missing.rows
        if not (missed | unreal).any():
            return solution
        slots.add(problem, gains, worst, missed)
        closer = _tightened(programme, backoff[0], worst.slack, states)
        backoff[0] = np.where(missed, closer, backoff[0])
        backoff[1] = np.where(unreal, backoff[1] - 2 * realism + BACKOFF, backoff[1])
    return Solution(states, np.inf, "rows that keep violating their scope")


def _tightened(programme: Programme, backoff: FloatArray, slack: FloatArray, states: FloatArray) -> FloatArray:
    """Return a tighter backoff of each row from its scope, (n,), after states (d, n) with that exact slack."""
    if programme.hands is None:
        # A small violation is removed by tightening; a larger one needs its frequency added first.
        short = -slack / programme.scale_ns_per_m
        return np.asarray(backoff + np.where(short < SMALL_VIOLATION, 2 * short, 0.0) + programme.tolerance)
    # The table misses hands between the corners, and what lies between its nodes.
    table = programme.hands.spline(states).full()[0]
    return np.asarray(np.maximum(table, backoff) - HANDS_TIGHTENING * slack + programme.tolerance)


def _about(programme: Programme, solution: Solution, missing: Missing) -> Programme:
    """Return the programme with a finer table of the hands, within a twentieth of the box about a path."""
    states = solution.states[:, ~missing.rows]
    reach = FINER_REACH * (programme.states.high - programme.states.low)
    box = programme.states.within(states.min(axis=1) - reach, states.max(axis=1) + reach)
    return replace(programme, states=box, hands=HandsTable.of(programme.problem, box, FINER_NODES))


def _schedule(programme: Programme, missing: Missing, solution: Solution | None) -> GainSchedule:
    """Return a solution as a gain table with status, reasons and notes; without gains where there is none."""
    problem = programme.problem
    states = missing.states if solution is None else solution.states
    b, k, contact = (np.where(missing.rows, np.nan, gain) for gain in programme.states.gains(states))
    status = row_status(problem, b, k, contact)
    reasons = missing.reasons
    notes = ["no row can meet its scope: no schedule"]
    if solution is not None and solution.failure:
        next_step = (
            "raise schedule.slope_limit, move schedule.slope_penalty towards 1e-3, or widen the box of [coupling]"
        )
        reasons = tuple(reason or f"ipopt stopped with {solution.failure}; {next_step}" for reason in reasons)
        status = tuple(Status.FAILED if item.has_gains else item for item in status)
        notes = [f"ipopt stopped with {solution.failure}: no schedule"]
    elif solution is not None:
        notes = _solution_notes(programme, missing, solution)
    record = SolveRecord(solver="ipopt", reason=reasons, notes=tuple(notes))
    return gain_schedule(problem, "schedule", (b, k, contact), status, record)


def _solution_notes(programme: Programme, missing: Missing, solution: Solution) -> list[str]:
    """Return the notes on a solution: its cost, that it is local, and its steepest slopes."""
    objective = programme.problem.realism.objective
    notes = [
        f"cost {solution.cost:.6g}: mean squared {objective} error and slope penalty, no unit",
        "from the dynamic programme on a lattice; not proved to be the global optimum",
    ]
    if len(programme.frequency_hz) > 1 and not missing.rows.any():
        steepest = np.abs(np.diff(solution.states, axis=1) / np.diff(programme.log_frequency)).max(axis=1)
        slopes = ", ".join(f"{name} {slope:.3g}" for name, slope in zip(("b", "k", "b_p"), steepest, strict=False))
        notes.append(f"steepest slopes d ln(gain + floor)/d ln(omega): {slopes}")
    return notes


@dataclass(frozen=True)
class Missing:
    """Stages that cannot meet their scope or realism.

    Attributes:
        rows: stages without admissible gains, shape (n,).
        reasons: why, one sentence a stage, empty where there are gains.
        tight: stages with gains but nothing to spare of their scope, shape (n,).
        states: the best states of each stage, shape (d, n).
    """

    rows: BoolArray
    reasons: tuple[str, ...]
    tight: BoolArray
    states: FloatArray


def missing_rows(programme: Programme, path: FloatArray) -> Missing:
    """Return the stages at which no gains meet scope and required realism; those of states (d, n) are tried first."""
    n = len(programme.frequency_hz)
    states = path.copy()
    rows = np.zeros(n, dtype=bool)
    tight = np.zeros(n, dtype=bool)
    reasons = [""] * n
    softest = np.repeat(programme.states.low[:, None], n, axis=1)
    requirements = ("scope",) if programme.problem.realism.require == "none" else ("scope", "realism")
    for elastic in requirements:
        known = rows.copy()
        for candidate in (path, softest):
            spare, realism = programme.spare(candidate)
            known |= (spare >= programme.tolerance) & (realism >= 0 if elastic == "realism" else True)
        if known.all():
            continue
        unknown = replace(programme.at(~known), constant=False, elastic=elastic)
        best = _nearest(unknown, path[:, ~known])
        spare, realism = unknown.spare(best)
        if elastic == "scope":  # A solver only approaches what meets a scope with nothing to spare.
            softer = unknown.spare(softest[:, ~known])[0]
            best = np.where(softer > spare, softest[:, ~known], best)
            spare = np.maximum(spare, softer)
        states[:, ~known] = best
        lost = (spare < 0) | ((realism < 0) & (elastic == "realism"))
        tight[~known] |= (spare >= 0) & (spare < programme.tolerance)
        for place, row in enumerate(np.flatnonzero(~known)):
            rows[row] |= lost[place]
            reasons[row] = _reason(unknown, place, best) if lost[place] else ""
    return Missing(rows, tuple(reasons), tight & ~rows, states)


def _nearest(programme: Programme, start: FloatArray) -> FloatArray:
    """Return the states (d, n) that miss the least; worst frequencies are added."""
    slots = Slots.of(programme.problem, programme.frequency_hz)
    for_scope = programme.elastic == "scope"
    scope_backoff = 0.0 if for_scope else ELASTIC_TOLERANCES * programme.tolerance
    realism_backoff = -np.inf if for_scope else 0.0
    backoff = np.repeat([[scope_backoff], [realism_backoff]], start.shape[1], axis=1)
    for _ in range(ELASTIC_SOLUTIONS):
        solution = programme.solve(slots, backoff, start)
        start = solution.states
        gains = programme.states.gains(start)
        worst = worst_slack(programme.problem, programme.frequency_hz, gains)
        short = SHORT_ROUNDING * np.maximum(solution.short, 0) + programme.tolerance
        missed = worst.slack < -short * programme.scale_ns_per_m
        if len(slots.frequency_hz) == slots.fixed or not missed.any():
            break
        slots.add(programme.problem, gains, worst, missed)
    return start


def _reason(programme: Programme, stage: int, states: FloatArray) -> str:
    """Return a sentence on what is short at a stage with the best gains there, and the next step."""
    problem = programme.problem
    gains = programme.states.gains(states)
    b, k, p = (float(gain[stage]) for gain in gains)
    damping = problem.units.unit("N.s/m")
    stiffness = problem.units.unit("N/m")
    best = f"with the best, b = {b:.6g} {damping}, k = {k:.6g} {stiffness}, b_p = {p:.6g} {damping}"
    missed = f"no gains meet scope {problem.stability.scope} at {programme.frequency_hz[stage]:.6g} Hz"
    next_step = "widen the box of [coupling], narrow the scope or add device damping"
    if programme.elastic == "realism":
        z = programme.loop.perceived(*gains)[stage]
        target = np.asarray(programme.loop.target)[stage]
        low, high = (float(bound[stage]) for bound in bound_magnitudes(problem, programme.loop))
        wanted = {
            "bounds": f"|Z_h| is at best {abs(z):.6g} {damping}, not {low:.6g} to {high:.6g}",
            "jnd": f"|Z_h - Z_h_ds| is at best {abs(z / target - 1):.6g} |Z_h_ds|, not {problem.realism.jnd:g}",
        }
        return f"{missed} and realism.require: {wanted[problem.realism.require]}, {best}; {next_step}"
    worst = worst_slack(problem, programme.frequency_hz, gains)
    short = f"Re Z_h is short by {-worst.slack[stage]:.6g} {damping} at {worst.frequency_hz[stage]:.6g} Hz"
    if programme.hands is not None:
        short = f"the spectral radius is {1 - worst.slack[stage]:.6g}"
    return f"{missed}: {short} {best}; {next_step}"


NEIGHBOUR = 1.001
"""Share of the first spacing of an axis up to which a node counts as a neighbour, reachable whatever the limit."""


def cheapest_path(
    costs: FloatArray, axes: list[FloatArray], log_frequency: FloatArray, slope_penalty: float, slope_limit: float
) -> FloatArray:
    """Return the states (d, n) of the cheapest path through a lattice; ``costs`` (n, nodes in C order) are weighted.

    Bellman's recursion, one state after the other at each step h of ln(omega) over the span X:
    V(s) <- min over s' of V(s') + slope_penalty (s - s')^2/(X h), then V <- V + the costs of the next stage.
    """
    shape = tuple(len(axis) for axis in axes)
    span = log_frequency[-1] - log_frequency[0]
    value = costs[0].reshape(shape)
    values: list[FloatArray] = []  # before each move, in its order: the states of a step one after the other
    moves: list[FloatArray] = []  # cost of each move, (nodes, nodes) of its state
    for stage_cost, step in zip(costs[1:], np.diff(log_frequency), strict=True):
        for dimension, axis in enumerate(axes):
            distance = np.abs(axis[:, None] - axis)
            within = distance <= max(slope_limit * step, NEIGHBOUR * np.diff(axis[:2]).sum())
            move = np.where(within, slope_penalty / (span * step) * distance**2, np.inf)
            values.append(value)
            moves.append(move)
            value = _after_move(value, move, dimension)
        value = value + stage_cost.reshape(shape)
    node = list(np.unravel_index(int(value.argmin()), shape))
    states = [_state(axes, node)]
    for number in reversed(range(len(moves))):
        dimension = number % len(axes)
        line = values[number][tuple(slice(None) if axis == dimension else i for axis, i in enumerate(node))]
        node[dimension] = (line + moves[number][node[dimension]]).argmin()
        if dimension == 0:
            states.append(_state(axes, node))
    return np.array(states[::-1]).T


def _after_move(value: FloatArray, move: FloatArray, dimension: int) -> FloatArray:
    """Return the least cost V(s) = min over s' of V(s') + move(s, s') after a move along one state.

    ``value`` is V over the lattice, ``move`` the cost (nodes, nodes) of that state, ``dimension`` its axis.
    """
    lines = np.ascontiguousarray(np.moveaxis(value, dimension, 0))
    best = np.full_like(lines, np.inf)
    for line, from_line in zip(lines, move.T, strict=True):
        np.minimum(best, line + from_line.reshape(-1, *([1] * line.ndim)), out=best)
    return np.moveaxis(best, 0, dimension)


def _state(axes: list[FloatArray], node: list[np.intp]) -> list[float]:
    return [axis[i] for axis, i in zip(axes, node, strict=True)]
