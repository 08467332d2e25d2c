"""Robustness to unmodelled effects: a lighter device, missed samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from avc_casadi.model.corners import USUAL, Robustness, unmodelled
from avc_casadi.recommendation.evaluator import BEYOND_HANDS, Group, beyond_file, held_otherwise
from avc_casadi.simulation.population.operators import people_of

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling


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
    """

    key: str
    value: float | str
    asked: bool
    hands: int
    at_rest_without_friction: int
    at_rest: int | None


def margins(coupling: Coupling, seed: int = 0) -> tuple[Withstood, ...]:
    """Return the trials of a coupling, each with one unmodelled effect."""
    problem = coupling.problem
    given = {key: value for key, value in vars(problem.robustness).items() if value is not None}
    people = people_of(problem.hands, BEYOND_HANDS, seed)
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
        found.append(Withstood(key, value, key in given or key == "held", len(group.people), free, rests))
    return tuple(found)


def missed(found: tuple[Withstood, ...], *, by_friction: bool) -> str:
    """Return the requirements of [robustness] that are not met."""
    short = []
    for one in found:
        rest = one.at_rest if by_friction and one.at_rest is not None else one.at_rest_without_friction
        if one.asked and rest < one.hands:
            short.append(f"{one.hands - rest} of {one.hands} hands do not settle with {one.key} = {one.value}")
    if not short:
        return ""
    return f"what is asked for beyond [hands] is not withstood: {'; '.join(short)}; ask for less, or for a softer wall"


def _resting(coupling: Coupling, group: Group, *, friction: bool) -> int:
    return int(group.settles(coupling, friction=friction).sum())
