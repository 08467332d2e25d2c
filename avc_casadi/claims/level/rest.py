"""Level L7: settles with every hand, making and breaking contact."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from avc_casadi.claims.registry import Claim, Judged

if TYPE_CHECKING:
    from avc_casadi.claims.certificate import LevelResult


class RestWithEveryHand(Claim):
    """Rest from any state with every hand of the box."""

    name: ClassVar[str] = "L7"
    title: ClassVar[str] = "settles with every hand, making and breaking contact"
    rank: ClassVar[float] = 70
    claims: ClassVar[str] = (
        "each frozen row settles with every hand of the box, wherever it rests and from any state, making and"
        " breaking contact, on the device that the claim names (with `--prove`)"
    )
    leaves: ClassVar[str] = "changing gains; friction, encoder; with play it is open"
    on_demand: ClassVar[bool] = True

    def judge(self, judged: Judged) -> LevelResult:
        """Summarise the proofs of the rows."""
        from avc_casadi.claims.proof_levels import rest_level  # noqa: PLC0415 - loads the proofs

        return rest_level(judged)
