"""Laws found on other devices, as initial guesses: one of them often stabilises a wall at once.

The table (`known_laws.csv`, made by tests/benchmarks/law_starts.py) holds the parameters of laws relative to
the default initial guess, hence dimensionless: a law of one device often stabilises another one, or nearly. No claim
rests on it: a law from the table is judged like any other, and without it a search starts from the default guess.
"""

from __future__ import annotations

import csv
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.claims.stability.state_feedback import stiffness_at_rest
from avc_casadi.design.robust.cma_continuation import MOST_LAWS, Step, laws_of_all, settling
from avc_casadi.design.robust.goal import costs_of
from avc_casadi.design.robust.lqg import Space
from avc_casadi.design.robust.uncertainty_set import Loops, softened

if TYPE_CHECKING:
    from avc_casadi._util.arrays import FloatArray
    from avc_casadi.design.robust.cma_continuation import ResidualSpeedAt
    from avc_casadi.model.problem import Problem

_TABLE = Path(__file__).with_name("known_laws.csv")
# Number of the table's best laws that are judged with all loops and simulated.
_TRIED = 20


@cache
def _rows() -> tuple[dict[str, str], ...]:
    if not _TABLE.is_file():
        return ()
    with _TABLE.open(encoding="utf-8", newline="") as text:
        return tuple(csv.DictReader(text))


def known_points(space: Space) -> FloatArray:
    """Return the known laws as points in the search space of a device, logarithms, shape (laws, parameters)."""
    names = [knob.name for knob in space.knobs]
    rows = [[float(row[name]) for name in names] for row in _rows() if _told(row) == set(names)]
    points = space.starts[0] + np.reshape(rows, (len(rows), len(names)))
    return np.asarray(np.clip(points, *space.bounds))


def _told(row: dict[str, str]) -> set[str]:
    return {name for name, value in row.items() if value}


def from_known(
    problem: Problem, stiffness_n_per_m: float, residual_speed_at: ResidualSpeedAt | None = None
) -> Step | None:
    """Return the known laws that stabilise a wall.

    Args:
        problem: device with its ranges, hands and wall.
        stiffness_n_per_m: static, of the wall.
        residual_speed_at: as for `continuation`.

    Returns:
        The wall with laws that stabilise it, by increasing mismatch; None where no known one does.
    """
    space = Space(problem.device, problem.hands)
    points = known_points(space)
    if len(points) == 0:
        return None
    gains, rendering = softened(problem, stiffness_n_per_m)
    stiffness = stiffness_at_rest(rendering)
    laws = space.laws(points, stiffness)
    defined = np.flatnonzero(np.isfinite(laws.innovation).all(axis=1)).tolist()
    if not defined:
        return None
    loops = Loops.of(problem)
    likely = costs_of(laws, rendering, loops.hardest(space.one_of(laws, defined[0]), rendering))
    order = np.argsort([cost.total for cost in likely], kind="stable")[:_TRIED]
    laws, costs = laws.pick(order), costs_of(laws.pick(order), rendering, loops)
    holding = [row for row, cost in enumerate(costs) if cost.holds]
    if not holding:
        return None
    asked = None if residual_speed_at is None else residual_speed_at(gains, space.one_of(laws, holding[0]))
    settled = settling(space, laws, holding, asked)
    found = laws_of_all(space, loops, rendering, [points[order[row]] for row in settled])
    best = sorted((one for one in found if one.cost.holds), key=lambda one: one.cost.distance)
    return Step(gains, stiffness_n_per_m, tuple(best[:MOST_LAWS])) if best else None
