"""L8: rows of the table that runs may follow one another in kept contact."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._errors import MissingExtraError
from avc_casadi.certificate._proof_level import proof_level
from avc_casadi.proof import MOST_CELLS, Changing, Order, Outcome, gain_corners, prove_changes, rows_and_between
from avc_casadi.support import SILENT, FloatArray, Progress

if TYPE_CHECKING:
    from avc_casadi.certificate._certificate import LevelResult
    from avc_casadi.coupling import Coupling

# Changes of rows times cells of hands: about a minute.
_MOST_CHANGES = 2000


def changes_level(coupling: Coupling, progress: Progress = SILENT) -> LevelResult:
    """Judge gains that change: anywhere in the box of the table, or row by row; what runs beside them is told.

    Args:
        coupling: what runs.
        progress: told of corners and cells.
    """
    table, runtime = coupling.table, coupling.runtime

    def told(outcome: Outcome, claim: str, detail: dict[str, Any]) -> LevelResult:
        return proof_level("L8", outcome, claim, np.full(len(table), outcome == "proved"), detail)

    if table.constant:
        return told("proved", "no gains change", {})
    if runtime.state_feedback is not None or runtime.observer_mass_kg is not None or runtime.guard is not None:
        return told("open", "gains that change beside an observer or a guard are not judged", {})
    gains = coupling.table.gains
    whole = _order(coupling, gain_corners(gains), "any", progress)
    if whole.outcome == "proved":
        found = [whole]
        claim = (
            "proved: the gains may change at any speed, each for itself, anywhere within the box that the table spans, "
            f"with every hand of the box, in kept contact ({len(whole.cells)} cells)"
        )
    else:
        found, claim = _rows(coupling, gains, progress)
    if coupling.contact == "gated":
        claim += "; behind the gate the same in kept contact"
    claim += "; the anchor that pays for a change of stiffness and what happens at the surface are not covered"
    return told(found[0].outcome, claim, {"proofs": [one.document() for one in found]})


def _rows(coupling: Coupling, gains: FloatArray, progress: Progress) -> tuple[list[Changing], str]:
    """Judge the rows in any order, with all that is between neighbours; failing that, one row a sample."""
    pattern = prove_changes(coupling.problem, gains, most_cells=0, progress=progress)
    if pattern.outcome == "open":
        between = _order(coupling, rows_and_between(gains), "any", progress)
        if between.outcome == "proved":
            return [between], f"proved: {between.sentence}; the way from each row to the next is covered"
    stepwise = _order(coupling, gains, "neighbours", progress)
    found = [pattern, stepwise]
    claim = "; ".join(f"{one.outcome}: {one.sentence}" for one in found)
    return found, f"{claim}; gains between rows are not covered"


def _order(coupling: Coupling, gains: FloatArray, order: Order, progress: Progress) -> Changing:
    """Look for a proof; a pattern refutes it only where the gains are rows of the table."""
    problem, rows = coupling.problem, gains.shape[1]
    changes = rows**2 if order == "any" else 3 * rows - 2
    try:
        cells = min(MOST_CELLS, _MOST_CHANGES // changes)
        return prove_changes(problem, gains, order, most_cells=cells, progress=progress)
    except MissingExtraError as missing:
        found = prove_changes(problem, gains, order, most_cells=0, progress=progress)
        return replace(found, sentence=f"{found.sentence}; {missing}")
