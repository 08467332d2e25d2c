"""Laws found on other devices, as initial guesses: one of them often stabilises a wall at once.

The table (`known_laws.csv`) holds the parameters of laws relative to
the default initial guess, hence dimensionless: a law of one device often stabilises another one, or nearly. No claim
rests on it: a law from the table is judged like any other, and without it a search starts from the default guess.
"""

from __future__ import annotations

import csv
import math
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.design.robust.cma_continuation import MOST_LAWS, Step, laws_of_all, settling
from avc_casadi.design.robust.goal import costs_of
from avc_casadi.design.robust.lqg import Space
from avc_casadi.design.robust.uncertainty_set import Loops, softened
from avc_casadi.loops.wall import stiffness_at_rest

if TYPE_CHECKING:
    from collections.abc import Sequence

    from avc_casadi._util.arrays import FloatArray
    from avc_casadi.design.robust.cma_continuation import ResidualSpeedAt
    from avc_casadi.model.problem import Problem

_TABLE = Path(__file__).with_name("known_laws.csv")
# Number of laws judged with all loops and simulated at once.
_AT_ONCE = 20
# Stiffness ratio of the softer walls that are tried, and their number.
_RUNG, _RUNGS = 1.4, 20


@cache
def _rows() -> tuple[dict[str, str], ...]:
    if not _TABLE.is_file():
        return ()
    with _TABLE.open(encoding="utf-8", newline="") as text:
        return tuple(csv.DictReader(text))


def known_points(space: Space) -> FloatArray:
    """Return the known laws, and the initial guesses, as points in the search space of a device.

    Returns:
        Logarithms of the parameters, shape (laws, parameters).
    """
    names = [knob.name for knob in space.knobs]
    rows = [[float(row[name]) for name in names] for row in _rows() if _told(row) == set(names)]
    points = np.concatenate([space.starts, space.starts[0] + np.reshape(rows, (len(rows), len(names)))])
    return np.asarray(np.clip(points, *space.bounds))


def _told(row: dict[str, str]) -> set[str]:
    return {name for name, value in row.items() if value}


class KnownLaws:
    """The known laws before the walls of one problem.

    Args:
        problem: device with its ranges, hands and wall.
        residual_speed_at: as for `continuation`.
        more: laws known beside those of the table, logarithms of their parameters.
    """

    def __init__(
        self, problem: Problem, residual_speed_at: ResidualSpeedAt | None = None, more: Sequence[FloatArray] = ()
    ) -> None:
        self._problem, self._residual_speed_at = problem, residual_speed_at
        self._space, self._loops = Space(problem.device, problem.hands), Loops.of(problem)
        self._points = np.array([*more, *known_points(self._space)])

    def before(self, stiffness_n_per_m: float) -> Step | None:
        """Return the known laws that stabilise a wall, by increasing distance; None where no known one does.

        Args:
            stiffness_n_per_m: static, of the wall.
        """
        space, loops = self._space, self._loops
        gains, rendering = softened(self._problem, stiffness_n_per_m)
        stiffness = stiffness_at_rest(rendering)
        laws = space.laws(self._points, stiffness)
        defined = np.flatnonzero(np.isfinite(laws.innovation).all(axis=1))
        if len(defined) == 0:
            return None
        one, laws = space.one_of(laws, int(defined[0])), laws.pick(defined)
        costs = costs_of(laws, rendering, loops.hardest(one, rendering))
        holding = [row for row, cost in enumerate(costs) if cost.holds]
        holding.sort(key=lambda row: costs[row].distance)
        asked = None if self._residual_speed_at is None else self._residual_speed_at(gains, one)
        for first in range(0, len(holding), _AT_ONCE):
            rows = np.array(holding[first : first + _AT_ONCE])
            whole = costs_of(laws.pick(rows), rendering, loops)
            stable = [int(row) for row, cost in zip(rows, whole, strict=True) if cost.holds]
            settled = settling(space, laws, stable, asked)
            found = laws_of_all(space, loops, rendering, list(self._points[defined[settled]]))
            best = sorted((one for one in found if one.cost.holds), key=lambda one: one.cost.distance)
            if best:
                return Step(gains, stiffness_n_per_m, tuple(best[:MOST_LAWS]))
        return None

    def softer(self, softest_n_per_m: float, wanted_n_per_m: float) -> Step | None:
        """Return the stiffest wall, softer than a wanted one, that a known law stabilises; None where there is none.

        The walls that are tried do not depend on the wanted one, so that a stiffer wanted wall brings none softer.

        Args:
            softest_n_per_m: static stiffness of the softest wall.
            wanted_n_per_m: of the wanted one.
        """
        below = min(math.ceil(math.log(wanted_n_per_m / softest_n_per_m, _RUNG)), _RUNGS)
        walls = (softest_n_per_m * _RUNG**place for place in reversed(range(below)))
        return next((step for wall in walls if (step := self.before(wall)) is not None), None)
