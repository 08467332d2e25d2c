"""Text of a result in Python: the page that its command prints on a terminal."""

from __future__ import annotations

from functools import singledispatch
from typing import TYPE_CHECKING

from avc_casadi.claims.certificate import Certificate
from avc_casadi.claims.deployable import deployable
from avc_casadi.claims.passivity.sampled_loop import passive_limit_n_per_m
from avc_casadi.claims.zwidth import ZWidth
from avc_casadi.coupling import Coupling
from avc_casadi.design.comparison.comparison import Comparison
from avc_casadi.design.comparison.document import comparison_document
from avc_casadi.design.scene_coupling import told_beside
from avc_casadi.files.catalogue import catalogue_names
from avc_casadi.files.gain_file import gain_document
from avc_casadi.model.schedule import GainSchedule
from avc_casadi.own_law.certificate import LawCertificate
from avc_casadi.own_law.page import own_law_page
from avc_casadi.paper.errata import PAPER_ERRORS
from avc_casadi.paper.realism import judge_realism
from avc_casadi.present.pages.bilateral import bilateral_page
from avc_casadi.present.pages.certificate import certificate_page
from avc_casadi.present.pages.comparison import comparison_page
from avc_casadi.present.pages.recommendation import recommendation_page
from avc_casadi.present.pages.scene import scene_page
from avc_casadi.present.pages.solution import solution_page
from avc_casadi.present.pages.subject import holes
from avc_casadi.present.pages.virtual_tool import tool_page
from avc_casadi.present.pages.walls import walls_page
from avc_casadi.present.terminal import Page
from avc_casadi.recommendation.bilateral import BilateralRecommendation
from avc_casadi.recommendation.recommend import Recommendation
from avc_casadi.recommendation.virtual_tool import ToolRecommendation
from avc_casadi.simulation.run import Run

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem


@singledispatch
def text_of(result: object) -> str:
    """Return a result as its command prints it."""
    raise NotImplementedError(f"no page for {type(result).__name__}")


def _stated(result: GainSchedule | Run) -> Problem:
    assert result.stated is not None  # noqa: S101 - another prints its line
    return result.stated


def _shown(problem: Problem) -> str:
    """Return the problem's name as a user types it."""
    return problem.name if problem.name in catalogue_names() else f"{problem.name or 'problem'}.toml"


@text_of.register
def _recommendation(result: Recommendation) -> str:
    return recommendation_page(result.document(), result.problem, Page(), _shown(result.problem))


@text_of.register
def _tool(result: ToolRecommendation) -> str:
    return tool_page(result.document(), result.problem, Page(), _shown(result.problem))


@text_of.register
def _bilateral(result: BilateralRecommendation) -> str:
    return bilateral_page(result.document(), result.problem, Page(), _shown(result.problem))


@text_of.register
def _solution(result: GainSchedule) -> str:
    problem = _stated(result)
    document = gain_document(result) | {
        "realism": judge_realism(problem, result.impedance, result.usable).document(),
        "passive_limit_n_per_m": passive_limit_n_per_m(problem.device),
        "deployable": deployable(Coupling.of(problem, result)).document() if result.usable.any() else None,
    }
    if result.solver == "as-printed":
        document["paper_errors"] = PAPER_ERRORS
    return solution_page(document, problem, Page(), _shown(problem), None)


@text_of.register
def _certificate(result: Certificate) -> str:
    problem, gains = result.stated, result.gains
    if isinstance(gains, GainSchedule):
        coupling, notes = Coupling.of(problem, gains) if gains.usable.any() else None, holes(gains)
    else:
        coupling, notes = gains.on(problem), holes(gains.schedule)
    verdict = {"pass": False} if coupling is None else deployable(coupling).document()
    beside = {"gains": None, "notes": [*filter(None, [notes])], "proof_files": [], "deployable": verdict}
    document = result.document() | beside
    return certificate_page(document, problem, Page(), _shown(problem))


@text_of.register
def _comparison(result: Comparison) -> str:
    return comparison_page(comparison_document(result), result.stated, Page(), _shown(result.stated), None)


@text_of.register
def _run(result: Run) -> str:
    problem = _stated(result)
    return scene_page(result.document() | told_beside(result), problem, Page(), _shown(problem), None)


@text_of.register
def _walls(result: ZWidth) -> str:
    return walls_page(result.document(), result.stated, Page(), _shown(result.stated), None)


@text_of.register
def _law(result: LawCertificate) -> str:
    return own_law_page(result, Page(), _shown(result.problem))
