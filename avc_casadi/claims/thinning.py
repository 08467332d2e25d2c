"""Fewer rows for the same perceived impedance: the thinning of a table, judged in its problem."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray, IndexArray
from avc_casadi.claims.stability.scope import scope_slack
from avc_casadi.model.gains import GainTable, interpolate, single_ln
from avc_casadi.model.thinning import Deviation, thinned_rows
from avc_casadi.paper.loop import loop_at

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem


@dataclass(frozen=True)
class ReducedRows:
    """Some rows of a schedule, with the interpolation error at the others.

    Attributes:
        table: the kept rows.
        kept: their indices among all rows, shape (m,).
        error: largest deviation at the dropped rows: |Z - Z_h|/|Z_h| of the perceived impedance where a problem was
            given, otherwise the largest relative deviation of b, k or b_p.
        single_error: the same for rows and arithmetic in single precision, at all rows.
        scope_slack: smallest slack of the problem's scope at the dropped rows, interpolated: N.s/m, or spectral radius
            for scope hands; not a number without a problem, infinite where nothing is dropped. A deficit can be added
            beforehand to `margin_ns_per_m`.
    """

    table: GainTable
    kept: IndexArray
    error: float
    single_error: float
    scope_slack: float


def reduce_rows(
    table: GainTable, problem: Problem | None = None, *, rows: int | None = None, tolerance: float | None = None
) -> ReducedRows:
    """Return rows chosen by `thinned_rows`, with the interpolation error at the others.

    With a problem, a pair of neighbours is admitted only if Re Z_h stays at or above the margin at the rows between,
    where the rows themselves do.

    Args:
        table: the rows to choose among.
        problem: measure the error of Z_h; without it, of the gains.
        rows: at most so many, with the smallest largest error; or
        tolerance: the fewest rows with at most this largest error, and of those the most accurate.

    Raises:
        InputError: neither or both of ``rows`` and ``tolerance``, or no subset suffices.
    """
    deviation = Deviation(table.rows) if problem is None else _OfImpedance(table.rows, problem)
    kept = thinned_rows(deviation, rows=rows, tolerance=tolerance)
    whole = deviation.table
    every, dropped = np.arange(len(whole)), np.setdiff1d(np.arange(len(whole)), kept)
    single = interpolate(whole[kept].astype(np.float32), whole[:, 0], single_ln).astype(np.float64)
    after = interpolate(whole[kept], whole[dropped, 0])
    slack = np.nan
    if problem is not None:
        slack = float(scope_slack(problem, whole[dropped, 0], *after.T).slack.min(initial=np.inf))
    return ReducedRows(
        table=GainTable(whole[kept]),
        kept=kept,
        error=float(deviation.of(dropped, after).max(initial=0.0)),
        single_error=float(deviation.of(every, single).max(initial=0.0)),
        scope_slack=slack,
    )


class _OfImpedance(Deviation):
    """Deviation of the perceived impedance of other gains from that of a row."""

    linear = False

    def __init__(self, table: FloatArray, problem: Problem) -> None:
        super().__init__(table)
        self._loop = loop_at(problem, table[:, 0])
        self._own = np.asarray(self._loop.perceived(*table.T[1:]))
        self._least = np.minimum(problem.stability.margin_ns_per_m, self._own.real)

    def of(self, row: IndexArray, gains: FloatArray) -> FloatArray:
        z, own = self._perceived(row, gains), self._own[row]
        return np.asarray(np.abs(z - own) / np.where(own == 0, 1.0, np.abs(own)))

    def admitted(self, row: IndexArray, gains: FloatArray) -> BoolArray:
        return np.asarray(self._perceived(row, gains).real >= self._least[row])

    def _perceived(self, row: IndexArray, gains: FloatArray) -> ComplexArray:
        return np.asarray(self._loop.rows(row).perceived(*np.moveaxis(gains, -1, 0)))
