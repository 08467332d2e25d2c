"""L8: rows of the table that runs may follow one another in kept contact."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._errors import MissingExtraError
from avc_casadi.certificate._proof_level import proof_level
from avc_casadi.proof import MOST_CELLS, Changing, Order, Outcome, prove_changes
from avc_casadi.support import SILENT, Progress

if TYPE_CHECKING:
    from avc_casadi.certificate._certificate import LevelResult
    from avc_casadi.coupling import Coupling

# Changes of rows times cells of hands: about a minute.
_MOST_CHANGES = 2000


def changes_level(coupling: Coupling, progress: Progress = SILENT) -> LevelResult:
    """Judge rows that follow one another; what runs beside the gains, and gains between rows, are told, not judged.

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
    any_order = _order(coupling, "any", progress)
    found = [any_order]
    if any_order.outcome != "proved":
        found.append(_order(coupling, "neighbours", progress))
    claim = "; ".join(f"{one.outcome}: {one.sentence}" for one in found)
    if coupling.contact == "gated":
        claim += "; behind the gate the same in kept contact"
    claim += "; gains between rows and what happens at the surface are not covered"
    return told(any_order.outcome, claim, {"proofs": [one.document() for one in found]})


def _order(coupling: Coupling, order: Order, progress: Progress) -> Changing:
    problem, gains = coupling.problem, coupling.table.gains
    rows = len(coupling.table)
    changes = rows**2 if order == "any" else 3 * rows - 2
    try:
        cells = min(MOST_CELLS, _MOST_CHANGES // changes)
        return prove_changes(problem, gains, order, most_cells=cells, progress=progress)
    except MissingExtraError as missing:
        found = prove_changes(problem, gains, order, most_cells=0, progress=progress)
        return replace(found, sentence=f"{found.sentence}; {missing}")
