"""The levels that are there only where proofs are asked for: rest (L7), gains that change (L8), ripple (L9)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.certificate._changes_proof import changes_level
from avc_casadi.certificate._proof_level import proof_level
from avc_casadi.certificate._rest_proof import rest_level, rests
from avc_casadi.certificate._ripple_bound import ripple_level
from avc_casadi.coupling import Coupling, GainSchedule
from avc_casadi.support import SILENT, Progress

if TYPE_CHECKING:
    from avc_casadi.certificate._certificate import Level, LevelResult
    from avc_casadi.problem import Problem
    from avc_casadi.proof import Rest

_LEVELS: tuple[Level, ...] = ("L7", "L8", "L9")


def on_demand(
    problem: Problem, gains: GainSchedule | Coupling, *, seed: int = 0, progress: Progress = SILENT
) -> tuple[dict[Level, LevelResult], list[Rest]]:
    """Prove, refute or leave open L7 to L9 of the table that runs, with all that runs beside it.

    A device let go has no place of rest, and is no part of them.

    Args:
        problem: what is judged against.
        gains: a table, or the coupling with it.
        seed: of hands that are drawn and of the search for orbits.
        progress: told of the rows.

    Returns:
        The levels, and what is known of the rest of each row of the table that runs.
    """
    if isinstance(gains, GainSchedule):
        if not gains.usable.any():
            none = np.zeros(gains.rows, dtype=bool)
            return {level: proof_level(level, "open", "no row has gains", none, {}) for level in _LEVELS}, []
        coupling = Coupling.of(problem, gains)
    else:
        coupling = gains.on(problem)
    found = rests(coupling, seed, progress)
    with progress.step("patterns of changing gains"):
        changing = changes_level(coupling, progress)
    with progress.step("bound of the ripple"):
        ripple = ripple_level(coupling, found, progress)
    return {"L7": rest_level(coupling, found, progress), "L8": changing, "L9": ripple}, found
