"""Method ``robust``."""

from __future__ import annotations

from avc_casadi.design.registry import METHODS, Method

METHODS.add(
    "robust",
    Method(
        "avc_casadi.design.robust.solve:solve_robust",
        "the wall behind an observer with state feedback, for every hand and a device not quite as declared",
        keeps_ranges=True,
        reports=True,
    ),
    rank=70,
)
