"""Trade-off of a wall: what a disk margin costs in impedance error and in ripple, each point one convex program."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.design.program import program_answers, why_no_law

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem

MARGINS = (0.1, 0.2, 0.3, 0.5)
_HZ = (1.0, 10.0, 30.0)
# Margins that differ by less are one point: the wall needs no less.
_SAME = 0.01


@dataclass(frozen=True)
class Trade:
    """What the best law found reaches at a disk margin; the error is that of `impedance_error`.

    Attributes:
        disk_margin: of every corner hand and released.
        error: at 1, 10 and 30 Hz.
        ripple_n: force at the hand for a sine of one encoder step.
        met: whether contact, decay and noise are as asked for too.
    """

    disk_margin: float
    error: tuple[float, float, float]
    ripple_n: float
    met: bool


def trade_off(problem: Problem, progress: Progress = SILENT) -> tuple[Trade, ...]:
    """Return the points of a wall at `MARGINS` that differ, each from the last; empty where there is no law."""
    none = problem.detent is not None or why_no_law(problem)
    answer = None if none else next(iter(program_answers(problem, MARGINS[0])), None)
    found: list[Trade] = []
    for done, margin in enumerate(MARGINS):
        progress.advance(done, len(MARGINS), "convex programs of the trade-off")
        if answer is None:
            break
        answer = answer if done == 0 else answer.moved(margin / answer.program.disk_margin)
        if found and abs(answer.judged.disk_margin - found[-1].disk_margin) < _SAME:
            continue
        one, two, three = answer.errors(np.array(_HZ)).tolist()
        step = problem.device.encoder_resolution_m / problem.device.metres_per_unit
        ripple = answer.judged.noise_n_per_m * step
        found.append(Trade(answer.judged.disk_margin, (one, two, three), ripple, answer.met))
    return tuple(found)
