"""Results as answers: the rows that their command prints, and the data of those that need some more."""

from __future__ import annotations

from functools import singledispatch
from typing import Any

from avc_casadi._util.json_values import plain
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.claims.certify import Certificate
from avc_casadi.claims.deployable import deployable
from avc_casadi.claims.own_law import LawCertificate
from avc_casadi.claims.zwidth import ZWidth
from avc_casadi.coupling import Coupling
from avc_casadi.design.comparison.comparison import Comparison
from avc_casadi.design.scene_coupling import facts_of
from avc_casadi.files.coupling_file import gain_document
from avc_casadi.loops.wall import passive_limit_n_per_m
from avc_casadi.model.gains import GainSchedule
from avc_casadi.model.problem import Problem
from avc_casadi.paper.errata import PAPER_ERRORS
from avc_casadi.paper.realism import judge_realism
from avc_casadi.present.row import Answer, Page
from avc_casadi.present.rows import design, judge
from avc_casadi.present.rows.recommend import recommendation
from avc_casadi.recommendation.recommendation import Recommendation
from avc_casadi.simulation.scene import Run


@singledispatch
def answer_of(result: object) -> Answer:
    """Return the answer of `recommend`, `solve`, `certify`, `compare`, `simulate` or `zwidth`."""
    raise TypeError(f"no rows for {type(result).__name__}")


def text_of(result: object) -> str:
    """Return a result as its command prints it."""
    return Page().rendered(answer_of(result))


answer_of.register(Recommendation, recommendation)
answer_of.register(LawCertificate, judge.own_law)
answer_of.register(Comparison, lambda found: design.comparison(found.document(), found.definition))
answer_of.register(ZWidth, judge.walls)
answer_of.register(Run, lambda found: judge.scene(found.document() | facts_of(found), found.definition))


@answer_of.register
def _solution(result: GainSchedule) -> Answer:
    problem = result.definition
    assert problem is not None  # noqa: S101 - another prints its line
    coupling = Coupling.of(problem, result) if result.usable.any() else None
    return design.solution(solution_data(problem, result, coupling, None), problem)


def solution_data(
    problem: Problem, gains: GainSchedule, coupling: Coupling | None, certificate: Certificate | None
) -> dict[str, Any]:
    """Return the data of `solve`, with the certificate where one was made."""
    found = gain_document(gains) | {
        "certificate": {"levels": {}} if certificate is None else certificate.document(),
        "realism": judge_realism(problem, gains.impedance, gains.usable).document(),
        "passive_limit_n_per_m": plain(passive_limit_n_per_m(problem.device)),
        "deployable": None if coupling is None else deployable(coupling).document(),
    }
    if gains.solver == "as-printed":
        found["paper_errors"] = list(PAPER_ERRORS)
    return found


@answer_of.register
def _certificate(result: Certificate) -> Answer:
    return judge.certificate(certificate_data(result), result.definition)


def certificate_data(found: Certificate, progress: Progress = SILENT) -> dict[str, Any]:
    """Return the data of `certify`: the certificate, and the verdict on the coupling that runs."""
    problem, gains = found.definition, found.gains
    if isinstance(gains, GainSchedule):
        coupling, schedule = Coupling.of(problem, gains) if gains.usable.any() else None, gains
    else:
        coupling, schedule = gains.on(problem), gains.schedule
    verdict = {"pass": False} if coupling is None else deployable(coupling, progress).document()
    notes = [*filter(None, [holes(schedule)])]
    return found.document() | {"gains": None, "notes": notes, "proof_files": [], "deployable": verdict}


def holes(schedule: GainSchedule) -> str:
    """Describe what runs at the frequencies without gains; empty where there are none, or no others."""
    without = schedule.frequency_hz[~schedule.usable]
    if len(without) in {0, schedule.rows}:
        return ""
    span = f"{without.min():.4g} to {without.max():.4g} Hz"
    return f"no gains at {len(without)} frequencies, {span}: those of the rows beside them run there"
