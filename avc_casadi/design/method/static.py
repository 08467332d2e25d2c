"""Method ``static``."""

from __future__ import annotations

from avc_casadi.design.registry import METHODS, Candidate, Method

METHODS.add(
    "static",
    Method(
        "avc_casadi.design.constant.static:solve_static",
        "the best constant gains under Llewellyn's condition (6)",
        candidates=(
            Candidate(
                "static",
                "best constant series coupling under Llewellyn's condition (6) with the printed hold",
                rank=10,
                constant=True,
                meets_others=True,
            ),
            Candidate(
                "static-sampled",
                "best constant series coupling under condition (6) with the hold of a sampled loop, z^-1",
                rank=20,
                model="sampled-data",
                constant=True,
            ),
        ),
    ),
    rank=50,
)
