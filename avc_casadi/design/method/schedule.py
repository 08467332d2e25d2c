"""Method ``schedule``."""

from __future__ import annotations

from avc_casadi.design.registry import METHODS, Candidate, Method

METHODS.add(
    "schedule",
    Method(
        "avc_casadi.design.schedule.solver:solve_schedule",
        "all frequencies as one optimal-control problem: smooth gains that meet the problem's scope",
        keeps_realism=True,
        credits_hand=True,
        reports=True,
        answers_paper=True,
        candidates=(
            Candidate(
                "schedule-series",
                "series gains scheduled on frequency, tuned for the training hands",
                rank=60,
                tuned="series",
            ),
            Candidate(
                "schedule",
                "gains with a contact damper scheduled on frequency, tuned for the training hands",
                rank=80,
                tuned="damped",
                meets_others=True,
            ),
        ),
    ),
    rank=40,
)
