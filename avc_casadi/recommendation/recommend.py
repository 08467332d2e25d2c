"""Recommend a coupling to deploy, with its rendered stiffness, its limits and their sensitivities."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from avc_casadi._util.parallel import Crew
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.claims.deployable import certified, deployable
from avc_casadi.coupling import Coupling
from avc_casadi.files.problem_file import AnyProblem, of_problem, with_wall
from avc_casadi.loops.walls import stiffest_wall
from avc_casadi.model.hands import hand_corners, with_released
from avc_casadi.model.problem import Problem
from avc_casadi.recommendation.beyond_file import Withstood, margins, missed
from avc_casadi.recommendation.candidates import judge_all
from avc_casadi.recommendation.evaluator import Evaluator
from avc_casadi.recommendation.limit_cycle_freedom import with_rest
from avc_casadi.recommendation.perturbed_devices import off_file
from avc_casadi.recommendation.preconditions import assumed, not_used, nothing_rendered, why_infeasible
from avc_casadi.recommendation.rank import best_of, devices_of, reason_of
from avc_casadi.recommendation.recommendation import Recommendation
from avc_casadi.recommendation.sensitivity import what_would_help
from avc_casadi.recommendation.trade_off import trade_off
from avc_casadi.simulation.population.operators import people_of
from avc_casadi.simulation.population.trial import try_coupling

if TYPE_CHECKING:
    from avc_casadi.model.gains import GainSchedule


def judged_as_recommended(
    problem: Problem,
    gains: GainSchedule,
    hands: int = 100,
    *,
    versions: Mapping[str, str] | None = None,
    progress: Progress = SILENT,
) -> Recommendation:
    """Certify and try the gains of a method as `recommend` does its own, whatever the verdict."""
    found = certified(Coupling.of(problem, gains, versions=versions), progress)
    found, rest = with_rest(found, progress)
    tried = try_coupling(found, people_of(problem.hands, hands), 0, progress)
    verdict = deployable(found, progress)
    extreme = hand_corners(problem.hands)
    limit = stiffest_wall(problem.device, with_released(extreme))
    beyond = margins(found)
    lacks = nothing_rendered(problem, found.static_stiffness_n_per_m, tried) or missed(beyond, by_friction=False)
    return Recommendation(
        problem=problem,
        coupling=found.with_trial(tried.document()),
        trial=tried,
        confirmed=None,
        off_file=off_file(found, 0),
        beyond_file=beyond,
        deployable=verdict.passed and not lacks,
        rest=rest,
        stiffest_wall_n_per_m=limit.stiffness_n_per_m,
        plain_wall_n_per_m=limit.stiffness_n_per_m,
        with_friction_n_per_m=None,
        helps=what_would_help(problem, extreme),
        considered=1,
        reason=f"the gains of {gains.method}, as asked for; {lacks or verdict.sentence}",
        assumed=assumed(problem, found),
        not_used=not_used(problem),
    )


@of_problem
def recommend(
    problem: AnyProblem,
    hands: int = 100,
    seed: int = 0,
    *,
    lean_on_friction: bool = False,
    prove: bool = False,
    with_trade_off: bool = False,
    versions: Mapping[str, str] | None = None,
    workers: int = 1,
    progress: Progress = SILENT,
    executor: Executor | None = None,
) -> Recommendation:
    """Return the coupling to deploy.

    Candidates are springs and dampers and laws of a convex program, linearly stable with every hand of [hands] and
    released, with a disk margin. They are ranked by safety: all hands settle without dry friction, then with the
    declared one, then as many as possible; then by whether the residual vibration is below the detection threshold of
    nine hands in ten; then by impedance mismatch from 1 to 30 Hz, with a price on a long settling time when released;
    of those within a just noticeable error the plainest. Twice as many hands outside the selection confirm the choice,
    on devices throughout [device.range].

    Args:
        problem: device with its ranges, wall and hands; or a problem file, or a name of the catalogue.
        hands: number of simulated hands, corners of [hands] among them.
        seed: of their draw.
        lean_on_friction: whether settling by the declared dry friction alone suffices.
        prove: request proofs of the chosen coupling, as `certify` does; without it limit-cycle freedom is proved where
            that takes a second or two, and simulated otherwise.
        with_trade_off: tell what a disk margin costs in impedance error and ripple too, at four of them.
        versions: of the software that made it, by package; written into the coupling.
        workers: processes, this one among them; more than one start this program anew, so that a script needs its
            guard. The result does not depend on it.
        progress: reports the candidates tuned, judged and tried.
        executor: runs the trials, as for `mapped`: for many thousands.

    Raises:
        InputError: workers that are no whole number of 1 or more.
        WorkerLostError: a worker died.

    Example:
        >>> found = avc.recommend("spring", hands=10)
        >>> found.felt()["share_of_wall"] > 0.99 and found.felt()["stiffness_n_per_m"] < found.stiffest_wall_n_per_m
        True
    """
    problem = with_wall(problem)
    people, extreme = people_of(problem.hands, hands, seed), hand_corners(problem.hands)
    why_none = why_infeasible(problem)
    evaluator = Evaluator(problem, people, seed, progress, lean_on_friction=lean_on_friction, executor=executor)
    with Crew(workers) as crew:
        helps = crew.begin(partial(what_would_help, problem, extreme))
        limit = stiffest_wall(problem.device, with_released(extreme))
        if not why_none:
            judge_all(problem, evaluator, limit, progress)
        best = evaluator.best()
        judged, considered = evaluator.judged, evaluator.considered
        declared_n = problem.device.coulomb_friction_n
        leaning = best_of(judged, lean_on_friction=True, stiffest=True) if judged and declared_n > 0 else None
        coupling, rest, off, lacks = None, None, None, ""
        beyond: tuple[Withstood, ...] = ()
        if best is not None:
            mismatched = crew.begin(partial(off_file, best.coupling, seed))
            unmodelled = crew.begin(partial(margins, best.coupling, seed))
            known = certified(best.coupling, progress, prove=prove)
            known, rest = with_rest(known, progress)
            coupling = replace(known.with_trial(best.trial.document()), versions=versions or {})
            off, beyond = mismatched(), unmodelled()
            lacks = missed(beyond, by_friction=lean_on_friction or best.safety == 1)
        held = [one.coupling.static_stiffness_n_per_m for one in judged]
        nothing = "" if best is None else nothing_rendered(problem, best.coupling.static_stiffness_n_per_m, best.trial)
        return Recommendation(
            problem=problem,
            coupling=coupling,
            trial=None if best is None else best.trial,
            confirmed=None if best is None else best.others,
            off_file=off,
            beyond_file=beyond,
            deployable=best is not None and not nothing and not lacks,
            rest=rest,
            stiffest_wall_n_per_m=max([limit.stiffness_n_per_m, *held]),
            plain_wall_n_per_m=limit.stiffness_n_per_m,
            with_friction_n_per_m=None if leaning is None else leaning.coupling.static_stiffness_n_per_m,
            helps=() if why_none else helps(),
            considered=considered,
            reason=why_none or nothing or lacks or reason_of(best, judged, considered),
            assumed=assumed(problem, None if best is None else best.coupling, devices=devices_of(best)),
            not_used=not_used(problem),
            trade_off=trade_off(problem, progress) if with_trade_off and coupling is not None else (),
        )
