"""Schedule of the search: likeliest candidates first, the others only where none renders the wall itself."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from avc_casadi._util.parallel import ALONE, Crew
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.loops.walls import softest_wall_n_per_m
from avc_casadi.model.hands import hand_corners
from avc_casadi.recommendation.evaluate import Evaluator
from avc_casadi.recommendation.generate import (
    SAFER,
    Alternatives,
    RobustCandidates,
    behind_observers,
    plain_candidates,
    softened_to,
    stiffer_n_per_m,
    tuned_candidates,
)

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from avc_casadi.design.robust.cma_continuation import Step
    from avc_casadi.loops.walls import DampingRange
    from avc_casadi.model.hands import Hand
    from avc_casadi.model.problem import Problem
    from avc_casadi.recommendation.rank import Judged

# Bisection between the stiffest stable wall and the next stiffer one: final ratio, largest number of steps.
_CLOSE, _MOST_HALVED = 1.05, 4
CONTINUATIONS = range(2)
"""Continuations by number, until the wanted wall is held and a law is near."""
# Distance of a law below which no continuation follows: reference-r2 is 32 % off at 1 Hz with one, 57 % without.
_NEAR_ENOUGH = 0.5
# Ratio to the next softer wall of a continuation that is tried.
_LESS = 0.96
# Names of searches, as reported.
_PLAIN, _BETWEEN = "springs and dampers", "halfway to the next stiffer wall"
_OBSERVED = "springs and dampers behind an observer"


def judged_candidates(
    problem: Problem,
    people: Hand,
    seed: int,
    limit: DampingRange,
    progress: Progress = SILENT,
    *,
    lean_on_friction: bool,
    executor: Executor | None = None,
    crew: Crew = ALONE,
    start: Step | None = None,
    climbs: range = CONTINUATIONS,
    stiffest: bool = False,
) -> Candidates:
    """Return the judged couplings: likeliest first, the others only where none renders the wall itself.

    Args:
        problem: device, wall and hands.
        people: hands of the trials.
        seed: of their draw.
        limit: the stiffest wall stable with all hands and released, with a spring and damper.
        progress: reports the candidates.
        lean_on_friction: as in `best_of`.
        executor: as in `try_coupling`.
        crew: workers of the search.
        start: as in `RobustCandidates`.
        climbs: numbers of the continuations.
        stiffest: as in `best_of`.
    """
    wall = problem.environment.stiffness_n_per_m
    # Where spring and damper stabilise no wall, laws start at the softest one.
    limit = replace(limit, stiffness_n_per_m=max(limit.stiffness_n_per_m, softest_wall_n_per_m(problem.device)))
    evaluator = Evaluator(
        problem, people, seed, progress, lean_on_friction=lean_on_friction, executor=executor, stiffest=stiffest
    )
    robust = RobustCandidates(problem, limit, crew, start)
    plainly = min(wall, limit.stiffness_n_per_m)
    corners = hand_corners(problem.hands)
    plain = list(plain_candidates(problem, corners, limit))
    # A wall beyond spring and damper needs a robust law from the start; one that nothing stabilises is softened until
    # acceptable, behind a law first, as springs mostly render less. Tuned gains come last: they share the limits of
    # spring and damper.
    held_plainly = wall <= limit.stiffness_n_per_m
    if held_plainly:
        _plainly(evaluator, plain, wall)
    if not evaluator.holds(wall):
        _behind_laws(evaluator, robust, wall, climbs, stiffest=stiffest)
    if not held_plainly:
        if evaluator.holds(limit.stiffness_n_per_m):
            # Softer at rest, but a law may have more compliance in motion.
            evaluator.ask(filter(evaluator.may_win, plain), _PLAIN)
        else:
            _plainly(evaluator, plain, limit.stiffness_n_per_m)
    for share in SAFER:
        if not evaluator.holds(share * plainly):
            evaluator.ask(softened_to(problem, corners, share * plainly), "softer springs")
    if not evaluator.holds(0.0):
        evaluator.ask(tuned_candidates(problem, progress), "tuned gains")
    if evaluator.judged:
        _closer(problem, evaluator, limit)
        evaluator.confirm()
    return Candidates(evaluator.judged, evaluator.considered, tuple(robust.steps))


@dataclass(frozen=True)
class Candidates:
    """The judged candidates.

    Attributes:
        judged: couplings tried, with their trials.
        considered: number of couplings proposed.
        steps: walls for which laws were found.
    """

    judged: list[Judged]
    considered: int
    steps: tuple[Step, ...]


def _plainly(evaluator: Evaluator, plain: list[Alternatives], stiffness_n_per_m: float) -> None:
    """Try springs and dampers, then behind an observer where they are too soft or vibrate above the threshold."""
    evaluator.ask(plain, _PLAIN)
    if not (evaluator.pleases(stiffness_n_per_m) and evaluator.holds(stiffness_n_per_m)):
        evaluator.ask(behind_observers(plain), _OBSERVED)


def _behind_laws(
    evaluator: Evaluator, robust: RobustCandidates, wall_n_per_m: float, climbs: range, *, stiffest: bool
) -> None:
    """Continue to the wanted wall; then refine the nearest of the walls reached, where stiffness is not all.

    Laws that hold the wanted wall poorly are followed by a continuation all the same.
    """
    for steps in robust.continuations(evaluator.screening(), climbs):
        _stiffest_held(evaluator, robust, steps)
        if evaluator.holds(wall_n_per_m) and robust.nearest() < _NEAR_ENOUGH:
            break
    if stiffest or evaluator.stiffest() is None:
        return
    for step in robust.refined(evaluator.screening(whole=True)):
        told = f"nearer in motion, {step.stiffness_n_per_m:.4g}"
        evaluator.ask([robust.alternatives(step)], told)


def _stiffest_held(evaluator: Evaluator, robust: RobustCandidates, steps: list[Step]) -> None:
    """Try walls from the stiffest down until one is acceptable, also with hands outside the selection."""
    asked = math.inf
    for step in reversed(steps):
        felt = step.stiffness_n_per_m
        if evaluator.holds(felt):
            return
        if felt <= _LESS * asked:
            asked = felt
            search = f"walls behind an observer, {felt:.4g}"
            if evaluator.finds([robust.alternatives(step)], felt, search) and evaluator.holds(felt):
                return


def _closer(problem: Problem, evaluator: Evaluator, limit: DampingRange) -> None:
    """Bisect towards the next stiffer wall behind a spring, a few times.

    So the rendered stiffness hardly depends on the grid of walls tried, and thus on the wanted wall. Beside a law
    between the spring that is as far from the wall by its softness alone and the stiffest: law and spring differ in
    motion, so that either may be nearer.
    """
    corners, wall = hand_corners(problem.hands), problem.environment.stiffness_n_per_m
    nearest, spring = evaluator.nearest(), evaluator.stiffest(plain=True)
    if nearest is None:
        return
    stiffest = min(wall, limit.stiffness_n_per_m)
    high: float | None = stiffest
    low = max(wall * math.exp(-nearest.distance), SAFER[-1] * stiffest)
    if spring is not None and nearest.coupling.runtime.state_feedback is None:
        low = spring.felt_n_per_m
        high = stiffer_n_per_m(problem, limit, low)
    for _ in range(_MOST_HALVED):
        if high is None or high < _CLOSE * low:
            return
        felt = math.sqrt(low * high)
        evaluator.ask(softened_to(problem, corners, felt), _BETWEEN)
        low, high = (felt, high) if evaluator.holds(felt, plain=True) else (low, felt)
