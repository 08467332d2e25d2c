"""Recommend a coupling, to whatever stands at the other end: a wall in the device's loop, a simulation, a device."""

from __future__ import annotations

from typing import Any

from avc_casadi._errors import InputError
from avc_casadi.files.problem_file import AnyProblem, as_problem
from avc_casadi.recommendation.bilateral import BilateralRecommendation, recommend_bilateral
from avc_casadi.recommendation.recommend import Recommendation
from avc_casadi.recommendation.recommend import recommend as recommend_wall
from avc_casadi.recommendation.virtual_tool import ToolRecommendation, recommend_tool

# What only a wall in the device's loop asks for.
_OF_WALLS = ("lean_on_friction", "prove", "workers", "executor")


def recommend(
    problem: AnyProblem, hands: int = 100, seed: int = 0, **options: Any
) -> Recommendation | ToolRecommendation | BilateralRecommendation:
    """Choose the coupling to deploy to a wall, to a [simulation] or to a [follower], and tell what is known of it.

    Args:
        problem: with one of them; a wall beside another end is not answered. Or a file, or a name.
        hands: number of simulated hands, corners of [hands] among them.
        seed: of their draw.
        options: of `recommend_wall`, or ``versions`` and ``progress`` of the others.

    Raises:
        InputError: faults of the file, or an option that the other end does not know.

    Example:
        >>> found = avc.recommend("spring", hands=10)
        >>> found.deployable
        True
    """
    stated = as_problem(problem)
    if stated.simulation is None and stated.follower is None:
        return recommend_wall(stated, hands, seed, **options)
    alien = [name for name in _OF_WALLS if name in options and options[name] not in (False, None, 1)]
    if alien:
        allowed = "allowed: hands, seed, versions, progress"
        raise InputError.of(f"is an option of walls, and the other end is none; {allowed}", key=alien[0])
    known = {name: value for name, value in options.items() if name not in _OF_WALLS}
    if stated.follower is not None:
        return recommend_bilateral(stated, hands, seed, **known)
    return recommend_tool(stated, hands, seed, **known)
