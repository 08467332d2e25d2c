"""Robustness to unmodelled effects: a lighter device, missed samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from avc_casadi.claims.deployable import deployable
from avc_casadi.model.hands import hand_corners
from avc_casadi.model.robustness import USUAL, Robustness, unmodelled
from avc_casadi.recommendation.generate import plain_candidates
from avc_casadi.recommendation.screening import BEYOND_HANDS, beyond_file, held_otherwise
from avc_casadi.simulation.population.operators import people_of

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling
    from avc_casadi.loops.walls import DampingRange
    from avc_casadi.model.problem import Problem
    from avc_casadi.recommendation.screening import Group


@dataclass(frozen=True)
class Withstood:
    """Trial with one unmodelled effect, or with hands outside the design set.

    Attributes:
        key: of [robustness], the unmodelled effect; or `held`, of [device].
        value: of the key.
        asked: whether the problem requires it.
        hands: how many were simulated.
        at_rest_without_friction: how many of them settle in every motion without the declared dry friction.
        at_rest: the same with it; None where all settle without.
        plain: how many of them settle without friction with the stiffest deployable spring and damper; None where
            that is the coupling under test.
    """

    key: str
    value: float | str
    asked: bool
    hands: int
    at_rest_without_friction: int
    at_rest: int | None
    plain: int | None


def margins(coupling: Coupling, limit: DampingRange, seed: int = 0) -> tuple[Withstood, ...]:
    """Return the trials of a coupling and of a plain spring and damper, each with one unmodelled effect.

    Args:
        coupling: designed for the nominal device.
        limit: the stiffest wall that is stable with spring and damper.
        seed: of the hands.
    """
    problem = coupling.problem
    given = {key: value for key, value in vars(problem.robustness).items() if value is not None}
    people = people_of(problem.hands, BEYOND_HANDS, seed)
    plain = None if coupling.runtime.state_feedback is None else _plain(problem, limit)
    asked = Robustness(**(vars(USUAL) | given))
    devices = unmodelled(problem.device, asked)
    groups: list[tuple[str, float | str, Group]] = [
        (one.key, one.value, group) for one, group in zip(devices, beyond_file(problem, asked, people), strict=True)
    ]
    groups += [("held", problem.device.held, group) for group in held_otherwise(problem, BEYOND_HANDS, seed)]
    found = []
    for key, value, group in groups:
        free = _resting(coupling, group, friction=False)
        rests = None if free == len(group.people) else _resting(coupling, group, friction=True)
        beside = None if plain is None else _resting(plain, group, friction=False)
        found.append(Withstood(key, value, key in given or key == "held", len(group.people), free, rests, beside))
    return tuple(found)


def missed(found: tuple[Withstood, ...], *, by_friction: bool) -> str:
    """Return the requirements of [robustness] that are not met.

    Args:
        found: of the coupling.
        by_friction: whether settling by the declared dry friction suffices.
    """
    short = []
    for one in found:
        rest = one.at_rest if by_friction and one.at_rest is not None else one.at_rest_without_friction
        if one.asked and rest < one.hands:
            short.append(f"{one.hands - rest} of {one.hands} hands do not settle with {one.key} = {one.value}")
    told = "; ".join(short)
    return (
        f"what is asked for beyond [hands] is not withstood: {told}; ask for less, or for a softer wall"
        if short
        else ""
    )


def _resting(coupling: Coupling, group: Group, *, friction: bool) -> int:
    return int((group.residual_speeds([coupling], friction=friction)[0] < 1).sum())


def _plain(problem: Problem, limit: DampingRange) -> Coupling | None:
    """Return the stiffest spring and damper that is deployable, the wall itself first; None where none is."""
    every = (one for alike in plain_candidates(problem, hand_corners(problem.hands), limit) for one in alike)
    return next((one for one in every if deployable(one).passed), None)
