"""Level L8: gains may change from row to row in sustained contact."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from avc_casadi.claims.registry import Claim, Judged

if TYPE_CHECKING:
    from avc_casadi.claims.certificate import LevelResult


class ChangingGains(Claim):
    """Stability while the gains change, in sustained contact."""

    name: ClassVar[str] = "L8"
    title: ClassVar[str] = "gains may change from row to row in kept contact"
    rank: ClassVar[float] = 80
    claims: ClassVar[str] = (
        "the gains may change: anywhere in the box that a gain table spans, each for itself and at any speed; or from"
        " row to row with all between neighbours; or by one row a sample; in kept contact with every hand of the"
        " box (with `--prove`)"
    )
    leaves: ClassVar[str] = "the anchor that pays for a change of stiffness; making and breaking contact"
    on_demand: ClassVar[bool] = True
    provable: ClassVar[str] = (
        "rows of a gain table that follow one another in kept contact: rigid device, ideal amplifier, whole delay"
        " known\nexactly, a wall with a spring; nothing beside the gains; needs pip install 'avc-casadi[proof]'"
    )

    def judge(self, judged: Judged) -> LevelResult:
        """Search for a common Lyapunov function of the rows."""
        from avc_casadi.claims.proof_levels import changes_level  # noqa: PLC0415 - loads the proofs

        assert judged.coupling is not None  # noqa: S101 - a level on demand is judged of what runs
        with judged.progress.step("patterns of changing gains"):
            return changes_level(judged.coupling, judged.rests, judged.progress)
