"""`direct` beyond the pointwise reading of (12): over a band, over all frequencies, or with every hand of a set.

Where the optimum of the pointwise problem meets the wider scope, it is the optimum there too. The other frequencies are
solved as one sparse NLP with nothing that joins them, from the best point of a lattice and from the pointwise optimum;
frequencies that violate the scope are added until none is left. At first the goal carries a small share of the complex
error, which breaks the ties of (11); then it is (11) alone, from there.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi.design._backends import EDGES
from avc_casadi.design._edge_search import edge_search_gains
from avc_casadi.design._gains import BoolArray, FloatArray, GainSchedule, Status, gain_schedule
from avc_casadi.design._rows import Gains, row_status
from avc_casadi.design.schedule import (
    Missing,
    Outcome,
    Slots,
    Task,
    missing_rows,
    realism_slack,
    refined,
    solve_program,
    worst_slack,
)
from avc_casadi.impedance import Loop, loop_at
from avc_casadi.problem import Frequency, Problem

_TIE = 1e-7
"""Magnitude errors closer than this, relative to |Z_h_ds|, are equal: the smaller distance wins."""
_WEIGHT = 1e4
"""Weight of each frequency's goal: errors of 1e-6 then still count against the solver's tolerance."""
_POINTS = {2: (32, 32), 3: (16, 16, 8)}


@dataclass(frozen=True)
class ScopedGains:
    """What a scope leaves of `direct`.

    Attributes:
        gains: (b, k, b_p), each (n,); not a number where there are none.
        failed: rows that have admissible gains, but for which the solver found none, (n,).
        reasons: a sentence for each row without gains, else empty.
        separate: rows whose optimum is that of the pointwise problem, (n,), and so the global one.
    """

    gains: Gains
    failed: BoolArray
    reasons: tuple[str, ...]
    separate: BoolArray


def solve_scoped(problem: Problem, *, solver: str | None = None) -> GainSchedule:
    """Solve `direct` for a scope other than pointwise.

    Args:
        problem: the problem.
        solver: None or ``edges``: the edge search, and IPOPT for the frequencies that it leaves.

    Raises:
        UnsupportedError: another solver.
    """
    scope, require = problem.stability.scope, problem.realism.require
    if solver not in {None, EDGES}:
        real = "" if require == "none" else f" and realism {require}"
        relax = "" if require == "none" else ', and require = "none" in [realism]'
        raise UnsupportedError(
            f"solver {solver} solves (11)-(12) at single frequencies, not with scope {scope}{real};"
            f' leave out --solver, or set scope = "pointwise" in [stability]{relax}'
        )
    started = time.perf_counter()
    loop = loop_at(problem, problem.frequencies_hz())
    found = scoped_gains(problem, loop)
    seconds = time.perf_counter() - started
    status = row_status(problem, *found.gains)
    status = tuple(Status.FAILED if bad else item for item, bad in zip(status, found.failed, strict=True))
    failed = "ipopt found no gains that meet the constraints, although there are some: try method schedule"
    reasons = tuple(failed if bad else reason for reason, bad in zip(found.reasons, found.failed, strict=True))
    separate = int(found.separate.sum())
    met = f"scope {scope}" if require == "none" else f"scope {scope} and realism {require}"
    note = (
        f"{met} met exactly at every row with gains; at {separate} frequencies the optimum is that of the"
        " pointwise problem, elsewhere the best of two starts, not proved to be the global optimum"
    )
    return gain_schedule(
        problem,
        "direct",
        found.gains,
        status,
        solver="edges and ipopt",
        reason=reasons,
        solve_seconds=seconds,
        notes=(note,),
    )


def scoped_gains(problem: Problem, loop: Loop) -> ScopedGains:
    """Minimise (11) at each frequency subject to the problem's scope, met exactly, and to the gain box."""
    frequency = problem.frequencies_hz()
    b, k, p = edge_search_gains(_relaxed(problem), loop)
    found = np.isfinite(b)
    b0, k0, p0 = (np.where(found, gain, 0.0) for gain in (b, k, p))
    separate = found & worst_slack(problem, frequency, (b0, k0, p0)).met
    separate &= realism_slack(problem, loop, (b0, k0, p0)) >= 0
    rest = np.flatnonzero(~separate)
    failed, reasons = np.zeros(len(frequency), dtype=bool), [""] * len(frequency)
    if rest.size:
        task = replace(Task.of(_unlinked(problem, frequency[rest])), weight=_WEIGHT * rest.size)
        missing = missing_rows(task)
        best = _solved(task, missing, (b[rest], k[rest], p[rest]))
        for gain, value in zip((b, k, p), best, strict=True):
            gain[rest] = value
        failed[rest] = np.isnan(best[0]) & ~missing.rows
        for row, reason in zip(rest, missing.reasons, strict=True):
            reasons[row] = reason
    return ScopedGains((b, k, p), failed, tuple(reasons), separate)


