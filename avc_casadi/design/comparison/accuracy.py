"""What accuracy costs in time: methods and solvers over tolerances against the true optimum of each frequency."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.files.problem_file import require_wall
from avc_casadi.model.problem import Problem
from avc_casadi.model.problem_ranges import margin_over_range
from avc_casadi.paper.closed_form import project
from avc_casadi.paper.direct import EXCESS_TOLERANCE
from avc_casadi.paper.equations import ImpedanceLoop, coupling_gains, loop_at
from avc_casadi.paper.exact import exact_gains
from avc_casadi.paper.nlp import optimality
from avc_casadi.paper.nlp_gains import nlp_gains
from avc_casadi.paper.nlp_solver import DEFAULT_SOLVER, DEFAULT_TOLERANCE, SOLVERS, nlp_solvers
from avc_casadi.paper.rows import GainArrays, admissible

TOLERANCES = (1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
OPTIMAL = 1e-8
"""Excess error, relative to |Z_h_ds|, below which a row counts as truly optimal."""


_TIMED_ROWS = 25
"""Frequencies at which each of CasADi's solvers is timed."""
_LEAST_SECONDS = 0.5
"""Time of all runs after which no further one is timed."""
_MOST_RUNS = 5


@dataclass(frozen=True)
class SolverCost:
    """One point of the work-precision diagram.

    Attributes:
        method: name of the method.
        solver: name of its solver; None where it has none.
        tolerance: requested relative tolerance; None where it has none.
        frequencies: number of frequencies solved.
        seconds_per_frequency: median time of a run, over the frequencies, s.
        excess_error: median of the magnitude error less the optimum's, over |Z_h_ds|; None where no row is known.
        largest_excess_error: the largest.
        optimal_share: share of the feasible rows whose excess is below `OPTIMAL`.
        solved_share: share of the feasible rows that pass the checks of `direct`.
        default: whether these are the solver and tolerance of `direct` without options.
    """

    method: str
    solver: str | None
    tolerance: float | None
    frequencies: int
    seconds_per_frequency: float
    excess_error: float | None
    largest_excess_error: float | None
    optimal_share: float
    solved_share: float
    default: bool = False


def fastest(costs: Sequence[SolverCost]) -> list[bool]:
    """Return, for each method and solver, whether none other is both faster and nearer to the optimum.

    Near counts at the frequency of its largest error.
    """
    points = [
        (cost.seconds_per_frequency, np.inf if cost.largest_excess_error is None else cost.largest_excess_error)
        for cost in costs
    ]

    def beaten(seconds: float, error: float) -> bool:
        return any(s <= seconds and e <= error and (s, e) != (seconds, error) for s, e in points)

    return [bool(np.isfinite(error)) and not beaten(seconds, error) for seconds, error in points]


@dataclass(frozen=True)
class Accuracy:
    """What `avc accuracy` finds: time and error of each solver.

    Attributes:
        problem: name of the problem.
        costs: one for each method, solver and tolerance.
    """

    problem: str
    costs: tuple[SolverCost, ...]

    @property
    def fastest(self) -> list[bool]:
        """Whether no other is both faster and nearer to the optimum, for each."""
        return fastest(self.costs)

    def document(self) -> dict[str, Any]:
        """Return the document of `avc accuracy`: JSON values only."""
        solvers = [asdict(cost) | {"pareto": best} for cost, best in zip(self.costs, self.fastest, strict=True)]
        return {"problem": self.problem, "reference": "method exact", "solvers": solvers}


