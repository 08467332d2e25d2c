"""A hand-tuned constant pair (k, b) judged beside the designed schedule."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.coupling import (
    GainSchedule,
    Status,
    gain_schedule,
)
from avc_casadi.loop import margin_over_range
from avc_casadi.study.comparison._safety import Safety, safer, safety_reason
from avc_casadi.support import Comparable, ComplexArray, FloatArray

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from avc_casadi.loop import Loop
    from avc_casadi.problem import Problem


@dataclass(frozen=True, eq=False)
class HandTuned(Comparable):
    """One constant series coupling at every frequency; arrays of shape (n,).

    Attributes:
        stiffness_n_per_m: k.
        damping_ns_per_m: b.
        impedance: perceived impedance, N.s/m.
        magnitude_error: ||Z_h_ds| - |Z_h||, N.s/m.
        complex_error: |Z_h - Z_h_ds|/|Z_h_ds|.
        real_part: Re Z_h, N.s/m.
        meets_margin: Re Z_h >= margin, (12).
        inside_box: whether both gains lie in the problem's gain box.
        compared: the method that it is judged beside.
        share_schedule_better: share of frequencies where the schedule has the smaller magnitude error, or meets (12)
            where the pair does not.
        share_pair_better: share where the pair meets (12) and has the smaller magnitude error, or the schedule has no
            gains; possible only with gains outside the box.
        safer: which is safe for more, "mine", the method's name or "equal"; errors count only where it is "equal".
        safety_reason: why, in one sentence.
    """

    stiffness_n_per_m: float
    damping_ns_per_m: float
    impedance: ComplexArray
    magnitude_error: FloatArray
    complex_error: FloatArray
    real_part: FloatArray
    meets_margin: NDArray[np.bool_]
    inside_box: bool
    compared: str
    share_schedule_better: float
    share_pair_better: float
    safer: str
    safety_reason: str

    @property
    def better(self) -> str:
        """Which is better, "mine", the method's name or "equal": the safer; of equally safe ones the nearer."""
        if self.safer != "equal" or self.share_pair_better == self.share_schedule_better:
            return self.safer
        return "mine" if self.share_pair_better > self.share_schedule_better else self.compared


def constant_pair(problem: Problem, pair: tuple[float, float]) -> GainSchedule:
    """Return the pair (k in N/m, b in N.s/m) as a table of constant series gains."""
    k, b = pair
    n = len(problem.frequencies_hz())
    gains = (np.full(n, b), np.full(n, k), np.zeros(n))
    return gain_schedule(problem, "mine", gains, (Status.SOLVED,) * n)


def judge_hand_tuned(
    problem: Problem,
    loop: Loop,
    pair: tuple[float, float],
    schedule: GainSchedule,
    tolerance: FloatArray,
    safety: tuple[Safety, Safety],
) -> HandTuned:
    """Judge a constant pair.

    Args:
        problem: the problem.
        loop: its loop at its frequencies.
        pair: (k in N/m, b in N.s/m).
        schedule: the designed gains.
        tolerance: differences in magnitude error below this count as equal, N.s/m, shape (n,).
        safety: what the pair and the designed gains are safe for.
    """
    k, b = pair
    box = problem.coupling
    impedance = np.asarray(loop.perceived(np.full(schedule.rows, b), np.full(schedule.rows, k)))
    target = np.asarray(loop.target)
    error = np.abs(np.abs(target) - np.abs(impedance))
    meets = impedance.real >= margin_over_range(problem)
    usable = schedule.usable
    ours = np.where(usable, schedule.magnitude_error, np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.abs(impedance - target) / np.abs(target)
    return HandTuned(
        stiffness_n_per_m=k,
        damping_ns_per_m=b,
        impedance=impedance,
        magnitude_error=error,
        complex_error=relative,
        real_part=impedance.real,
        meets_margin=meets,
        inside_box=box.damping_ns_per_m[0] <= b <= box.damping_ns_per_m[1]
        and box.stiffness_n_per_m[0] <= k <= box.stiffness_n_per_m[1],
        compared=schedule.method,
        share_schedule_better=float(np.mean(usable & (~meets | (ours + tolerance < error)))),
        share_pair_better=float(np.mean(meets & (error + tolerance < ours))),
        safer=safer(*safety, schedule.method),
        safety_reason=safety_reason(*safety, schedule.method),
    )
