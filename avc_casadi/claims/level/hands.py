"""Level L5: linearly stable with a set of hands."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from avc_casadi.claims.registry import Claim, Judged

if TYPE_CHECKING:
    from avc_casadi.claims.certificate import LevelResult
    from avc_casadi.model.problem import Scope


class Hands(Claim):
    """Linear stability with every hand of the ranges, on the implemented loop."""

    name: ClassVar[str] = "L5"
    title: ClassVar[str] = "linearly stable with a set of hands"
    rank: ClassVar[float] = 50
    claims: ClassVar[str] = (
        "each frozen row linearly stable with every hand of the ranges, on the loop that runs, without friction:"
        " *checked* by corners, draws and a search for the worst hand"
    )
    leaves: ClassVar[str] = "passivity; hands outside the ranges; switching"
    scope: ClassVar[Scope | None] = "hands"

    def judge(self, judged: Judged) -> LevelResult:
        """Search for the worst hand of each row."""
        from avc_casadi.claims.feedback import feedback_level, feedback_radius  # noqa: PLC0415 - help texts need the names alone
        from avc_casadi.claims.hands_level import hands_level  # noqa: PLC0415 - help texts need the names alone
        from avc_casadi.coupling import Coupling  # noqa: PLC0415 - help texts need the names alone

        draws, seed = judged.draws, judged.seed
        if judged.behind_feedback:
            coupling = Coupling.of(judged.problem, judged.gains)
            return feedback_level(feedback_radius(coupling, draws=draws, seed=seed), judged.rows)
        return hands_level(judged.rows, draws=draws, seed=seed, progress=judged.progress)
