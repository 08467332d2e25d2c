"""Method ``robust``."""

from __future__ import annotations

from avc_casadi.design.registry import METHODS, Method

METHODS.add(
    "robust",
    Method(
        "avc_casadi.design.robust:solve_robust",
        "the wall behind an observer with state feedback, by a convex program with a disk margin for every hand",
        keeps_ranges=True,
        reports=True,
    ),
    rank=70,
)
