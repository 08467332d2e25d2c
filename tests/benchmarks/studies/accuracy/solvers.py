"""Work against precision: what each method and solver costs a frequency, and how near to the optimum it comes."""

from __future__ import annotations

import importlib.util
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi.model.corners import margin_over_range
from avc_casadi.paper.backends import DEFAULT_SOLVER, DEFAULT_TOLERANCE, SOLVERS
from avc_casadi.paper.closed_form import project
from avc_casadi.paper.cross_check import EXCESS_TOLERANCE
from avc_casadi.paper.equations import coupling_gains
from avc_casadi.paper.exact import exact_gains
from avc_casadi.paper.loop import Loop, loop_at
from avc_casadi.paper.nlp import optimality
from avc_casadi.paper.nlp_gains import nlp_gains
from avc_casadi.paper.nlp_solver import nlp_solvers
from avc_casadi.paper.rows import GainArrays, admissible

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem

TOLERANCES = (1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
OPTIMAL = 1e-8
"""Excess error, relative to |Z_h_ds|, below which a row counts as truly optimal."""
_STEADY_RUNS = 5
_STEADY_SECONDS = 0.5
_BACKEND_FREQUENCIES = 25
"""Frequencies on which CasADi's solvers are timed; `exact` and the closed form run on all."""


@dataclass(frozen=True)
class SolverCost:
    """One point of the work-precision diagram.

    Attributes:
        method: closed-form, exact or direct.
        solver: of `direct`.
        tolerance: asked of a CasADi solver.
        frequencies: how many frequencies were solved.
        seconds_first: a frequency, first run with all that is built.
        seconds_per_frequency: a frequency, median of the later runs.
        excess_error: median over the frequencies with admissible gains of the magnitude error beyond the reference's,
            relative to |Z_h_ds|; None where the method returns no gains at all.
        largest_excess_error: the largest of them.
        optimal_share: share of these frequencies whose gains are admissible and whose excess is below 1e-8.
        solved_share: share that passes the package's own checks and is reported as solved.
        default: whether it is what the package does when nothing is asked for.
    """

    method: str
    solver: str | None
    tolerance: float | None
    frequencies: int
    seconds_first: float
    seconds_per_frequency: float
    excess_error: float | None
    largest_excess_error: float | None
    optimal_share: float
    solved_share: float
    default: bool = False


@dataclass(frozen=True)
class Reference:
    """Smallest magnitude errors, N.s/m, not a number where nothing is admissible; and where they come from."""

    error_ns_per_m: FloatArray
    source: str


def reference_errors(problem: Problem, frequency_hz: FloatArray) -> Reference:
    """Return the optimum's magnitude errors, shape (n,): to 50 digits where that is possible, else those of `exact`."""
    if problem.coupling.structure == "series" and importlib.util.find_spec("mpmath"):
        from reference_optimum import series_error  # noqa: PLC0415 - needs the extra

        found = [series_error(problem, float(frequency)) for frequency in frequency_hz]
        return Reference(np.array([np.nan if e is None else float(e) for e in found]), "50 digits (mpmath)")
    loop = loop_at(problem, frequency_hz)
    error = np.abs(np.abs(loop.perceived(*exact_gains(problem, loop))) - np.abs(loop.target))
    why = (
        "mpmath, the extra accuracy, is not installed" if problem.coupling.structure == "series" else "contact damping"
    )
    return Reference(error, f"method exact ({why})")


@dataclass(frozen=True)
class Entry:
    """What is timed.

    Attributes:
        method: the method.
        solver: what solves it, where there is a choice.
        tolerance: asked of a CasADi solver; None for the others.
    """

    method: str
    solver: str | None = None
    tolerance: float | None = None


def entries(tolerances: tuple[float, ...] = TOLERANCES, solvers: tuple[str, ...] = tuple(SOLVERS)) -> tuple[Entry, ...]:
    """List every method and solver.

    Args:
        tolerances: asked of each CasADi solver.
        solvers: CasADi's.
    """
    default = Entry("direct", DEFAULT_SOLVER, DEFAULT_TOLERANCE)
    others = [Entry("direct", name, tolerance) for name in solvers for tolerance in tolerances]
    return (Entry("closed-form"), Entry("exact"), default, *(entry for entry in others if entry != default))


def solver_cost(problem: Problem, reference: Reference, entry: Entry) -> SolverCost:
    """Time a method or solver.

    Args:
        problem: the problem; its frequencies are the rows.
        reference: the optimum at these frequencies.
        entry: which.
    """
    loop = loop_at(problem, problem.frequencies_hz())
    error = reference.error_ns_per_m
    if entry.tolerance is not None and entry.solver is not None:
        some = np.unique(np.linspace(0, len(error) - 1, _BACKEND_FREQUENCIES).round().astype(int))
        loop, error = loop.rows(some), error[some]
        nlp_solvers.cache_clear()
    cost = _cost(problem, loop, error, partial(_solved, problem, loop, entry))
    default = (entry.solver, entry.tolerance) == (DEFAULT_SOLVER, DEFAULT_TOLERANCE)
    return SolverCost(**vars(entry), **cost, frequencies=len(error), default=default)


def _solved(problem: Problem, loop: Loop, entry: Entry) -> GainArrays:
    if entry.tolerance is not None and entry.solver is not None:
        return nlp_gains(problem, loop, entry.solver, entry.tolerance)
    if entry.method == "closed-form":
        return _closed_form(problem, loop)
    return exact_gains(problem, loop)


def _closed_form(problem: Problem, loop: Loop) -> GainArrays:
    b, k = coupling_gains(loop.angle, project(problem).coupling)
    inside = admissible(problem, b, k, np.zeros(b.shape))
    return np.where(inside, b, np.nan), np.where(inside, k, np.nan), np.where(inside, 0.0, np.nan)


def _cost(problem: Problem, loop: Loop, reference: FloatArray, run: Callable[[], GainArrays]) -> dict[str, Any]:
    """Return the figures of a `SolverCost`."""
    rows = len(reference)
    started = time.perf_counter()
    gains = run()
    first = (time.perf_counter() - started) / rows
    steady: list[float] = []
    while len(steady) < 1 or (len(steady) < _STEADY_RUNS and sum(steady) < _STEADY_SECONDS):
        started = time.perf_counter()
        run()
        steady.append(time.perf_counter() - started)
    excess, solved = _quality(problem, loop, reference, gains)
    possible = np.isfinite(reference)
    known = excess[possible & np.isfinite(excess)]
    count = max(int(possible.sum()), 1)
    return {
        "seconds_first": first,
        "seconds_per_frequency": statistics.median(steady) / rows,
        "excess_error": float(np.median(known)) if known.size else None,
        "largest_excess_error": float(known.max()) if known.size else None,
        "optimal_share": float(np.count_nonzero(known <= OPTIMAL)) / count,
        "solved_share": float(np.count_nonzero(solved & possible)) / count,
    }


def _quality(problem: Problem, loop: Loop, reference: FloatArray, gains: GainArrays) -> tuple[FloatArray, BoolArray]:
    """Excess error of each row, not below the rounding of |Z_h_ds|, and whether it passes the checks of `direct`."""
    radius = np.abs(loop.target)
    scale = np.where(radius == 0, 1.0, radius)
    with np.errstate(invalid="ignore"):
        z = loop.perceived(*gains)
        error = np.where(z.real >= margin_over_range(problem), np.abs(np.abs(z) - radius), np.nan)
        excess = np.maximum((error - reference) / scale, np.finfo(np.float64).eps)
        solved: BoolArray = optimality(problem, loop, gains).acceptable() & (excess <= EXCESS_TOLERANCE)
    return excess, solved
