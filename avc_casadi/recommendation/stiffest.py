"""Stiffest wall that a device renders to simulated hands, and what would raise the limit of spring and damper."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from avc_casadi._util.json_values import plain
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.loops.walls import softest_wall_n_per_m, stiffest_wall
from avc_casadi.model.hands import hand_corners, with_released
from avc_casadi.recommendation.candidates import judge_stiffest
from avc_casadi.recommendation.evaluator import Evaluator
from avc_casadi.recommendation.preconditions import assumed, not_used, why_infeasible
from avc_casadi.recommendation.rank import devices_of
from avc_casadi.recommendation.sensitivity import what_would_help
from avc_casadi.simulation.population.operators import people_of

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from avc_casadi.model.problem import Problem

# Unreachable stiffness, over the limit of spring and damper.
_FAR = 1e3


def stiffest(
    problem: Problem,
    hands: int = 100,
    seed: int = 0,
    *,
    lean_on_friction: bool = False,
    progress: Progress = SILENT,
    executor: Executor | None = None,
) -> dict[str, Any]:
    """Return the stiffest wall at which simulated hands settle as safely as in `recommend`.

    Args:
        problem: the device and its hands; its wall and detents do not matter.
        hands: number of simulated hands, corners of [hands] among them.
        seed: of their draw.
        lean_on_friction: whether settling by the declared dry friction alone suffices.
        progress: reports the couplings judged.
        executor: runs the trials, as for `mapped`.

    Returns:
        The document of `avc recommend P --stiffest`: JSON values. ``stiffest_wall_n_per_m`` is the static stiffness
        rendered by the coupling found, None where there is none; ``plain_wall_n_per_m`` is that of a spring and damper
        by linear stability alone, with the ``damping_ns_per_m`` that it needs; 0 where none is stable;
        ``what_would_help`` says what that becomes with one property of the device changed.
    """
    extreme = hand_corners(problem.hands)
    limit = stiffest_wall(problem.device, with_released(extreme))
    far = _FAR * max(limit.stiffness_n_per_m, softest_wall_n_per_m(problem.device))
    walled = problem.changed(environment={"stiffness_n_per_m": far, "damping_ns_per_m": 0.0}, detent=None)
    people = people_of(problem.hands, hands, seed)
    evaluator = Evaluator(
        walled, people, seed, progress, lean_on_friction=lean_on_friction, stiffest=True, executor=executor
    )
    if not why_infeasible(walled):
        judge_stiffest(walled, evaluator, limit)
    best = evaluator.best()
    counts = None if best is None else best.trial.counts()
    document: dict[str, Any] = plain(
        {
            "problem": problem.name,
            "stiffest_wall_n_per_m": None if best is None else best.felt_n_per_m,
            **{key: counts and counts[key] for key in ("hands", "at_rest", "at_rest_without_friction", "quiet")},
            "by": None if best is None else best.coupling.method,
            "at_force_limit": None if best is None else int(best.trial.at_force_limit.sum()),
            "confirmed": None if best is None or best.others is None else best.others.counts(),
            "plain_wall_n_per_m": limit.stiffness_n_per_m,
            "damping_ns_per_m": [limit.lowest_ns_per_m, limit.highest_ns_per_m],
            "what_would_help": [asdict(one) for one in what_would_help(walled, extreme)],
            "assumed": list(assumed(problem.changed(detent=None), devices=devices_of(best))),
            "not_used": list(not_used(problem)),
        }
    )
    return document
