"""The paper's experiment with simulated people: Table 1."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from concurrent.futures import Executor
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any

import avc_casadi as avc
from avc_casadi._util.checkpoint import Chunked
from avc_casadi._util.parallel import processors
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.design.constant.static_tuned import TUNED_MARGIN_SHARE
from avc_casadi.simulation.population.operators import Population, draw_population
from avc_casadi.simulation.population.settled import CONFIDENCE
from avc_casadi.simulation.population.trial import HANDS_AT_ONCE
from studies.designs import COUPLINGS, MEET_OTHERS, CandidateName
from studies.table1.matching import WEBER, WEBER_SWEEP
from studies.table1.paper import PAPER, PEOPLE
from studies.table1.wall import Outcome, all_designs, design_documents, rows, try_wall

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem
    from studies.designs import Design

SCHEMA = "avc-table1/1"
DEFAULT_HANDS = 200
DEFAULT_SEED = 2026
# People before a wall who are one chunk; they are simulated some at a time.
_AT_ONCE = 4 * HANDS_AT_ONCE
# Wall, population, how many people come before, how many there are.
Cell = tuple[str, Population, int, int]
POPULATIONS: tuple[Population, ...] = ("A", "B")


def table1(
    hands: int = DEFAULT_HANDS,
    seed: int = DEFAULT_SEED,
    *,
    walls: tuple[str, ...] = tuple(PAPER),
    couplings: tuple[CandidateName, ...] = tuple(COUPLINGS),
    workers: int | None = None,
    executor: Executor | None = None,
    progress: Progress = SILENT,
) -> dict[str, Any]:
    """Rebuild Table 1; the same seed gives the same people and the same counts.

    Args:
        hands: simulated people of each population.
        seed: seed of the test people; the designs never see them.
        walls: which walls of the catalogue.
        couplings: which couplings.
        workers: processes; None takes one for each processor.
        executor: who works instead, as for `Chunked.run`.
        progress: told of the people.

    Returns:
        The JSON document of `avc study table1`: ``rows`` for set A, ``rows_set_b`` for the stylus hands and their arms.
    """
    study = table1_study(hands, seed, walls=walls, couplings=couplings)
    return study.run(executor, workers=processors() if workers is None else workers, progress=progress)


def table1_study(
    hands: int = DEFAULT_HANDS,
    seed: int = DEFAULT_SEED,
    *,
    walls: tuple[str, ...] = tuple(PAPER),
    couplings: tuple[CandidateName, ...] = tuple(COUPLINGS),
) -> Chunked[Cell, dict[str, Any]]:
    """Plan Table 1: some people before one wall at a time; arguments as for `table1`."""
    tasks = [
        (wall, population, first, min(_AT_ONCE, hands - first))
        for population in POPULATIONS
        for wall in walls
        for first in range(0, hands, _AT_ONCE)
    ]
    return Chunked(
        about={
            "study": SCHEMA,
            "hands": hands,
            "seed": seed,
            "walls": list(walls),
            "couplings": list(couplings),
            "sha256": {wall: _told_by(wall) for wall in walls},
        },
        work=partial(_tried, couplings, seed),
        tasks=tasks,
        finish=partial(_document, tasks, couplings, hands, seed),
        sizes=[count for *_, count in tasks],
        things="people before walls",
    )


def _told_by(wall: str) -> str:
    return hashlib.sha256(avc.dump_problem(avc.load_problem(wall.lower())).encode()).hexdigest()


def _tried(couplings: tuple[CandidateName, ...], seed: int, cell: Cell) -> dict[str, Any]:
    wall, population, first, count = cell
    matching = population == "A"
    names = couplings if matching else tuple(name for name in couplings if name in MEET_OTHERS)
    problem, designs = _designed(wall, names)
    outcomes = try_wall(problem, draw_population(population, count, seed, first=first), designs, matching=matching)
    return {
        "designs": design_documents(designs),
        "outcomes": {coupling: outcome.document() for coupling, outcome in outcomes.items()},
    }


@lru_cache(maxsize=12)
def _designed(wall: str, couplings: tuple[CandidateName, ...]) -> tuple[Problem, tuple[Design, ...]]:
    """Design once in the life of a worker."""
    problem = avc.load_problem(wall.lower())
    return problem, all_designs(problem, couplings)


def _document(
    tasks: Sequence[Cell], couplings: tuple[CandidateName, ...], hands: int, seed: int, parts: list[dict[str, Any]]
) -> dict[str, Any]:
    found: dict[str, list[dict[str, Any]]] = {population: [] for population in POPULATIONS}
    cells: dict[tuple[str, Population], list[dict[str, Any]]] = {}
    for (wall, population, *_), part in zip(tasks, parts, strict=True):
        cells.setdefault((wall, population), []).append(part)
    for (wall, population), some in cells.items():
        names: list[CandidateName] = list(some[0]["outcomes"])
        outcomes = {name: Outcome.joined([part["outcomes"][name] for part in some]) for name in names}
        told = rows(wall, avc.load_problem(wall.lower()), some[0]["designs"], outcomes)
        # The paper's people are set beside those that its column calibrates, set A.
        found[population] += told if population == "A" else [row | {"paper": None} for row in told]
    return {
        "schema": SCHEMA,
        "hands": hands,
        "seed": seed,
        "rows": found["A"],
        "rows_set_b": found["B"],
        "couplings": {name: COUPLINGS[name] for name in couplings},
        "method": _method(),
    }


def _method() -> dict[str, Any]:
    """Say what was assumed, calibrated and predicted."""
    return {
        "stable": "largest true velocity of device and handle in the last 0.5 s below 5 mm/s, in press, tap and hold",
        "asymptotic": "the same in a press without dry friction; the encoder stays",
        "interval": f"exact binomial (Clopper-Pearson), {CONFIDENCE:.0%}",
        "calibrated": "stiffness of VE4 to VE6, from the paper's column without coupling alone",
        "predicted": "every other count",
        "training": (
            f"corners and 24 draws of set A; frozen loops stable without {TUNED_MARGIN_SHARE:g} k_e T/2 of damping"
        ),
        "matching": (
            "rms difference of force or position from the reference wall in contact, whichever is larger; unable "
            "where neither coupling, or not one from the other, differs by more than the Weber fraction"
        ),
        "weber": WEBER,
        "weber_sweep": list(WEBER_SWEEP),
        "paper_people": PEOPLE,
    }
