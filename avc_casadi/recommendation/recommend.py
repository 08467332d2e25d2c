"""Recommend a coupling to deploy: what it renders, its limits and sensitivities."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from typing import Any

from avc_casadi._errors import InputError
from avc_casadi._util.parallel import Crew
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.claims.certify import quick_rest_level
from avc_casadi.claims.deployable import deployable, with_certificate
from avc_casadi.coupling import Coupling
from avc_casadi.files.problem_file import AnyProblem, as_problem, of_problem, with_wall
from avc_casadi.loops.walls import stiffest_wall
from avc_casadi.model.gains import GainSchedule
from avc_casadi.model.hands import hand_corners, with_released
from avc_casadi.model.problem import Problem
from avc_casadi.recommendation.candidates import judge_all, stiffest_rendered
from avc_casadi.recommendation.evaluator import Evaluator, Withstood, missed, off_file, withstood
from avc_casadi.recommendation.pair import recommend_bilateral, recommend_tool
from avc_casadi.recommendation.preconditions import assumed, not_used, nothing_rendered, why_infeasible
from avc_casadi.recommendation.rank import UNNOTICED, reason_of
from avc_casadi.recommendation.recommendation import LimitCycleFreedom, Recommendation
from avc_casadi.recommendation.sensitivity import trade_off, what_would_help
from avc_casadi.simulation.population.operators import people_of
from avc_casadi.simulation.population.trial import try_coupling


@of_problem
def recommend(problem: AnyProblem, hands: int = 100, seed: int = 0, **options: Any) -> Recommendation:
    """Return the coupling to deploy to a wall, a [simulation] or a [follower], with its analysis.

    Args:
        problem: with exactly one of them; or a file, or a name.
        hands: number of simulated hands, corners of [hands] among them.
        seed: of their draw.
        options: ``versions`` of the software, written into the coupling, and ``progress``; of a wall also
            ``stiffest``, that of the stiffest wall, without a damper, which a hand that moves gets within 20 %;
            ``lean_on_friction``, settling by the declared dry friction suffices; ``prove``, as `certify` does;
            ``with_trade_off``, what a disk margin costs; ``workers``, processes, this one among them; ``executor``,
            which runs the trials.

    Raises:
        InputError: faults of the file, or an option that does not apply to the remote end.
        WorkerLostError: a worker died.

    Example:
        >>> found = avc.recommend("spring", hands=10)
        >>> found.deployable
        True
    """
    stated = as_problem(problem)
    if stated.simulation is None and stated.follower is None:
        return recommend_wall(with_wall(stated), hands, seed, **options)
    of_walls = ("stiffest", "lean_on_friction", "prove", "with_trade_off", "workers", "executor")
    alien = [name for name in of_walls if name in options and options[name] not in (False, None, 1)]
    if alien:
        allowed = "allowed: hands, seed, versions, progress"
        raise InputError.of(f"is an option of walls, and P couples to another end; {allowed}", key=alien[0])
    known = {name: value for name, value in options.items() if name not in of_walls}
    recommend_pair = recommend_tool if stated.follower is None else recommend_bilateral
    return recommend_pair(stated, hands, seed, **known)


def recommend_wall(
    problem: Problem,
    hands: int = 100,
    seed: int = 0,
    *,
    stiffest: bool = False,
    lean_on_friction: bool = False,
    prove: bool = False,
    with_trade_off: bool = False,
    versions: Mapping[str, str] | None = None,
    workers: int = 1,
    progress: Progress = SILENT,
    executor: Executor | None = None,
) -> Recommendation:
    """Return the best of springs and dampers and observer laws, confirmed by other hands and devices."""
    people = people_of(problem.hands, hands, seed)
    judging = partial(
        Evaluator, people=people, seed=seed, progress=progress, lean_on_friction=lean_on_friction, executor=executor
    )
    with Crew(workers) as crew:
        helps = crew.begin(partial(what_would_help, problem))
        limit = stiffest_wall(problem.device, with_released(hand_corners(problem.hands)))
        no_stiffer = ""
        if stiffest:
            problem, evaluator, no_stiffer = stiffest_rendered(problem, limit, partial(judging, within=UNNOTICED))
        else:
            evaluator = judging(problem)
        why_none = why_infeasible(problem)
        if not (why_none or stiffest):
            judge_all(problem, evaluator, limit, progress)
        best, candidates = evaluator.best(), evaluator.candidates
        coupling, rest, off, lacks = None, None, None, no_stiffer if best is None else ""
        beyond: tuple[Withstood, ...] = ()
        if best is not None:
            mismatched = crew.begin(partial(off_file, best.coupling, seed))
            unmodelled = crew.begin(partial(withstood, best.coupling, seed))
            known, rest = with_rest(with_certificate(best.coupling, progress, prove=prove), progress)
            coupling = replace(known.with_trial(best.trial.document()), versions=versions or {})
            off, beyond = mismatched(), unmodelled()
            lacks = nothing_rendered(problem, best.coupling.static_stiffness_n_per_m, best.trial)
            lacks = lacks or missed(beyond, by_friction=lean_on_friction or best.safety == 1)
            if not lacks and best.beyond and not best.beyond[0].all():
                lacks = "a corner hand that strikes the wall at 0.3 to 1 m/s does not settle; a softer wall"
        return Recommendation(
            problem=problem,
            coupling=coupling,
            trial=None if best is None else best.trial,
            confirmed=None if best is None else best.others,
            off_file=off,
            beyond_file=beyond,
            deployable=best is not None and not lacks,
            rest=rest,
            no_stiffer=no_stiffer,
            plain_wall_n_per_m=limit.stiffness_n_per_m,
            helps=() if why_none else helps(),
            considered=evaluator.considered,
            reason=why_none or lacks or reason_of(best, candidates, evaluator.considered),
            assumed=assumed(problem, 1 if best is None or best.others is None else best.others.devices),
            not_used=not_used(problem),
            trade_off=trade_off(problem, progress) if with_trade_off and coupling is not None else (),
        )


def with_rest(coupling: Coupling, progress: Progress = SILENT) -> tuple[Coupling, LimitCycleFreedom]:
    """Return a certified coupling with L7 in its certificate, where that takes a second or two, and the result."""
    certificate = dict(coupling.certificate or {})
    levels = dict(certificate.get("levels", {}))
    if "L7" not in levels:
        level = quick_rest_level(coupling, progress)
        if level is None:
            unasked = "no proof was requested; avc recommend P --prove looks for one, in minutes"
            return coupling, LimitCycleFreedom("simulated", unasked)
        levels["L7"] = level.document()
        coupling = coupling.with_certificate(certificate | {"levels": levels})
    word, claim = levels["L7"]["outcome"], levels["L7"]["claim"]
    if coupling.problem.detent is not None:
        claim = f"{claim}; of the wall alone, without [detent]"
    return coupling, LimitCycleFreedom(word, claim)


def judged_as_recommended(
    problem: Problem,
    gains: GainSchedule,
    hands: int = 100,
    *,
    versions: Mapping[str, str] | None = None,
    progress: Progress = SILENT,
) -> Recommendation:
    """Certify and try the gains of a method as `recommend` does its own, whatever the verdict."""
    found, rest = with_rest(with_certificate(Coupling.of(problem, gains, versions=versions), progress), progress)
    tried = try_coupling(found, people_of(problem.hands, hands), 0, progress)
    verdict, beyond = deployable(found, progress), withstood(found)
    limit = stiffest_wall(problem.device, with_released(hand_corners(problem.hands))).stiffness_n_per_m
    lacks = nothing_rendered(problem, found.static_stiffness_n_per_m, tried) or missed(beyond, by_friction=False)
    return Recommendation(
        problem=problem,
        coupling=found.with_trial(tried.document()),
        trial=tried,
        off_file=off_file(found, 0),
        beyond_file=beyond,
        deployable=verdict.passed and not lacks,
        rest=rest,
        plain_wall_n_per_m=limit,
        helps=what_would_help(problem),
        reason=f"the gains of {gains.method}, as requested; {lacks or verdict.sentence}",
        assumed=assumed(problem),
        not_used=not_used(problem),
    )
