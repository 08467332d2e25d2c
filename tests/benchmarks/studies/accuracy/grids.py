"""A grid of n frequencies in place of the exact test of Re Z_h >= margin at all frequencies: what it does not see."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.claims.passivity.sampled_loop import SampledLoop
from avc_casadi.claims.passivity.worst_frequency import worst_margin
from avc_casadi.model.corners import margin_over_range
from avc_casadi.paper.exact import exact_gains
from avc_casadi.paper.loop import loop_at

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem

POINTS = (5, 10, 20, 50, 100, 200, 500, 1000, 2000)
_GAIN_ROWS = 50
_LAST = 0.999


@dataclass(frozen=True)
class GridMiss:
    """One grid.

    Attributes:
        points: its frequencies, equally spaced over ln(frequency) from the problem's lowest to 0.999 of Nyquist.
        missed_violation: largest difference between the smallest Re Z_h on the grid and over all frequencies, N.s/m,
            among frozen gains that violate the margin somewhere; 0 where none does.
        missed_rows: how many of these gains the grid calls passive.
        rows: how many gains violate the margin somewhere.
    """

    points: int
    missed_violation: float
    missed_rows: int
    rows: int


def grid_misses(problem: Problem, points: tuple[int, ...] = POINTS) -> list[GridMiss]:
    """Judge frozen gains, those of the optimum at 50 frequencies, by grids and by the exact root test."""
    frequency = problem.frequencies_hz()
    chosen = frequency[np.unique(np.linspace(0, len(frequency) - 1, _GAIN_ROWS).round().astype(int))]
    gains = np.array(exact_gains(problem, loop_at(problem, chosen)))
    gains = gains[:, np.isfinite(gains).all(axis=0)]
    if not gains.size:
        return []
    margin = margin_over_range(problem)
    truth = worst_margin(SampledLoop.of(problem), *gains)
    violating = truth.margin_ns_per_m < margin - truth.tolerance_ns_per_m
    highest = _LAST * 0.5 / problem.device.sample_time_s
    found = []
    for count in points:
        grid = loop_at(problem, np.geomspace(min(float(frequency.min()), highest), highest, count))
        seen = np.array([grid.perceived(*row).real.min() for row in gains.T])
        missed = np.where(violating, seen - truth.margin_ns_per_m, 0.0)
        unseen = violating & (seen >= margin)
        found.append(GridMiss(count, float(missed.max(initial=0.0)), int(unseen.sum()), int(violating.sum())))
    return found
