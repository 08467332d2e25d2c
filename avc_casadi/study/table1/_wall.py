"""One wall of the table: every coupling before the same people."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi.recommendation import COUPLINGS, CandidateName, Design, design
from avc_casadi.study.table1._paper import PAPER
from avc_casadi.support import BoolArray, FloatArray, plain
from avc_casadi.trial import (
    MOTIONS,
    PEOPLE_AT_ONCE,
    WEBER,
    WEBER_SWEEP,
    Conditions,
    choose,
    distance,
    exact_interval,
    judged,
    reference_traces,
    traces,
)

if TYPE_CHECKING:
    from avc_casadi.loop import Hand, StylusHand
    from avc_casadi.problem import Problem
    from avc_casadi.scene import Judgement


# Whom each coupling is compared with: the paper compared static and adaptive; all others are set against the schedule.
_OPPONENT: dict[CandidateName, CandidateName] = {"schedule": "static"}
_ADAPTIVE: CandidateName = "schedule"


@dataclass
class Outcome:
    """What one coupling did with everybody; arrays of shape (people,) grow as people are tried.

    Attributes:
        design: the coupling.
        stable: at rest in every motion.
        by_motion: at rest, for each motion.
        asymptotic: at rest after a press without dry friction.
        apparent_stiffness_n_per_m: at the end of a press; not a number without contact.
        distance: from the reference, of `distance`; empty where nothing is matched.
    """

    design: Design
    stable: list[BoolArray] = field(default_factory=list)
    by_motion: dict[str, list[BoolArray]] = field(default_factory=dict)
    asymptotic: list[BoolArray] = field(default_factory=list)
    apparent_stiffness_n_per_m: list[FloatArray] = field(default_factory=list)
    distance: list[FloatArray] = field(default_factory=list)


def try_wall(
    problem: Problem,
    subjects: Hand | StylusHand,
    designs: tuple[Design, ...],
    *,
    matching: bool = True,
    people_at_once: int = PEOPLE_AT_ONCE,
) -> dict[CandidateName, Outcome]:
    """Put every coupling before everybody.

    Args:
        problem: the wall.
        subjects: the people.
        designs: the couplings.
        matching: compare traces with the reference too.
        people_at_once: people whose traces are held together.
    """
    outcomes = {one.coupling: Outcome(one) for one in designs if one.gains is not None}
    conditions = Conditions.declared(problem)
    for first in range(0, len(subjects), people_at_once):
        people = subjects.pick(slice(first, first + people_at_once))
        reference = None
        if matching:
            (reference,) = reference_traces(problem, people, MOTIONS["press"], conditions.friction_n)
        for outcome in outcomes.values():
            chosen = outcome.design.in_force
            (press,) = traces(outcome.design.problem, chosen, people, MOTIONS["press"], conditions)
            found: dict[str, Judgement] = {"press": press.judged()}
            for name, motion in MOTIONS.items():
                if name != "press":
                    found[name] = judged(outcome.design.problem, chosen, people, motion, conditions)
            free = judged(outcome.design.problem, chosen, people, MOTIONS["press"], conditions.without_friction())
            outcome.stable.append(np.all([run.stable for run in found.values()], axis=0))
            for name, run in found.items():
                outcome.by_motion.setdefault(name, []).append(run.stable)
            outcome.asymptotic.append(free.stable)
            outcome.apparent_stiffness_n_per_m.append(found["press"].apparent_stiffness_n_per_m)
            if reference is not None:
                outcome.distance.append(distance(press, reference))
    return outcomes


def all_designs(problem: Problem, couplings: tuple[CandidateName, ...] = tuple(COUPLINGS)) -> tuple[Design, ...]:
    """Design every coupling for a wall."""
    return tuple(design(problem, coupling) for coupling in couplings)


def rows(
    wall: str, problem: Problem, designs: tuple[Design, ...], outcomes: dict[CandidateName, Outcome]
) -> list[dict[str, Any]]:
    """Return one JSON row for each coupling.

    Args:
        wall: VE2 to VE7, or another name.
        problem: the wall.
        designs: the couplings, also those without gains.
        outcomes: of `try_wall`.
    """
    distances = {name: np.concatenate(found.distance) for name, found in outcomes.items() if found.distance}
    return [_row(wall, problem, one, outcomes.get(one.coupling), distances) for one in designs]


def _row(
    wall: str, problem: Problem, one: Design, outcome: Outcome | None, distances: dict[CandidateName, FloatArray]
) -> dict[str, Any]:
    row: dict[str, Any] = {
        "ve": wall,
        "stiffness_n_per_m": problem.environment.stiffness_n_per_m,
        "coupling": one.coupling,
        "gains": one.document(),
        "reason": one.reason,
        "paper": _paper(wall, one.coupling),
    }
    if outcome is None:
        names = ("stable", "stable_low", "stable_high", "stable_by_motion", "asymptotic", "asymptotic_low")
        return row | dict.fromkeys((*names, "apparent_stiffness_n_per_m")) | _matched(one.coupling, {})
    stable, asymptotic = np.concatenate(outcome.stable), np.concatenate(outcome.asymptotic)
    stiffness = np.concatenate(outcome.apparent_stiffness_n_per_m)
    felt = stiffness[np.isfinite(stiffness) & np.concatenate(outcome.by_motion["press"])]
    interval = exact_interval(int(stable.sum()), len(stable))
    free = exact_interval(int(asymptotic.sum()), len(asymptotic))
    return row | {
        "stable": int(stable.sum()),
        "stable_low": interval[0],
        "stable_high": interval[1],
        "stable_by_motion": {name: int(np.concatenate(runs).sum()) for name, runs in outcome.by_motion.items()},
        "asymptotic": int(asymptotic.sum()),
        "asymptotic_low": free[0],
        "asymptotic_high": free[1],
        "apparent_stiffness_n_per_m": float(np.median(felt)) if len(felt) else None,
        **_matched(one.coupling, distances),
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
