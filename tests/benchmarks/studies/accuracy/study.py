"""The whole study of a problem: solvers, tables, grids, its scene; and its JSON document."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi import InputError, UnsupportedError
from avc_casadi._util.checkpoint import Chunked
from avc_casadi._util.json_values import plain
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.design.scene_coupling import scene_coupling
from avc_casadi.paper.backends import SOLVERS
from studies.accuracy.grids import GridMiss, grid_misses
from studies.accuracy.integrators import IntegratorAccuracy, integrator_accuracy
from studies.accuracy.solvers import TOLERANCES, Entry, SolverCost, entries, reference_errors, solver_cost
from studies.accuracy.tables import TableError, table_errors

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from avc_casadi.model.problem import Problem

SCHEMA = "avc-accuracy/1"
WHY_DEFAULT = (
    "direct by sqpmethod with qrqp: of CasADi's solvers that are optimal everywhere the fastest, with feasibility and"
    " optimality recomputed; exact, the geometry of arcs, is faster and the cross-check"
)


@dataclass(frozen=True)
class Accuracy:
    """What accuracy costs.

    Attributes:
        problem: its name.
        reference: where the true optimum comes from.
        solvers: work against precision of methods and solvers.
        tables: interpolation error of gain tables.
        grids: what a grid of frequencies misses.
        scenes: integrators on the problem's scene.
        without_scenes: why there are none, or empty.
    """

    problem: str
    reference: str
    solvers: tuple[SolverCost, ...]
    tables: tuple[TableError, ...]
    grids: tuple[GridMiss, ...]
    scenes: tuple[IntegratorAccuracy, ...] = ()
    without_scenes: str = ""

    def pareto(self) -> tuple[bool, ...]:
        """Whether no other entry is both faster and nearer to the optimum at its worst frequency, for each entry."""
        points = [
            (cost.seconds_per_frequency, np.inf if cost.largest_excess_error is None else cost.largest_excess_error)
            for cost in self.solvers
        ]
        return tuple(
            bool(np.isfinite(error))
            and not any(s <= seconds and e <= error and (s, e) != (seconds, error) for s, e in points)
            for seconds, error in points
        )

    def document(self) -> dict[str, Any]:
        """Return the study as JSON values."""
        return {
            "schema": SCHEMA,
            "problem": self.problem,
            "reference": self.reference,
            "solvers": [
                asdict(cost) | {"pareto": best} for cost, best in zip(self.solvers, self.pareto(), strict=True)
            ],
            "tables": [asdict(table) for table in self.tables],
            "grids": [asdict(grid) for grid in self.grids],
            "scenes": [plain(asdict(row)) for row in self.scenes],
            "without_scenes": self.without_scenes,
            "default": WHY_DEFAULT,
        }


def study_accuracy(
    problem: Problem,
    progress: Progress = SILENT,
    *,
    tolerances: tuple[float, ...] = TOLERANCES,
    solvers: tuple[str, ...] = tuple(SOLVERS),
    executor: Executor | None = None,
) -> Accuracy:
    """Measure what accuracy costs in time.

    Args:
        problem: the problem.
        progress: told of each measurement.
        tolerances: asked of each CasADi solver.
        solvers: CasADi solvers to measure.
        executor: who measures some of the methods and solvers, as for `Chunked.run`; workers that share a processor
            take longer than one alone.
    """
    reference = reference_errors(problem, problem.frequencies_hz())
    study: Chunked[Entry, list[SolverCost]] = Chunked(
        {}, partial(solver_cost, problem, reference), entries(tolerances, solvers), list, things="methods and solvers"
    )
    costs = study.run(executor, progress=progress)
    progress.advance(len(costs), len(costs), "gain tables")
    tables = tuple(table_errors(problem))
    progress.advance(len(costs), len(costs), "grids")
    grids = tuple(grid_misses(problem))
    progress.advance(len(costs), len(costs), "integrators of the scene")
    scenes, why = _scenes(problem)
    return Accuracy(problem.name, reference.source, tuple(costs), tables, grids, scenes, why)


def _scenes(problem: Problem) -> tuple[tuple[IntegratorAccuracy, ...], str]:
    """Integrators on the problem's scene, or why it cannot be simulated."""
    try:
        return integrator_accuracy(problem, scene_coupling(problem)), ""
    except (InputError, UnsupportedError) as error:
        return (), str(error)
