"""One wall of the table: every coupling before the same people."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from operator import getitem
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi._util.json_values import packed, plain, unpacked
from avc_casadi.simulation.population.motions import MOTIONS
from avc_casadi.simulation.population.settled import exact_interval
from avc_casadi.simulation.population.trial import HANDS_AT_ONCE, Conditions, Traces, judged, traces
from studies.designs import COUPLINGS, CandidateName, Design, design
from studies.table1.matching import WEBER, WEBER_SWEEP, choose, distance, reference_traces
from studies.table1.paper import PAPER

if TYPE_CHECKING:
    from avc_casadi.model.hands import Hand, StylusHand
    from avc_casadi.model.problem import Problem
    from avc_casadi.simulation.judge import Judgement


# Whom each coupling is compared with: the paper compared static and adaptive; all others are set against the schedule.
_OPPONENT: dict[CandidateName, CandidateName] = {"schedule": "static"}
_ADAPTIVE: CandidateName = "schedule"


@dataclass(frozen=True)
class Outcome:
    """What one coupling did with everybody; arrays of shape (people,).

    Attributes:
        stable: at rest in every motion.
        by_motion: at rest, for each motion.
        asymptotic: at rest after a press without dry friction.
        apparent_stiffness_n_per_m: at the end of a press; not a number without contact.
        distance: from the reference, of `distance`; None where nothing is matched.
    """

    stable: BoolArray
    by_motion: dict[str, BoolArray]
    asymptotic: BoolArray
    apparent_stiffness_n_per_m: FloatArray
    distance: FloatArray | None

    def document(self) -> dict[str, Any]:
        """Return JSON values that keep every bit."""
        return {
            "stable": packed(self.stable),
            "by_motion": {name: packed(rest) for name, rest in self.by_motion.items()},
            "asymptotic": packed(self.asymptotic),
            "apparent_stiffness_n_per_m": packed(self.apparent_stiffness_n_per_m),
            "distance": None if self.distance is None else packed(self.distance),
        }

    @classmethod
    def joined(cls, documents: Sequence[dict[str, Any]]) -> Outcome:
        """Return the outcome of all whose documents are given, in their order."""

        def whole(*path: str) -> Any:
            return np.concatenate([unpacked(reduce(getitem, path, one)) for one in documents])

        first = documents[0]
        return cls(
            stable=whole("stable"),
            by_motion={name: whole("by_motion", name) for name in first["by_motion"]},
            asymptotic=whole("asymptotic"),
            apparent_stiffness_n_per_m=whole("apparent_stiffness_n_per_m"),
            distance=None if first["distance"] is None else whole("distance"),
        )


def try_wall(
    problem: Problem,
    subjects: Hand | StylusHand,
    designs: tuple[Design, ...],
    *,
    matching: bool = True,
    people_at_once: int = HANDS_AT_ONCE,
) -> dict[CandidateName, Outcome]:
    """Put every coupling before everybody.

    Args:
        problem: the wall.
        subjects: the people.
        designs: the couplings.
        matching: compare traces with the reference too.
        people_at_once: people whose traces are held together.
    """
    tried = [one for one in designs if one.gains is not None]
    found: dict[CandidateName, list[dict[str, Any]]] = {one.coupling: [] for one in tried}
    conditions = Conditions.declared(problem)
    for first in range(0, len(subjects), people_at_once):
        people = subjects.pick(slice(first, first + people_at_once))
        reference = None
        if matching:
            (reference,) = reference_traces(problem, people, MOTIONS["press"], conditions.friction_n)
        for one in tried:
            found[one.coupling].append(_outcome(one, people, conditions, reference).document())
    return {coupling: Outcome.joined(parts) for coupling, parts in found.items()}


def _outcome(one: Design, people: Hand | StylusHand, conditions: Conditions, reference: Traces | None) -> Outcome:
    (press,) = traces(one.problem, one.in_force, people, MOTIONS["press"], conditions)
    runs: dict[str, Judgement] = {"press": press.judged()}
    for name, motion in MOTIONS.items():
        if name != "press":
            runs[name] = judged(one.problem, one.in_force, people, motion, conditions)
    free = judged(one.problem, one.in_force, people, MOTIONS["press"], conditions.without_friction())
    by_motion = {name: run.stable for name, run in runs.items()}
    return Outcome(
        stable=np.asarray(np.all(list(by_motion.values()), axis=0)),
        by_motion=by_motion,
        asymptotic=free.stable,
        apparent_stiffness_n_per_m=runs["press"].apparent_stiffness_n_per_m,
        distance=None if reference is None else distance(press, reference),
    )


def all_designs(problem: Problem, couplings: tuple[CandidateName, ...] = tuple(COUPLINGS)) -> tuple[Design, ...]:
    """Design every coupling for a wall."""
    return tuple(design(problem, coupling) for coupling in couplings)


def design_documents(designs: Sequence[Design]) -> list[dict[str, Any]]:
    """Return what rows tell of each coupling, JSON values."""
    return [{"coupling": one.coupling, "gains": one.document(), "reason": one.reason} for one in designs]


def rows(
    wall: str, problem: Problem, designs: Sequence[dict[str, Any]], outcomes: dict[CandidateName, Outcome]
) -> list[dict[str, Any]]:
    """Return one JSON row for each coupling.

    Args:
        wall: VE2 to VE7, or another name.
        problem: the wall.
        designs: the couplings, also those without gains, of `design_documents`.
        outcomes: of `try_wall`.
    """
    distances = {name: found.distance for name, found in outcomes.items() if found.distance is not None}
    return [_row(wall, problem, one, outcomes.get(one["coupling"]), distances) for one in designs]


def _row(
    wall: str,
    problem: Problem,
    one: dict[str, Any],
    outcome: Outcome | None,
    distances: dict[CandidateName, FloatArray],
) -> dict[str, Any]:
    coupling: CandidateName = one["coupling"]
    row: dict[str, Any] = {
        "ve": wall,
        "stiffness_n_per_m": problem.environment.stiffness_n_per_m,
        **one,
        "paper": _paper(wall, coupling),
    }
    if outcome is None:
        names = ("stable", "stable_low", "stable_high", "stable_by_motion", "asymptotic", "asymptotic_low")
        return row | dict.fromkeys((*names, "apparent_stiffness_n_per_m")) | _matched(coupling, {})
    stable, asymptotic, stiffness = outcome.stable, outcome.asymptotic, outcome.apparent_stiffness_n_per_m
    felt = stiffness[np.isfinite(stiffness) & outcome.by_motion["press"]]
    interval = exact_interval(int(stable.sum()), len(stable))
    free = exact_interval(int(asymptotic.sum()), len(asymptotic))
    return row | {
        "stable": int(stable.sum()),
        "stable_low": interval[0],
        "stable_high": interval[1],
        "stable_by_motion": {name: int(rest.sum()) for name, rest in outcome.by_motion.items()},
        "asymptotic": int(asymptotic.sum()),
        "asymptotic_low": free[0],
        "asymptotic_high": free[1],
        "apparent_stiffness_n_per_m": float(np.median(felt)) if len(felt) else None,
        **_matched(coupling, distances),
    }


def _matched(coupling: CandidateName, distances: dict[CandidateName, FloatArray]) -> dict[str, Any]:
    opponent = _OPPONENT.get(coupling, _ADAPTIVE)
    if coupling not in distances or opponent not in distances:
        return {
            "matched": None,
            "unable": None,
            "matched_against": opponent,
            "matched_by_weber": None,
            "distance": None,
        }
    swept = {weber: choose(distances[coupling], distances[opponent], weber) for weber in WEBER_SWEEP}
    far = np.quantile(distances[coupling], (0.1, 0.5, 0.9))
    return {
        "matched": int(swept[WEBER].first.sum()),
        "unable": int(swept[WEBER].unable.sum()),
        "matched_against": opponent,
        "matched_by_weber": {
            f"{weber:g}": {"matched": int(found.first.sum()), "unable": int(found.unable.sum())}
            for weber, found in swept.items()
        },
        "distance": plain(far),
    }


def _paper(wall: str, coupling: CandidateName) -> dict[str, int | None] | None:
    found = PAPER.get(wall)
    if found is None:
        return None
    known: dict[CandidateName, tuple[int, int | None]] = {
        "none": (found.stable_without_coupling, None),
        "static": (10, found.matched_static),
        "schedule": (10, found.matched_adaptive),
    }
    stable, matched = known.get(coupling, (None, None))
    return None if stable is None else {"stable": stable, "matched": matched, "unable": found.unable}
