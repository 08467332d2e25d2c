"""Method ``exact``."""

from __future__ import annotations

from avc_casadi.design.registry import METHODS, Method

METHODS.add(
    "exact",
    Method(
        "avc_casadi.paper.exact:solve_exact",
        "the global optimum of (11)-(12) from arc geometry",
        reports=True,
        answers_paper=True,
        pointwise=True,
        optimises=True,
        live=True,
    ),
    rank=30,
)
