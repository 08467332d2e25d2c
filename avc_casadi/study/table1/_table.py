"""The paper's experiment with simulated people: Table 1."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import avc_casadi as avc
from avc_casadi.design.constant import TUNED_MARGIN_SHARE
from avc_casadi.recommendation import COUPLINGS, CandidateName, Design
from avc_casadi.study.table1._paper import PAPER, PEOPLE
from avc_casadi.study.table1._wall import all_designs, rows, try_wall
from avc_casadi.study.table1._workers import in_processes
from avc_casadi.trial import CONFIDENCE, WEBER, WEBER_SWEEP, Population, draw_subjects

if TYPE_CHECKING:
    from collections.abc import Callable

SCHEMA = "avc-table1/1"
DEFAULT_HANDS = 200
DEFAULT_SEED = 2026
# Set B is there to show what the designs do to hands that they were not made for.
SET_B_COUPLINGS: tuple[CandidateName, ...] = ("none", "static", "static-tuned", "schedule")


def table1(
    hands: int = DEFAULT_HANDS,
    seed: int = DEFAULT_SEED,
    *,
    walls: tuple[str, ...] = tuple(PAPER),
    couplings: tuple[CandidateName, ...] = tuple(COUPLINGS),
    workers: int | None = None,
    done: Callable[[str], None] | None = None,
) -> dict[str, Any]:
    """Rebuild Table 1; the same seed gives the same people and the same counts.

    Args:
        hands: simulated people of each population.
        seed: seed of the test people; the designs never see them.
        walls: which walls of the catalogue.
        couplings: which couplings.
        workers: processes; None takes one for each processor.
        done: called with the name of each wall that is finished.

    Returns:
        The JSON document of `avc table1`: ``rows`` for set A, ``rows_set_b`` for the stylus hands and their arms.
    """
    tasks = [(wall, couplings, hands, seed) for wall in walls]
    workers = min(len(tasks), os.cpu_count() or 1) if workers is None else workers
    found: list[tuple[list[dict[str, Any]], list[dict[str, Any]]]] = []
    if workers == 1:
        for task in tasks:
            found.append(_wall(task))
            if done is not None:
                done(task[0])
    else:
        for task, result in zip(tasks, in_processes(_wall, tasks, workers), strict=True):
            found.append(result)
            if done is not None:
                done(task[0])
    return {
        "schema": SCHEMA,
        "hands": hands,
        "seed": seed,
        "rows": [row for of_a, _ in found for row in of_a],
        "rows_set_b": [row for _, of_b in found for row in of_b],
        "couplings": {name: COUPLINGS[name] for name in couplings},
        "method": _method(),
    }


def _wall(task: tuple[str, tuple[CandidateName, ...], int, int]) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    wall, couplings, hands, seed = task
    problem = avc.load_problem(wall.lower())
    designs = all_designs(problem, couplings)

    def of(population: Population, tried: tuple[Design, ...], *, matching: bool) -> list[dict[str, Any]]:
        people = draw_subjects(population, hands, seed)
        found = rows(wall, problem, tried, try_wall(problem, people, tried, matching=matching))
        # The paper's people are set beside those that its column calibrates, set A.
        return found if matching else [row | {"paper": None} for row in found]

    kept = tuple(one for one in designs if one.coupling in SET_B_COUPLINGS)
    return of("A", designs, matching=True), of("B", kept, matching=False)


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
