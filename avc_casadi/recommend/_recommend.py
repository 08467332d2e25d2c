"""The default coupling of a device and a wall: what the training people say about its declared friction and encoder."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi.recommend._designs import Coupling, Design, design
from avc_casadi.recommend._reach import with_observer
from avc_casadi.trial import (
    MOTIONS,
    PEOPLE_AT_ONCE,
    Conditions,
    all_motions,
    choose,
    distance,
    draw_subjects,
    reference_traces,
    traces,
)

if TYPE_CHECKING:
    from avc_casadi.problem import Problem
    from avc_casadi.trial import Subjects

Claim = Literal["asymptotic", "held-by-friction", "none"]
# Constant gains first: what is simpler wins where it is as good.
_CANDIDATES: tuple[Coupling, ...] = ("static-tuned", "schedule", "static-tuned-series", "static-sampled")
_CLAIMS: dict[Claim, str] = {
    "asymptotic": "rest without dry friction",
    "held-by-friction": "rest with the declared dry friction",
    "none": "no rest for everybody",
}


@dataclass(frozen=True)
class Recommendation:
    """The coupling to start with.

    Attributes:
        design: the coupling with its gains.
        conditions: how it was judged; ``observer_mass_kg`` says whether it needs the observer behind the encoder.
        claim: asymptotic: everybody comes to rest without dry friction; held-by-friction: only with that declared;
            none: somebody does not come to rest with any candidate.
        people: number of training people.
        stable: how many of them come to rest in every motion.
        reason: one sentence for people.
    """

    design: Design
    conditions: Conditions
    claim: Claim
    people: int
    stable: int
    reason: str

    def __str__(self) -> str:
        mass = self.conditions.observer_mass_kg
        observer = "" if mass is None else f" with an observer of {mass:.4g} kg"
        gains, _ = self.design.sentences()
        what = f"{self.design.problem.name}: {self.design.coupling}{observer}, {_CLAIMS[self.claim]}"
        return f"{what} ({self.stable} of {self.people} people at rest)\n{gains}\n{self.reason}"


def recommend(problem: Problem, people: int = 100, seed: int = 0) -> Recommendation:
    """Choose between constant and scheduled gains, with the observer behind the encoder only where it is needed.

    Stability comes first, without friction if that can be had; the schedule is taken only where it brings more people
    to rest than constant gains, or where more than half of them notice that it is nearer to the wall.

    Args:
        problem: device with what is known of its friction and encoder, and the wall.
        people: number of training people.
        seed: seed of their draw.

    Raises:
        UnsupportedError: no candidate has gains for this device and wall.
    """
    subjects = draw_subjects("A", people, seed, "training")
    candidates = [design(problem, name) for name in _CANDIDATES]
    designs = [found for found in candidates if found.gains is not None]
    if not designs:
        raise UnsupportedError(_none_left(problem, candidates))
    tried = []
    for claim, conditions in _conditions(problem):
        for found in designs:
            stable = int(all_motions(found.problem, found.in_force, subjects, conditions).sum())
            if stable == people:
                return _settled(Recommendation(found, conditions, claim, people, stable, ""), designs, subjects)
            tried.append(Recommendation(found, conditions, "none", people, stable, ""))
    best = max(tried, key=lambda one: one.stable)
    return replace(best, reason=f"{best.design.coupling} leaves the fewest people restless: {people - best.stable}")


def _none_left(problem: Problem, candidates: list[Design]) -> str:
    why = "".join(f"\n  {found.coupling}: {found.reason}" for found in candidates)
    return (
        f"{problem.name}: no candidate has gains for this device and wall; widen the gain box of [coupling], shorten "
        f"the sample time or the delay, or soften the wall{why}"
    )


def _conditions(problem: Problem) -> list[tuple[Claim, Conditions]]:
    """From the strongest claim with the least effort to the weakest."""
    declared = Conditions.declared(problem)
    listed: list[tuple[Claim, Conditions]] = [("asymptotic", declared.without_friction())]
    if declared.encoder_m > 0:
        listed.append(("asymptotic", with_observer(problem, declared.without_friction())))
    if declared.friction_n > 0:
        listed.append(("held-by-friction", declared))
        if declared.encoder_m > 0:
            listed.append(("held-by-friction", with_observer(problem, declared)))
    return listed


def _settled(found: Recommendation, designs: list[Design], subjects: Subjects) -> Recommendation:
    """Let the schedule take over from constant gains where people notice that it is nearer to the wall."""
    plain = found.design
    schedule = next((other for other in designs if other.coupling == "schedule"), None)
    if plain.coupling != "static-tuned" or schedule is None:
        return replace(found, reason=f"{plain.coupling} is the first candidate that brings everybody to rest")
    press = MOTIONS["press"]
    subjects = subjects.pick(slice(0, PEOPLE_AT_ONCE))
    (reference,) = reference_traces(plain.problem, subjects, press, found.conditions.friction_n)
    felt = [
        distance(next(traces(one.problem, one.in_force, subjects, press, found.conditions)), reference)
        for one in (plain, schedule)
    ]
    nearer = int(choose(felt[1], felt[0]).first.sum())
    rests = all_motions(schedule.problem, schedule.in_force, subjects, found.conditions)
    if bool(np.all(rests)) and 2 * nearer > len(subjects):
        return replace(
            found, design=schedule, reason=f"{nearer} of {len(subjects)} people notice the schedule as nearer"
        )
    return replace(found, reason=f"constant gains: {nearer} of {len(subjects)} people notice the schedule as nearer")
