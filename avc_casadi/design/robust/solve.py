"""Method `robust`: the stiffest wall, up to the one that is wanted, for which a robust law is found."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.design.robust.cma_continuation import Step, continuation
from avc_casadi.design.robust.lqg import Space
from avc_casadi.design.robust.refinement import refined
from avc_casadi.design.robust.uncertainty_set import why_no_law
from avc_casadi.loops.walls import softest_wall_n_per_m, stiffest_wall
from avc_casadi.model.hands import hand_corners, with_released
from avc_casadi.model.schedule import GainSchedule, Status
from avc_casadi.paper.rendered import gain_schedule

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem

FIRST = 0.9
"""The first wall of a continuation, as a share of the limit of spring and damper."""


def solve_robust(problem: Problem, *, progress: Progress = SILENT) -> GainSchedule:
    """Solve by an observer with state feedback; every row has the same gains.

    The gains are the spring before the wall. The law is in ``state_feedback``; it is stable with every hand of
    ``[hands]`` and released, at every corner of ``[device.range]``, with the assumed model mismatch, and at every
    sector gain of the dead zone, which is 1 in the impedances of the rows.

    Args:
        problem: device, hands and wall; scope, structure, gain box and frequencies do not matter.
        progress: reports the continuations.

    Raises:
        UnsupportedError: no mass, no stiffness to render, or too long a delay.
    """
    why = why_no_law(problem)
    if why:
        raise UnsupportedError(f"{problem.name}: robust: {why}; take another method, such as static")
    started = time.perf_counter()
    best = _stiffest(problem, progress)
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
        notes=() if best is None else (_told(best),),
        state_feedback=None if best is None else best.best.law,
    )


def _stiffest(problem: Problem, progress: Progress) -> Step | None:
    """Continue from each start up to the wanted wall, until one reaches it; refine the law of the stiffest."""
    wanted = problem.environment.stiffness_n_per_m
    plain = stiffest_wall(problem.device, with_released(hand_corners(problem.hands))).stiffness_n_per_m
    first = min(wanted, FIRST * max(plain, softest_wall_n_per_m(problem.device)))
    starts = Space(problem.device, problem.hands).starts
    best: Step | None = None
    for done, start in enumerate(starts):
        progress.advance(done, len(starts), "robust laws for stiffer and stiffer walls")
        for step in continuation(problem, start, (first, wanted)):
            best = step if best is None or step.stiffness_n_per_m > best.stiffness_n_per_m else best
        if best is not None and best.stiffness_n_per_m >= wanted:
            break
    return None if best is None else refined(problem, best)


def _told(step: Step) -> str:
    """Return a description of a law."""
    law, cost = step.best.law, step.best.cost
    return (
        f"observer of {law.states} states with a dead zone of +-{law.dead_zone_m:.4g}, and feedback: "
        f"{step.stiffness_n_per_m:.5g} at rest; spectral radius {cost.radius:.5f} at most over hands, let go "
        f"and devices about the declared one, {cost.radius_any_share:.5f} over all shares of the innovation; the best "
        "that a search found, not the best there is"
    )
