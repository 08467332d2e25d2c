"""A gain table of n rows: how far |Z_h| between the rows is from what solving there would give."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.paper.exact import exact_gains
from avc_casadi.paper.loop import loop_at
from studies.accuracy.interpolations import INTERPOLATIONS

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem

ROWS = (10, 20, 50, 100, 200, 500, 1000)
_PROBES = 4001
PRECISIONS: dict[str, Any] = {"float64": np.float64, "float32": np.float32}


@dataclass(frozen=True)
class TableError:
    """One table.

    Attributes:
        rows: its rows, equally spaced over ln(frequency).
        interpolation: linear, pchip or nearest, over ln(frequency).
        precision: float64, or the device's float32.
        max_error: largest ||Z_h| between rows - |Z_h| solved there|/|Z_h_ds|.
        median_error: the median of the same.
        worst_real_part_ns_per_m: smallest Re Z_h between the rows; below the margin, (12) holds at the rows only.
    """

    rows: int
    interpolation: str
    precision: str
    max_error: float
    median_error: float
    worst_real_part_ns_per_m: float


def table_errors(problem: Problem, rows: tuple[int, ...] = ROWS) -> list[TableError]:
    """Compare tables of the optimum with the optimum itself, at 4001 frequencies between the problem's ends.

    Returns:
        One entry a table; none where the problem has a single frequency or no frequency with gains.
    """
    frequency = problem.frequencies_hz()
    low, high = float(frequency.min()), float(frequency.max())
    if low == high:
        return []
    at = np.geomspace(low, high, _PROBES)
    loop = loop_at(problem, at)
    solved, radius = np.abs(loop.perceived(*exact_gains(problem, loop))), np.abs(loop.target)
    found = []
    for count in rows:
        table = _table(problem, np.geomspace(low, high, count))
        if not len(table):
            continue
        for name, interpolation in INTERPOLATIONS.items():
            for precision, kind in PRECISIONS.items():
                gains = interpolation(table.astype(kind), at.astype(kind)).astype(np.float64)
                z = loop.perceived(*gains.T)
                with np.errstate(invalid="ignore", divide="ignore"):
                    error = np.abs(np.abs(z) - solved) / radius
                error = error[np.isfinite(error)]
                if error.size:
                    worst = float(z.real.min())
                    found.append(TableError(count, name, precision, float(error.max()), float(np.median(error)), worst))
    return found


def _table(problem: Problem, frequency_hz: FloatArray) -> FloatArray:
    """Rows with gains, shape (n, 4): frequency, b, k, b_p."""
    rows = np.stack((frequency_hz, *exact_gains(problem, loop_at(problem, frequency_hz))), axis=1)
    kept: FloatArray = rows[np.isfinite(rows).all(axis=1)]
    return kept
