"""Method ``closed-form``."""

from __future__ import annotations

from avc_casadi.design.registry import METHODS, Candidate, Method

METHODS.add(
    "closed-form",
    Method(
        "avc_casadi.paper.closed_form:solve_closed_form",
        "the paper's projection onto Re Z_h >= 0, then back to b and k; for comparison",
        options=("as_printed",),
        answers_paper=True,
        pointwise=True,
        live=True,
        candidates=(
            Candidate(
                "closed-form",
                "the paper's projection as what it is: the desired wall and a constant contact damper",
                rank=40,
            ),
        ),
    ),
    rank=10,
)
