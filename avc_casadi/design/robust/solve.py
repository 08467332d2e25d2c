"""Method `robust`: the stiffest wall, up to the one that is wanted, for which a robust law is found."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.design.robust.ladder import Rung, ladder_n_per_m, robust_at
from avc_casadi.model.schedule import GainSchedule, Status
from avc_casadi.paper.rendered import gain_schedule

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem

# Above the stiffest of the ladder, this much more is tried.
_BETWEEN = 1.18


def solve_robust(problem: Problem, *, progress: Progress = SILENT) -> GainSchedule:
    """Solve by an observer with state feedback before the wall; every row has the same gains.

    The gains are the spring before the wall. The law that belongs to them is in ``state_feedback``; it holds every hand
    of ``[hands]`` and the device let go at every corner of ``[device.range]``, with what a device may differ from its
    file by, and whatever share of the innovation passes the dead zone, which passes all in the impedances of the rows.

    Args:
        problem: device, hands and wall; scope, structure, gain box and frequencies do not matter.
        progress: told of the walls.

    Raises:
        UnsupportedError: no mass, no stiffness to be felt, or too long a delay.
    """
    started, wanted = time.perf_counter(), problem.environment.stiffness_n_per_m
    known: list[Rung] = []
    walls = ladder_n_per_m(problem)
    for done, wall in enumerate(walls):
        progress.advance(done, len(walls), f"walls, search of a law for {wall:.4g} N/m")
        found = _cheapest(problem, wall, known)
        known += [] if found is None else [found]
        if wall == wanted and found is not None:
            break
        if found is None and not (done == 0 and wall == wanted):
            break
    best = known[-1] if known else None
    if best is not None and best.stiffness_n_per_m * _BETWEEN < wanted:
        best = _cheapest(problem, best.stiffness_n_per_m * _BETWEEN, known) or best
    n = len(problem.frequencies_hz())
    values = (np.nan,) * 3 if best is None else tuple(vars(best.gains).values())
    reason = "no law is found that holds every hand; soften the wall, or narrow [hands] or [device.range]"
    b, k, contact = (np.full(n, value) for value in values)
    return gain_schedule(
        problem,
        "robust",
        (b, k, contact),
        (Status.INFEASIBLE if best is None else Status.SOLVED,) * n,
        reason=(reason if best is None else "",) * n,
        solve_seconds=time.perf_counter() - started,
        notes=() if best is None else (told(best),),
        state_feedback=None if best is None else best.found.law,
    )


def _cheapest(problem: Problem, stiffness_n_per_m: float, known: list[Rung]) -> Rung | None:
    found = robust_at(problem, stiffness_n_per_m, known)
    return min(found, key=lambda rung: rung.found.cost.total, default=None)


def told(rung: Rung) -> str:
    """Say what a law is."""
    law, cost = rung.found.law, rung.found.cost
    return (
        f"observer of {law.states} states with a dead zone of +-{1e6 * law.dead_zone_m:.4g} um, and feedback: "
        f"{rung.stiffness_n_per_m:.5g} N/m at rest; spectral radius {cost.radius:.5f} at most over hands, let go and "
        f"devices about the declared one, {cost.radius_any_share:.5f} over all shares of the innovation; the best that "
        "a search found, not the best there is"
    )
