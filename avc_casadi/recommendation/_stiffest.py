"""Only how stiff a wall can be, and what would allow a stiffer one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from avc_casadi.loop import hand_corners, with_let_go
from avc_casadi.recommendation._assumptions import assumed, not_used
from avc_casadi.recommendation._helps import what_would_help
from avc_casadi.recommendation._recommend import SCHEMA
from avc_casadi.stability import stiffest_wall
from avc_casadi.support import plain

if TYPE_CHECKING:
    from avc_casadi.problem import Problem


def stiffest(problem: Problem) -> dict[str, Any]:
    """Search only the stiffest wall that the device can give to every hand and let go, and what would help.

    Returns:
        The document of `avc recommend P --stiffest`: JSON values.
    """
    extreme = hand_corners(problem.hands)
    found = stiffest_wall(problem.device, with_let_go(extreme))
    document: dict[str, Any] = plain(
        {
            "schema": SCHEMA,
            "problem": problem.name,
            "stiffest_wall_n_per_m": found.stiffness_n_per_m,
            "damping_ns_per_m": [found.lowest_ns_per_m, found.highest_ns_per_m],
            "what_would_help": [vars(one) for one in what_would_help(problem, extreme)],
            "assumed": list(assumed(problem)),
            "not_used": list(not_used(problem)),
        }
    )
    return document
