"""Recommend a coupling to the remote end: a wall in the device's loop, a simulation, or a follower device."""

from __future__ import annotations

from typing import Any

from avc_casadi._errors import InputError
from avc_casadi.files.problem_file import AnyProblem, as_problem, of_problem
from avc_casadi.recommendation.bilateral import recommend_bilateral
from avc_casadi.recommendation.recommend import recommend as recommend_wall
from avc_casadi.recommendation.recommendation import Recommendation
from avc_casadi.recommendation.virtual_tool import recommend_tool

# Options that apply to a wall in the device's loop alone.
_OF_WALLS = ("lean_on_friction", "prove", "with_trade_off", "workers", "executor")


@of_problem
def recommend(problem: AnyProblem, hands: int = 100, seed: int = 0, **options: Any) -> Recommendation:
    """Return the coupling to deploy to a wall, a [simulation] or a [follower], with its analysis.

    Args:
        problem: with exactly one of them; or a file, or a name.
        hands: number of simulated hands, corners of [hands] among them.
        seed: of their draw.
        options: of `recommend_wall`, or ``versions`` and ``progress`` of the others.

    Raises:
        InputError: faults of the file, or an option that does not apply to the remote end.

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
