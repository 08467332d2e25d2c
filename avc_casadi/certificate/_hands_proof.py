"""L5 proved: what stands in place of a search where somebody asks for a proof.

A rigid device is proved by excluding zeros. For any other, a multiplier that proves rest (L7) proves this too: with
Re{M (1 + L)} > 0 and Re M > 0, 1 + t L has no zero on the unit circle for any t of [0, 1] and any hand, and without the
loop everything decays.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi.loop import linear_values
from avc_casadi.proof import HAND, ContactLaw, prove_hands, prove_rest
from avc_casadi.support import SILENT, Progress

if TYPE_CHECKING:
    from avc_casadi.certificate._certificate import LevelResult
    from avc_casadi.certificate._levels import Rows
    from avc_casadi.proof import HandsProof, Outcome, Rest


def proved_level(rows: Rows, checked: LevelResult, known: list[Rest], progress: Progress = SILENT) -> LevelResult:
    """Prove L5 or refute it, row by row, over every hand and every device of the ranges.

    Args:
        rows: the gains.
        checked: the level as the search left it.
        known: proofs of rest that were made already.
        progress: told of the rows.

    Returns:
        The level: not met where a row is refuted. Rows that stay open keep what the search said, and are named.
    """
    if checked.refused or not len(rows.b):
        return replace(checked, outcome="open")
    gains, inverse = np.unique(np.array([rows.b, rows.k, rows.contact]), axis=1, return_inverse=True)
    unique = prove_hands(rows.problem, *gains, progress=progress)
    at_rest = _at_rest(rows, unique, known, progress)
    index = inverse.ravel()
    proofs = [unique[row] for row in index]
    outcomes: list[Outcome] = ["proved" if row in at_rest else unique[row].outcome for row in index]
    still_open = {row for row, proof in enumerate(unique) if _open(proof)} - set(at_rest)
    counts = Counter(outcomes)
    refuted = np.array([outcome == "refuted" for outcome in outcomes])
    passed = checked.row_passed & ~(rows.spread(refuted.astype(np.float64), 0.0) > 0)
    missing = len(rows.present) - len(proofs)
    detail: dict[str, Any] = checked.detail | {
        "proof": {
            "proved": counts["proved"],
            "refuted": counts["refuted"],
            "open": counts["open"],
            "row_outcome": outcomes,
            "cells": sum(len(piece.cells) for proof in unique for piece in proof.pieces),
            "looked_at": sum(proof.looked_at for proof in unique) + sum(proof.cells for proof in at_rest.values()),
            "seconds": sum(proof.seconds for proof in unique) + sum(proof.seconds for proof in at_rest.values()),
            "first_open": next((unique[row].reason for row in index if row in still_open), None),
        },
        # One for each row of gains that is not another's.
        "proofs": [at_rest.get(row, proof).document() for row, proof in enumerate(unique)],
    }
    whole = counts["proved"] == len(proofs) and not missing
    if whole:
        how = "by the multipliers of L7" if at_rest else "interval arithmetic over the whole box"
        claim = (
            "Proved: each frozen row is linearly stable, with no friction, with every hand and every device of the"
            f" ranges ({how}); this says nothing of switching"
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


def _at_rest(rows: Rows, unique: list[HandsProof], known: list[Rest], progress: Progress) -> dict[int, Rest]:
    """Prove rows that are open by a multiplier that brings them to rest, clipped last; by number among the unique."""
    problem, found = rows.problem, {}
    box = {name: getattr(problem.hands, name) for name in HAND}
    for row, proof in enumerate(unique):
        if not _open(proof):
            continue
        gains = proof.gains
        b, k, contact = gains.damping_ns_per_m, gains.stiffness_n_per_m, gains.contact_damping_ns_per_m
        law = ContactLaw.of(problem, float(b[0]), float(k[0]), float(contact[0]))
        made = next((one for one in known if one.outcome == "proved" and one.law == law), None)
        rest = made or prove_rest(law, "clip-last", problem.device, box, orbits=False, progress=progress)
        if rest.outcome == "proved":
            found[row] = rest
    return found


def _open(proof: HandsProof) -> bool:
    return proof.outcome == "open"


def _told(proofs: list[HandsProof]) -> str:
    refuted = [proof for proof in proofs if proof.outcome == "refuted"]
    return f"Not met by {len(refuted)} of {len(proofs)} rows: {refuted[0].sentence()}"
