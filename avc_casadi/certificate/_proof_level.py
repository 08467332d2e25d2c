"""A level that is a proof: what its result holds in common."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi.certificate._certificate import LevelResult

if TYPE_CHECKING:
    from avc_casadi.certificate._certificate import Level
    from avc_casadi.proof import Outcome
    from avc_casadi.support import BoolArray


def proof_level(
    level: Level, outcome: Outcome, claim: str, row_passed: BoolArray, detail: dict[str, Any], worst: int = 0
) -> LevelResult:
    """Return a level of rows of the table that runs; a proof has no margin.

    Args:
        level: which.
        outcome: proved, refuted or open.
        claim: one sentence.
        row_passed: which rows are proved, shape (n,).
        detail: the proofs among it.
        worst: number of the row that the claim speaks of.
    """
    nothing = np.full(len(row_passed), np.nan)
    return LevelResult(
        level=level,
        passed=bool(row_passed.all()),
        margin_ns_per_m=math.nan,
        frequency_hz=math.nan,
        model="sampled-data",
        claim=claim,
        tolerance_ns_per_m=0.0,
        row=worst,
        row_passed=row_passed,
        row_margin_ns_per_m=nothing,
        row_frequency_hz=nothing,
        detail=detail,
        outcome=outcome,
    )
