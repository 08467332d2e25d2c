"""What `avc solve` answers: the gains of one method, judged."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from avc_casadi._util.json_values import plain
from avc_casadi.claims.certify import Certificate
from avc_casadi.claims.deployable import Deployable, DeployedCertificate, deployable
from avc_casadi.coupling import Coupling
from avc_casadi.files.coupling_file import gain_document
from avc_casadi.loops.wall import passive_limit_n_per_m
from avc_casadi.model.gains import GainSchedule
from avc_casadi.model.problem import Problem
from avc_casadi.paper.errata import PAPER_ERRORS, PaperError
from avc_casadi.paper.realism import RealismResult, judge_realism


@dataclass(frozen=True, eq=False)
class SolvedGains:
    """The gains of one method, judged.

    Attributes:
        problem: the problem as stated.
        gains: the gains.
        realism: whether they feel real, frequency by frequency.
        verdict: whether they may be deployed; None where no row has gains.
        certificate: the levels of the gains; None where they were not judged.
    """

    problem: Problem
    gains: GainSchedule
    realism: RealismResult
    verdict: Deployable | None
    certificate: Certificate | None

    @classmethod
    def of(
        cls, problem: Problem, gains: GainSchedule, coupling: Coupling | None, certificate: Certificate | None
    ) -> SolvedGains:
        """Return the gains judged; ``coupling`` is the table that runs, None where no row has gains."""
        realism = judge_realism(problem, gains.impedance, gains.usable)
        return cls(problem, gains, realism, None if coupling is None else deployable(coupling), certificate)

    @property
    def as_printed(self) -> bool:
        """Whether the gains have the errors of the printed paper."""
        return self.gains.solver == "as-printed"

    @property
    def paper_errors(self) -> tuple[PaperError, ...]:
        """The errors of the printed paper, where the gains have them."""
        return PAPER_ERRORS if self.as_printed else ()

    @property
    def deployed_certificate(self) -> DeployedCertificate | None:
        """The certificate that the coupling of the gains carries; None where no row has gains, or none was judged."""
        if self.certificate is None or self.verdict is None:
            return None
        return DeployedCertificate(self.certificate, self.verdict)

    @property
    def passive_limit_n_per_m(self) -> float:
        """Largest static stiffness of any passive linear rendering."""
        return passive_limit_n_per_m(self.problem.device)

    def document(self) -> dict[str, Any]:
        """Return the `solve` document: JSON values only."""
        judged: dict[str, Any] = {
            "certificate": {"levels": {}} if self.certificate is None else self.certificate,
            "realism": self.realism,
            "passive_limit_n_per_m": self.passive_limit_n_per_m,
            "deployable": self.verdict,
        }
        errors = {"paper_errors": self.paper_errors} if self.as_printed else {}
        return gain_document(self.gains) | dict(plain(judged | errors))
