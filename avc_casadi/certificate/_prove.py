"""Level L7, asked for on demand: rest with every hand of the box, making and breaking contact."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi.certificate._certificate import TITLES, LevelResult
from avc_casadi.proof import ContactLaw, HeldDevice, Rest, prove_rest, same_gains, wall_gap
from avc_casadi.support import SILENT, Progress, plain, rows_text

if TYPE_CHECKING:
    from avc_casadi.certificate._certificate import Certificate, Level
    from avc_casadi.coupling import Coupling

_WORST_FIRST = ("refuted", "open", "proved")


def prove(coupling: Coupling, *, seed: int = 0, progress: Progress = SILENT) -> dict[Level, LevelResult]:
    """Prove what a certificate otherwise only samples; each level says proved, refuted or open.

    L7: the loop comes to rest with every hand of [hands], wherever the hand rests and from any state, making and
    breaking contact, without friction, at each row of the table that runs. Proofs and witnesses stand in its detail
    and can be read again (`avc_casadi.proof.Rest.from_document`).

    Args:
        coupling: what runs, with the problem that it runs for.
        seed: of hands that are drawn and of the search for orbits.
        progress: told of the rows.

    Example:
        >>> problem = avc.load_problem("soft")
        >>> prove(avc.Coupling.of(problem, avc.solve(problem, "static-tuned")))["L7"].outcome
        'open'
    """
    rows = coupling.table.rows
    contact = coupling.problem.coupling.contact
    found: list[Rest] = []
    for done, row in enumerate(rows):
        with progress.step(f"proof of rest, {done + 1} of {rows_text(len(rows))}"):
            found.append(_of_row(coupling, contact, row, seed, progress))
    return {"L7": _result(coupling, found)}


def with_proofs(certificate: Certificate, proofs: dict[Level, LevelResult]) -> Certificate:
    """Return a certificate with further levels."""
    return replace(certificate, levels=certificate.levels | proofs)
