"""Method ``direct``."""

from __future__ import annotations

from avc_casadi.design.registry import METHODS, Candidate, Method

METHODS.add(
    "direct",
    Method(
        "avc_casadi.paper.direct:solve_direct",
        "the paper's NLP (11)-(12), solved directly at every frequency",
        options=("solver", "tolerance"),
        reports=True,
        answers_paper=True,
        pointwise=True,
        optimises=True,
        live=True,
        candidates=(Candidate("direct", "the paper's pointwise optimum (11)-(12), series", rank=30),),
    ),
    rank=20,
)
