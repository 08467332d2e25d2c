"""Only how stiff a wall can be, and what would allow a stiffer one."""

from __future__ import annotations

from concurrent.futures import Executor
from typing import TYPE_CHECKING, Any

from avc_casadi._errors import UnsupportedError
from avc_casadi.design.robust import stiffest_robust
from avc_casadi.loop import hand_corners, with_let_go
from avc_casadi.recommendation._assumptions import assumed, not_used
from avc_casadi.recommendation._helps import what_would_help, what_would_help_robust
from avc_casadi.recommendation._recommend import SCHEMA
from avc_casadi.stability import stiffest_wall
from avc_casadi.support import SILENT, Progress, plain

if TYPE_CHECKING:
    from avc_casadi.problem import Problem


def stiffest(
    problem: Problem, workers: int = 1, progress: Progress = SILENT, executor: Executor | None = None
) -> dict[str, Any]:
    """Search only the stiffest wall that the device can give to every hand and let go, and what would help.

    Linear stability alone: whether simulated hands come to rest without dry friction is for a recommendation.

    Args:
        problem: device, hands; the wall does not matter.
        workers: processes for the changes; more than one start this program anew, so that a script needs its guard.
        progress: told of the walls and the changes.
        executor: who works instead, as for `Chunked.run`.

    Returns:
        The document of `avc recommend P --stiffest`: JSON values. ``stiffest_wall_n_per_m`` is that of the robust
        design, ``plain_wall_n_per_m`` that of a spring and damper, with the ``damping_ns_per_m`` that it needs.
    """
    extreme = hand_corners(problem.hands)
    simple = stiffest_wall(problem.device, with_let_go(extreme))
    try:
        best = stiffest_robust(problem, progress=progress)
    except UnsupportedError:
        best = None
    if best is None:
        helps = what_would_help(problem, extreme)
    else:
        helps = what_would_help_robust(problem, best, workers, progress, executor)
    reached = simple.stiffness_n_per_m if best is None else max(best.stiffness_n_per_m, simple.stiffness_n_per_m)
    document: dict[str, Any] = plain(
        {
            "schema": SCHEMA,
            "problem": problem.name,
            "stiffest_wall_n_per_m": reached,
            "by": "spring and damper" if best is None else "robust",
            "plain_wall_n_per_m": simple.stiffness_n_per_m,
            "damping_ns_per_m": [simple.lowest_ns_per_m, simple.highest_ns_per_m],
            "what_would_help": [vars(one) for one in helps],
            "assumed": list(assumed(problem, tried=False)),
            "not_used": list(not_used(problem)),
        }
    )
    return document
