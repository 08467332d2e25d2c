"""Method ``static-tuned``."""

from __future__ import annotations

from avc_casadi.design.registry import METHODS, Candidate, Method

METHODS.add(
    "static-tuned",
    Method(
        "avc_casadi.design.constant.static_tuned:solve_static_tuned",
        "the best constant gains, stable with every hand of [hands] and at rest in the scene",
        reports=True,
        candidates=(
            Candidate(
                "static-tuned-series",
                "constant series gains tuned for the training hands",
                rank=50,
                tuned="series",
                constant=True,
            ),
            Candidate(
                "static-tuned",
                "constant gains with a contact damper, tuned for the training hands",
                rank=70,
                tuned="damped",
                constant=True,
                meets_others=True,
            ),
        ),
    ),
    rank=60,
)
