"""L5 proved: what stands in place of a search where somebody asks for a proof."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi.loop import linear_values
from avc_casadi.proof import prove_hands
from avc_casadi.support import SILENT, Progress

if TYPE_CHECKING:
    from avc_casadi.certificate._certificate import LevelResult
    from avc_casadi.certificate._levels import Rows
    from avc_casadi.proof import HandsProof, Outcome


def proved_level(rows: Rows, checked: LevelResult, progress: Progress = SILENT) -> LevelResult:
    """Prove L5 or refute it, row by row, over every hand and every device of the ranges.

    Args:
        rows: the gains.
        checked: the level as the search left it.
        progress: told of the rows.

    Returns:
        The level: not met where a row is refuted. Rows that stay open keep what the search said, and are named.
    """
    if checked.refused or not len(rows.b):
        return replace(checked, outcome="open")
    gains, inverse = np.unique(np.array([rows.b, rows.k, rows.contact]), axis=1, return_inverse=True)
    unique = prove_hands(rows.problem, *gains, progress=progress)
    proofs = [unique[index] for index in inverse.ravel()]
    counts = Counter(proof.outcome for proof in proofs)
    refuted = np.array([proof.outcome == "refuted" for proof in proofs])
    passed = checked.row_passed & ~(rows.spread(refuted.astype(np.float64), 0.0) > 0)
    missing = len(rows.present) - len(proofs)
    detail: dict[str, Any] = checked.detail | {
        "proof": {
            "proved": counts["proved"],
            "refuted": counts["refuted"],
            "open": counts["open"],
            "row_outcome": [proof.outcome for proof in proofs],
            "cells": sum(len(piece.cells) for proof in unique for piece in proof.pieces),
            "looked_at": sum(proof.looked_at for proof in unique),
            "seconds": sum(proof.seconds for proof in unique),
            "first_open": _first_open(proofs),
        },
        # One for each row of gains that is not another's.
        "proofs": [proof.document() for proof in unique],
    }
    whole = counts["proved"] == len(proofs) and not missing
    if whole:
        claim = (
            "Proved: each frozen row is linearly stable, with no friction, with every hand and every device of the"
            " ranges (interval arithmetic over the whole box); this says nothing of switching"
        )
    elif counts["refuted"] or missing:
        claim = checked.claim if not checked.passed else _told(proofs)
    else:
        claim = f"{checked.claim}; proof: {counts['proved']} of {len(proofs)} rows proved, {counts['open']} open"
    worst = max((proof for proof in proofs if proof.outcome == "refuted"), key=lambda one: one.radius, default=None)
    if checked.passed and worst is not None and worst.device is not None:
        detail |= {"worst_hand": worst.hand, "worst_device": linear_values(worst.device)}
    passed_whole = bool(passed.all()) and checked.passed
    outcome: Outcome = "refuted" if counts["refuted"] else "proved" if whole else "open"
    return replace(checked, passed=passed_whole, row_passed=passed, claim=claim, detail=detail, outcome=outcome)


def not_proved(checked: LevelResult, why: str) -> LevelResult:
    """Say of a level why it is not among what can be proved; what was found without a proof stands beside it."""
    return replace(checked, claim=f"{checked.claim}; not proved: {why}", outcome="open")


def _told(proofs: list[HandsProof]) -> str:
    refuted = [proof for proof in proofs if proof.outcome == "refuted"]
    return f"Not met by {len(refuted)} of {len(proofs)} rows: {refuted[0].sentence()}"


def _first_open(proofs: list[HandsProof]) -> str | None:
    return next((proof.reason for proof in proofs if proof.outcome == "open"), None)
