"""Recommend the coupling to a wall: the best of springs and dampers and observer laws, confirmed by other hands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from avc_casadi._util.parallel import Crew
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.claims.certify import quick_rest_level
from avc_casadi.claims.deployable import DeployedCertificate, certify_deployed
from avc_casadi.coupling import Coupling
from avc_casadi.loops.plant_family import PlantFamily
from avc_casadi.loops.stable_walls import stiffest_wall
from avc_casadi.model.gains import GainSchedule
from avc_casadi.model.problem import Problem
from avc_casadi.recommendation.candidates import judge_all, stiffest_rendered
from avc_casadi.recommendation.damped_wall import damped_wall
from avc_casadi.recommendation.evaluator import (
    Evaluator,
    UnmodelledTrial,
    try_perturbed_devices,
    unmet_requirements,
    unmodelled_trials,
)
from avc_casadi.recommendation.preconditions import assumed, not_used, nothing_rendered
from avc_casadi.recommendation.rank import UNNOTICED, Candidate, Safety, why_best
from avc_casadi.recommendation.reasons import AsRequested, NoneStable, Reason, StrikeUnsettled
from avc_casadi.recommendation.recommendation import (
    Decision,
    LimitCycleFreedom,
    NoWallCoupling,
    WallLimits,
    WallRecommendation,
)
from avc_casadi.recommendation.refusals import refusal
from avc_casadi.recommendation.request import Request
from avc_casadi.recommendation.sensitivity import WallSensitivity, trade_off, what_would_help
from avc_casadi.simulation.population.operators import people_of
from avc_casadi.simulation.population.trial import try_coupling


class WallDesign:
    """Design of a coupling to a wall; with `stiffest` the wall is the stiffest that can be rendered."""

    def __init__(self, problem: Problem, request: Request, crew: Crew) -> None:
        """Find the stiffest wall of a spring and damper, and prepare the hands that judge each coupling.

        With `stiffest` the wall is the stiffest that a coupling renders, which is searched here.
        """
        self.request = request
        self._crew = crew
        self._sensitivities: Callable[[], tuple[WallSensitivity, ...]] = crew.begin(partial(what_would_help, problem))
        self._limit = stiffest_wall(PlantFamily.of(problem))
        if request.stiffest:
            # The search reports its walls itself.
            near = partial(Evaluator, request=replace(request, progress=SILENT), within=UNNOTICED)
            self.problem, self._evaluator, no_stiffer = stiffest_rendered(problem, self._limit, near, request.progress)
        else:
            self.problem = problem
            self._evaluator = Evaluator(problem, request)
            no_stiffer = None
        self.limits = WallLimits(self._limit.stiffness_n_per_m, no_stiffer)

    def why_infeasible(self) -> Reason | None:
        """Return why no coupling is deployable at any gains; None where one may be."""
        return refusal(self.problem.end, self.problem)

    def best(self) -> Candidate | None:
        """Return the best coupling; None where none is deployable."""
        if not self.request.stiffest:  # those of the stiffest wall are judged with it
            judge_all(self.problem, self._evaluator, self._limit, self.request.progress)
        return self._evaluator.best()

    def recommendation(self, best: Candidate) -> WallRecommendation:
        """Return the answer with a coupling: certificate, trials beyond the file, limits, and why it is the best."""
        request, problem = self.request, self.problem
        perturbed = self._crew.begin(partial(try_perturbed_devices, best.coupling, request.seed))
        unmodelled = self._crew.begin(partial(unmodelled_trials, best.coupling, request.seed))
        certificate = certify_deployed(best.coupling, request.progress, prove=request.prove)
        certificate, rest = with_rest(certificate, best.coupling, request.progress)
        perturbed_devices, beyond = perturbed(), unmodelled()
        decision, shortfall = _shortfall(
            problem, best, beyond, by_friction=request.lean_on_friction or best.safety is Safety.BY_FRICTION
        )
        return WallRecommendation(
            problem=problem,
            coupling=replace(best.coupling, certificate=certificate, trial=best.trial, versions=request.versions),
            trial=best.trial,
            claims=certificate.verdict,
            confirmed=best.others,
            perturbed_devices=perturbed_devices,
            unmodelled_effects=beyond,
            decision=decision,
            rest=rest,
            limits=self.limits,
            sensitivities=self._sensitivities(),
            considered=self._evaluator.considered,
            why=shortfall or why_best(best, self._evaluator.candidates),
            assumed=assumed(problem, 1 if best.others is None else best.others.devices),
            not_used=not_used(problem),
            trade_off=trade_off(problem, request.progress) if request.with_trade_off else (),
            damped_wall=damped_wall(best.coupling),
        )

    def no_coupling(self, infeasible: Reason | None) -> NoWallCoupling:
        """Return the answer without a coupling, which is infeasible for a reason, or else was refused by trials."""
        evaluator = self._evaluator
        return NoWallCoupling(
            problem=self.problem,
            limits=self.limits,
            sensitivities=() if infeasible else self._sensitivities(),
            considered=evaluator.considered,
            why=infeasible or self.limits.no_stiffer or NoneStable(evaluator.considered),
            assumed=assumed(self.problem),
            not_used=not_used(self.problem),
        )


def _shortfall(
    problem: Problem, best: Candidate, beyond: tuple[UnmodelledTrial, ...], *, by_friction: bool
) -> tuple[Decision, Reason | None]:
    """Return whether a linearly stable coupling passes its trials, and why not: nothing rendered, or unsettled hands.

    `by_friction` counts hands that settle only by dry friction.
    """
    nothing = nothing_rendered(problem, best.coupling.static_stiffness_n_per_m, best.trial)
    if nothing is not None:
        return Decision.NOTHING_RENDERED, nothing
    unmet = unmet_requirements(beyond, by_friction=by_friction)
    if unmet is not None:
        return Decision.REQUIREMENT_UNMET, unmet
    if best.beyond and not best.beyond[0].all():
        return Decision.STRIKE_UNSETTLED, StrikeUnsettled()
    return Decision.DEPLOYABLE, None


def with_rest(
    certificate: DeployedCertificate, coupling: Coupling, progress: Progress = SILENT
) -> tuple[DeployedCertificate, LimitCycleFreedom]:
    """Return a certificate with L7, the proof of rest, where that takes a second or two, and what it says."""
    proof = certificate.certificate.levels.get("L7")
    if proof is None:
        proof = quick_rest_level(coupling, progress)
        if proof is None:
            return certificate, LimitCycleFreedom()
        certificate = certificate.with_level(proof)
    return certificate, LimitCycleFreedom(proof, without_detents=coupling.problem.detent is not None)


def judged(coupling: Coupling, schedule: GainSchedule, hands: int, progress: Progress) -> WallRecommendation:
    """Return the coupling of a schedule certified and tried by so many hands, whatever the verdict."""
    problem = coupling.problem
    certificate, rest = with_rest(certify_deployed(coupling, progress), coupling, progress)
    tried = try_coupling(coupling, people_of(problem.hands, hands), 0, progress)
    claims = certificate.verdict
    beyond = unmodelled_trials(coupling)
    limit = stiffest_wall(PlantFamily.of(problem)).stiffness_n_per_m
    nothing = nothing_rendered(problem, coupling.static_stiffness_n_per_m, tried)
    unmet = unmet_requirements(beyond, by_friction=False)
    if nothing is not None:
        decision = Decision.NOTHING_RENDERED
    elif unmet is not None:
        decision = Decision.REQUIREMENT_UNMET
    else:
        decision = Decision.DEPLOYABLE if claims.passed else Decision.CLAIM_FAILS
    return WallRecommendation(
        problem=problem,
        coupling=replace(coupling, certificate=certificate, trial=tried),
        trial=tried,
        claims=claims,
        perturbed_devices=try_perturbed_devices(coupling, 0),
        unmodelled_effects=beyond,
        decision=decision,
        rest=rest,
        limits=WallLimits(limit),
        sensitivities=what_would_help(problem),
        why=AsRequested(schedule.method, nothing or unmet, claims),
        assumed=assumed(problem),
        not_used=not_used(problem),
        damped_wall=damped_wall(coupling),
    )
