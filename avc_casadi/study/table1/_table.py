"""The paper's experiment with simulated people: Table 1."""

from __future__ import annotations

import os
from typing import Any

import avc_casadi as avc
from avc_casadi.design.constant import TUNED_MARGIN_SHARE
from avc_casadi.recommendation import COUPLINGS, CandidateName
from avc_casadi.study.table1._paper import PAPER, PEOPLE
from avc_casadi.study.table1._wall import all_designs, rows, try_wall
from avc_casadi.support import SILENT, Progress, in_processes
from avc_casadi.trial import CONFIDENCE, WEBER, WEBER_SWEEP, Population, draw_subjects

SCHEMA = "avc-table1/1"
DEFAULT_HANDS = 200
DEFAULT_SEED = 2026
POPULATIONS: tuple[Population, ...] = ("A", "B")
# Set B is there to show what the designs do to hands that they were not made for.
SET_B_COUPLINGS: tuple[CandidateName, ...] = ("none", "static", "static-tuned", "schedule")


def table1(
    hands: int = DEFAULT_HANDS,
    seed: int = DEFAULT_SEED,
    *,
    walls: tuple[str, ...] = tuple(PAPER),
    couplings: tuple[CandidateName, ...] = tuple(COUPLINGS),
    workers: int | None = None,
    progress: Progress = SILENT,
) -> dict[str, Any]:
    """Rebuild Table 1; the same seed gives the same people and the same counts.

    Args:
        hands: simulated people of each population.
        seed: seed of the test people; the designs never see them.
        walls: which walls of the catalogue.
        couplings: which couplings.
        workers: processes; None takes one for each processor.
        progress: told of each wall and population that is finished.

    Returns:
        The JSON document of `avc table1`: ``rows`` for set A, ``rows_set_b`` for the stylus hands and their arms.
    """
    cells = [(wall, population, couplings, hands, seed) for population in POPULATIONS for wall in walls]
    workers = min(len(cells), os.cpu_count() or 1) if workers is None else workers
    results = map(_rows, cells) if workers == 1 else in_processes(_rows, cells, workers)
    found: dict[str, list[dict[str, Any]]] = {population: [] for population in POPULATIONS}
    for done, ((wall, population, *_), some) in enumerate(zip(cells, results, strict=True), start=1):
        found[population] += some
        progress.advance(done, len(cells), f"walls, {wall} with set {population} the last")
    return {
        "schema": SCHEMA,
        "hands": hands,
        "seed": seed,
        "rows": found["A"],
        "rows_set_b": found["B"],
        "couplings": {name: COUPLINGS[name] for name in couplings},
        "method": _method(),
    }


def _rows(cell: tuple[str, Population, tuple[CandidateName, ...], int, int]) -> list[dict[str, Any]]:
    wall, population, couplings, hands, seed = cell
    problem, matching = avc.load_problem(wall.lower()), population == "A"
    designs = all_designs(
        problem, couplings if matching else tuple(name for name in couplings if name in SET_B_COUPLINGS)
    )
    people = draw_subjects(population, hands, seed)
    found = rows(wall, problem, designs, try_wall(problem, people, designs, matching=matching))
    # The paper's people are set beside those that its column calibrates, set A.
    return found if matching else [row | {"paper": None} for row in found]


def _method() -> dict[str, Any]:
    """Say what was assumed, calibrated and predicted."""
    return {
        "stable": "largest true velocity in the last 0.5 s below 5 mm/s, in press, tap and hold",
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
