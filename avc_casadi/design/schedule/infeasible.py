"""Stages at which no gains of the box meet scope and realism: which, and by how much."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi.design.schedule.programme import Programme
from avc_casadi.design.schedule.scope import Slots, worst_slack
from avc_casadi.paper.realism import bound_magnitudes

_ROUNDS = 6


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
    for _ in range(_ROUNDS):
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
    best = f"with the best, b = {b:.6g}, k = {k:.6g}, b_p = {p:.6g}"
    told = f"no gains meet scope {problem.stability.scope} at {programme.frequency_hz[at]:.6g} Hz"
    next_step = "widen the box of [coupling], narrow the scope or add device damping"
    if programme.elastic == "realism":
        z, target = programme.loop.perceived(*gains)[at], np.asarray(programme.loop.target)[at]
        low, high = (float(end[at]) for end in bound_magnitudes(problem, programme.loop))
        wanted = {
            "bounds": f"|Z_h| is at best {abs(z):.6g}, not {low:.6g} to {high:.6g}",
            "jnd": f"|Z_h - Z_h_ds| is at best {abs(z / target - 1):.6g} |Z_h_ds|, not {problem.realism.jnd:g}",
        }
        return f"{told} and realism.require: {wanted[problem.realism.require]}, {best}; {next_step}"
    worst = worst_slack(problem, programme.frequency_hz, gains)
    short = f"Re Z_h is short by {-worst.slack[at]:.6g} at {worst.frequency_hz[at]:.6g} Hz"
    if programme.hands is not None:
        short = f"the spectral radius is {1 - worst.slack[at]:.6g}"
    return f"{told}: {short} {best}; {next_step}"
