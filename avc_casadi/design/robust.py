"""Method `robust`: the law of the convex program for the wall."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.design.program import program_answers, why_no_law
from avc_casadi.model.gains import GainSchedule, Status
from avc_casadi.paper.rows import gain_schedule

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem


def solve_robust(problem: Problem, *, progress: Progress = SILENT) -> GainSchedule:
    """Solve by an observer with state feedback; every row has the same gains.

    The law is in ``state_feedback``; `program_answers` says what it meets.
    """
    if why := why_no_law(problem):
        raise UnsupportedError(f"{problem.name}: robust: {why}; take another method, such as static")
    started = time.perf_counter()
    with progress.step("convex program"):
        answer = next(iter(program_answers(problem)), None)
    n = len(problem.frequencies_hz())
    coupling = None if answer is None else answer.coupling
    values = (np.nan,) * 3 if coupling is None else tuple(vars(coupling.table.at_rest).values())
    b, k, contact = (np.full(n, value) for value in values)
    reason = "no law is found that holds every hand; soften the wall, or narrow [hands] or [device.range]"
    notes: tuple[str, ...] = ()
    if answer is not None:
        found, goals = answer.judged, "as asked for" if answer.met else "not all as asked for"
        notes = (
            (
                f"error of the impedance from 1 to 30 Hz {100 * found.error:.3g} % at most, disk margin "
                f"{found.disk_margin:.2f}; margin, noise, contact and decay {goals}"
            ),
        )
    return gain_schedule(
        problem,
        "robust",
        (b, k, contact),
        (Status.INFEASIBLE if coupling is None else Status.SOLVED,) * n,
        reason=(reason if coupling is None else "",) * n,
        solve_seconds=time.perf_counter() - started,
        notes=notes,
        state_feedback=None if coupling is None else coupling.runtime.state_feedback,
    )