def solver_costs(
    problem: Problem,
    progress: Progress = SILENT,
    *,
    tolerances: Sequence[float] = TOLERANCES,
    solvers: Sequence[str] = tuple(SOLVERS),
) -> list[SolverCost]:
    """Time every method and solver.

    Args:
        problem: the problem, at whose frequencies they are timed.
        progress: reported over methods and solvers.
        tolerances: relative tolerances requested of CasADi's solvers.
        solvers: names of CasADi's solvers.
    """
    loop = loop_at(require_wall(problem), problem.frequencies_hz())
    reference = np.abs(np.abs(loop.perceived(*exact_gains(problem, loop))) - np.abs(loop.target))
    default = (DEFAULT_SOLVER, DEFAULT_TOLERANCE)
    combinations = [(name, tolerance) for name in solvers for tolerance in tolerances]
    choices = [default, *(choice for choice in combinations if choice != default)]
    costs = [
        SolverCost("closed-form", None, None, **_cost(problem, loop, reference, partial(_closed_form, problem, loop))),
        SolverCost("exact", None, None, **_cost(problem, loop, reference, partial(exact_gains, problem, loop))),
    ]
    # CasADi's solvers are timed at a few frequencies; `exact` and the closed form run at all.
    timed = np.unique(np.linspace(0, len(reference) - 1, _TIMED_ROWS).round().astype(int))
    timed_loop = loop.rows(timed)
    timed_reference = reference[timed]
    for solver, tolerance in choices:
        nlp_solvers.cache_clear()
        cost = _cost(problem, timed_loop, timed_reference, partial(nlp_gains, problem, timed_loop, solver, tolerance))
        costs.append(SolverCost("direct", solver, tolerance, **cost, default=(solver, tolerance) == default))
        progress.advance(len(costs), len(choices) + 2, "methods and solvers")
    return costs


def _closed_form(problem: Problem, loop: ImpedanceLoop) -> GainArrays:
    """Return the gains of the closed form, each (n,); not a number outside the gain box."""
    b, k = coupling_gains(loop.angle, project(problem).coupling)
    inside = admissible(problem, b, k, np.zeros(b.shape))
    return np.where(inside, b, np.nan), np.where(inside, k, np.nan), np.where(inside, 0.0, np.nan)


def _cost(
    problem: Problem, loop: ImpedanceLoop, reference: FloatArray, run: Callable[[], GainArrays]
) -> dict[str, Any]:
    """Return the fields of a `SolverCost` of a method: median seconds a frequency, and excess errors of its gains.

    ``run`` computes the gains; ``reference`` is the least magnitude error at each frequency, N.s/m.
    """
    rows = len(reference)
    gains = run()
    # The first run builds the solver; those after it are timed.
    seconds: list[float] = []
    while len(seconds) < 1 or (len(seconds) < _MOST_RUNS and sum(seconds) < _LEAST_SECONDS):
        started = time.perf_counter()
        run()
        seconds.append(time.perf_counter() - started)
    excess, solved = _quality(problem, loop, reference, gains)
    possible = np.isfinite(reference)
    known = excess[possible & np.isfinite(excess)]
    count = max(int(possible.sum()), 1)
    return {
        "frequencies": rows,
        "seconds_per_frequency": statistics.median(seconds) / rows,
        "excess_error": float(np.median(known)) if known.size else None,
        "largest_excess_error": float(known.max()) if known.size else None,
        "optimal_share": float(np.count_nonzero(known <= OPTIMAL)) / count,
        "solved_share": float(np.count_nonzero(solved & possible)) / count,
    }


def _quality(
    problem: Problem, loop: ImpedanceLoop, reference: FloatArray, gains: GainArrays
) -> tuple[FloatArray, BoolArray]:
    """Return the excess magnitude error of each row, over |Z_h_ds|, and whether it passes the checks of `direct`.

    ``reference`` is the least magnitude error |(|Z_h| - |Z_h_ds|)|, N.s/m. The excess is not below the rounding of
    |Z_h_ds|, and not a number where Re Z_h is below the margin.
    """
    radius = np.abs(loop.target)
    scale = np.where(radius == 0, 1.0, radius)
    with np.errstate(invalid="ignore"):
        z = loop.perceived(*gains)
        error = np.where(z.real >= margin_over_range(problem), np.abs(np.abs(z) - radius), np.nan)
        excess = np.maximum((error - reference) / scale, np.finfo(np.float64).eps)
        solved: BoolArray = optimality(problem, loop, gains).acceptable() & (excess <= EXCESS_TOLERANCE)
    return excess, solved
