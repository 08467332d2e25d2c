"""Limit-cycle freedom of the coupling to deploy: proved, refuted, open, or simulated only."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal
from weakref import WeakKeyDictionary

from avc_casadi._util.json_values import plain
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.claims.proof_levels import promises_rest, quick_rest_level

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling
    from avc_casadi.recommendation.rank import Judged

Word = Literal["proved", "refuted", "open", "simulated"]
# Cache of results, as long as their couplings are in use.
_PROMISED: WeakKeyDictionary[Coupling, bool] = WeakKeyDictionary()


@dataclass(frozen=True)
class LimitCycleFreedom:
    """Settling of a coupling with every hand, making and breaking contact (level L7).

    Attributes:
        word: proved, refuted or open; simulated where no proof was requested.
        sentence: the claim that holds, or why it does not.
    """

    word: Word
    sentence: str

    def document(self) -> dict[str, Any]:
        """Return JSON values."""
        found: dict[str, Any] = plain(vars(self))
        return found


def with_rest(coupling: Coupling, progress: Progress = SILENT) -> tuple[Coupling, LimitCycleFreedom]:
    """Return a certified coupling with L7 in its certificate, where that takes a second or two, and the result."""
    certificate = dict(coupling.certificate or {})
    levels = dict(certificate.get("levels", {}))
    if "L7" not in levels:
        level = quick_rest_level(coupling, progress)
        if level is None:
            return coupling, LimitCycleFreedom(
                "simulated", "no proof was asked for; avc recommend P --prove asks for one, in minutes"
            )
        levels["L7"] = level.document()
        coupling = coupling.with_certificate(certificate | {"levels": levels})
    word, claim = levels["L7"]["outcome"], levels["L7"]["claim"]
    if coupling.problem.detent is not None:
        claim = f"{claim}; of the wall alone, without [detent]"
    return coupling, LimitCycleFreedom(word, claim)


def likely_provable(judged: list[Judged]) -> list[Judged]:
    """Return those for which a proof of L7 is likely, or all if there are none; a single one is not tested."""
    return ([one for one in judged if _promises(one.coupling)] or judged) if len(judged) > 1 else judged


def _promises(coupling: Coupling) -> bool:
    """Return whether a proof of L7 is likely, cached: the same couplings are compared again after each trial."""
    if coupling not in _PROMISED:
        _PROMISED[coupling] = promises_rest(coupling)
    return _PROMISED[coupling]
