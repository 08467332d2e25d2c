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
        " *checked* by corners, draws and a search for the worst hand, *proved* with `--prove`"
    )
    leaves: ClassVar[str] = "passivity; hands outside the ranges; switching"
    scope: ClassVar[Scope | None] = "hands"
    provable: ClassVar[str] = (
        "linearly stable with every hand: delay whole or not; amplifier and resonance where L7's multiplier is found;\n"
        "gains, each row held; not with state feedback, whose innovation may pass in part"
    )

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

    def prove(self, judged: Judged, checked: LevelResult) -> LevelResult:
        """Prove it by enclosure over the whole box, row by row; enclosures do not cover an observer."""
        from avc_casadi.claims.hands_level import not_proved, proved_level  # noqa: PLC0415 - help texts need the names alone

        if not judged.behind_feedback:
            return proved_level(judged.rows, checked, judged.rests, judged.progress)
        why = "the enclosure knows gains, not an observer with state feedback"
        if all(one.multiplier is not None for one in judged.rests):
            why += "; where all of the innovation passes, the multiplier of L7 proves it"
        return not_proved(checked, why)
