"""What the claims of passivity share."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal

from avc_casadi.claims.registry import Claim, Judged

if TYPE_CHECKING:
    from avc_casadi.claims.certificate import LevelResult

Where = Literal["own", "band", "all"]
"""At which frequencies a row is judged: its own, a band about it, or all."""


class PassivityClaim(Claim):
    """Frozen gains are passive, at frequencies and with environments that a level names.

    Attributes:
        where: at which frequencies.
        any_environment: whether before any passive environment, and not this one alone.
    """

    where: ClassVar[Where] = "all"
    any_environment: ClassVar[bool] = False

    def judge(self, judged: Judged) -> LevelResult:
        """Judge the rows."""
        from avc_casadi.claims.levels import judge_passivity  # noqa: PLC0415 - help texts need the names alone

        return judge_passivity(judged, self)
