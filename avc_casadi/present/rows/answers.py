"""Results as answers: the rows that their command prints, and the data of those that need some more."""

from __future__ import annotations

from functools import singledispatch

from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.claims.admittance import AdmittanceCertificate
from avc_casadi.claims.certify import Certificate
from avc_casadi.claims.deployable import (
    CertifiedCoupling,
    ClaimRemedy,
    Deployable,
    DeployClaim,
    DetentRemedy,
    deployable,
)
from avc_casadi.claims.engine_port import PortPassivity
from avc_casadi.claims.force_feedback import ForceFeedbackCertificate
from avc_casadi.claims.joint import JointCertificate
from avc_casadi.claims.judged_for import JudgedFor
from avc_casadi.claims.law_limits import BeyondLimit
from avc_casadi.claims.level_claims import LevelFinding, LevelName, WhyNotJudged
from avc_casadi.claims.mass_width import MassWidth
from avc_casadi.claims.own_law import LawCertificate
from avc_casadi.claims.prove.grounds import Ground
from avc_casadi.claims.zwidth import NoWallProof, WallClaim, ZWidth
from avc_casadi.coupling import Coupling
from avc_casadi.design.comparison.comparison import Comparison
from avc_casadi.design.pair_certificate import PairCertificate
from avc_casadi.design.scene_coupling import SimulatedScene
from avc_casadi.design.solution import SolvedGains
from avc_casadi.design.virtual_tool import PairFault
from avc_casadi.model.gains import GainSchedule
from avc_casadi.present.row import Answer, Page
from avc_casadi.present.rows import (
    admittance,
    assumption_words,
    claim_words,
    design,
    force_feedback,
    joint,
    judge,
    law_words,
    level_words,
    proof_words,
)
from avc_casadi.present.rows.reasons import clauses, sentence
from avc_casadi.present.rows.recommend import recommendation
from avc_casadi.recommendation.admittance import AdmittanceRecommendation
from avc_casadi.recommendation.assumptions import Assumption, Unused
from avc_casadi.recommendation.force_feedback import ForceFeedbackRecommendation
from avc_casadi.recommendation.joint import JointRecommendation
from avc_casadi.recommendation.recommendation import LimitCycleFreedom, Recommendation
from avc_casadi.simulation.scene import Run

__all__ = ["answer_of", "certified", "holes", "sentence", "text_of"]


@singledispatch
def answer_of(result: object) -> Answer:
    """Return the answer of `recommend`, `solve`, `certify`, `compare`, `simulate` or `zwidth`."""
    raise TypeError(f"no rows for {type(result).__name__}")


def text_of(result: object) -> str:
    """Return a result as its command prints it."""
    return Page().rendered(answer_of(result))


answer_of.register(Recommendation, recommendation)
answer_of.register(LawCertificate, judge.own_law)
clauses.register(LawCertificate, law_words.law_clauses)
clauses.register(BeyondLimit, law_words.beyond_clauses)
clauses.register(Assumption, assumption_words.assumption_clauses)
clauses.register(Unused, assumption_words.unused_clauses)
clauses.register(Ground, proof_words.ground_clauses)
clauses.register(LevelName, level_words.level_name_clauses)
clauses.register(LevelFinding, level_words.level_clauses)
clauses.register(WhyNotJudged, level_words.refusal_clauses)
clauses.register(LimitCycleFreedom, level_words.limit_cycle_clauses)
clauses.register(WallClaim, level_words.wall_claim_clauses)
clauses.register(NoWallProof, level_words.no_wall_proof_clauses)
clauses.register(PairCertificate, level_words.pair_clauses)
clauses.register(PairFault, level_words.pair_fault_clauses)
clauses.register(PortPassivity, level_words.port_clauses)
clauses.register(Deployable, claim_words.verdict_clauses)
clauses.register(DeployClaim, claim_words.claim_clauses)
clauses.register(JudgedFor, claim_words.judged_for_clauses)
clauses.register(ClaimRemedy, claim_words.remedy_clauses)
clauses.register(DetentRemedy, claim_words.detent_remedy_clauses)
answer_of.register(AdmittanceCertificate, admittance.certificate)
answer_of.register(AdmittanceRecommendation, admittance.recommendation)
answer_of.register(ForceFeedbackCertificate, force_feedback.certificate)
answer_of.register(ForceFeedbackRecommendation, force_feedback.recommendation)
answer_of.register(MassWidth, admittance.region)
answer_of.register(JointCertificate, joint.certificate)
answer_of.register(JointRecommendation, joint.recommendation)
answer_of.register(Comparison, design.comparison)
answer_of.register(ZWidth, judge.walls)


@answer_of.register
def _scene(result: Run) -> Answer:
    problem = result.definition
    assert problem is not None  # noqa: S101 - another prints its line
    return judge.scene(SimulatedScene.of(result), problem)


@answer_of.register
def _solution(result: GainSchedule) -> Answer:
    problem = result.definition
    assert problem is not None  # noqa: S101 - another prints its line
    coupling = Coupling.from_schedule(problem, result) if result.usable.any() else None
    return design.solution(SolvedGains.of(problem, result, coupling, None))


@answer_of.register
def _certificate(result: Certificate) -> Answer:
    return judge.certificate(certified(result))


def certified(certificate: Certificate, progress: Progress = SILENT) -> CertifiedCoupling:
    """Return a certificate with the verdict on the coupling that runs."""
    problem, gains = certificate.definition, certificate.gains
    coupling: Coupling | None
    if isinstance(gains, GainSchedule):
        schedule = gains
        coupling = Coupling.from_schedule(problem, gains) if gains.usable.any() else None
    else:
        schedule = gains.schedule
        coupling = gains.for_problem(problem)
    verdict = None if coupling is None else deployable(coupling, progress)
    without_gains = holes(schedule)
    return CertifiedCoupling(certificate, verdict, notes=(without_gains,) if without_gains else ())


def holes(schedule: GainSchedule) -> str:
    """Describe what runs at the frequencies without gains; empty where there are none, or no others."""
    without = schedule.frequency_hz[~schedule.usable]
    if len(without) in {0, schedule.rows}:
        return ""
    span = f"{without.min():.4g} to {without.max():.4g} Hz"
    return f"no gains at {len(without)} frequencies, {span}: the gains of neighbouring rows are used there"