def _relaxed(problem: Problem) -> Problem:
    """A problem whose admissible gains include those of the scope: the pointwise one, or for hands no (12) at all."""
    if problem.stability.scope != "hands":
        return problem
    return problem.model_copy(update={"stability": problem.stability.model_copy(update={"margin_ns_per_m": -1e30})})


def _unlinked(problem: Problem, frequency_hz: FloatArray) -> Problem:
    """Some frequencies of a problem, with nothing that joins them."""
    schedule = problem.schedule.model_copy(
        update={"slope_penalty": 0.0, "slope_limit": None, "interaction_hz": None, "contact_damping_penalty": 0.0}
    )
    realism = problem.realism.model_copy(update={"objective": "tied"})
    frequency = Frequency(values_hz=tuple(frequency_hz.tolist()))
    return problem.model_copy(update={"schedule": schedule, "frequency": frequency, "realism": realism})


def _solved(task: Task, missing: Missing, relaxed: Gains) -> Gains:
    """Solve all frequencies at once; where that fails, in halves, so that one of them cannot spoil the others."""
    best = _best_outcome(task, missing, relaxed)
    n = len(task.frequency_hz)
    if n == 1 or np.isfinite(best[0]).any() or missing.rows.all():
        return best
    halves = np.array_split(np.arange(n), 2)
    b, k, p = relaxed
    parts = [
        _solved(task.at(task.frequency_hz[half]), missing.at(half), (b[half], k[half], p[half])) for half in halves
    ]
    return tuple(np.concatenate(gain) for gain in zip(*parts, strict=True))  # type: ignore[return-value]


def _best_outcome(task: Task, missing: Missing, relaxed: Gains) -> Gains:
    """Gains (n,) of the best start of each frequency, in the order of `direct`; not a number where none was solved."""
    slots = Slots.of(task.problem, task.frequency_hz)
    lattice = _lattice_optima(task, missing)
    known = np.isfinite(relaxed[0])
    b, k, p = (np.where(known, gain, 0.0) for gain in relaxed)
    starts = [lattice, np.where(known, task.states.states((b, k, p)), lattice)]
    best = tuple(np.full(len(task.frequency_hz), np.nan) for _ in range(3))
    error, distance = (np.full(len(task.frequency_hz), np.inf) for _ in range(2))
    for start in starts:
        data = task.data(slots, task.backoff(missing.rows))
        outcome = refined(
            task, solve_program(data, task.objective, start, extra=task.hands), slots, missing, solved=True
        )
        if outcome is None:
            continue
        for candidate in (outcome, _polished(task, outcome, missing)):
            if candidate is None:
                continue
            z = task.loop.perceived(*candidate.gains)
            radius = np.abs(task.loop.target)
            new_error, new_distance = np.abs(np.abs(z) / radius - 1), np.abs(z - task.loop.target) / radius
            closer = (np.abs(new_error - error) <= _TIE) & (new_distance < distance)
            better = ~missing.rows & ((new_error < error - _TIE) | closer)
            error, distance = np.where(better, new_error, error), np.where(better, new_distance, distance)
            best = tuple(np.where(better, new, old) for new, old in zip(candidate.gains, best, strict=True))
    return best[0], best[1], best[2]


def _polished(task: Task, outcome: Outcome, missing: Missing) -> Outcome | None:
    """Minimise (11) alone from a solution whose ties are broken."""
    realism = task.problem.realism.model_copy(update={"objective": "magnitude"})
    alone = replace(task, problem=task.problem.model_copy(update={"realism": realism}))
    return refined(alone, outcome.solution, outcome.slots, missing)


def _lattice_optima(task: Task, missing: Missing) -> FloatArray:
    """The cheapest states (d, n) of a lattice, each frequency on its own."""
    data = task.data(Slots.of(task.problem, task.frequency_hz, spread=True), task.backoff(missing.rows))
    axes = [
        np.linspace(low, high, points)
        for low, high, points in zip(data.low, data.high, _POINTS[len(data.low)], strict=True)
    ]
    nodes = np.array([grid.ravel() for grid in np.meshgrid(*axes, indexing="ij")])
    chosen = [int(task.lattice_cost(data, nodes, stage).argmin()) for stage in range(len(task.frequency_hz))]
    return np.asarray(nodes[:, chosen])
