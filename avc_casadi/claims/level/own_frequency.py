"""Level L0: passive at its own frequency."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from avc_casadi.claims.registry import PassivityClaim, Where

if TYPE_CHECKING:
    from avc_casadi.model.problem import Scope


class OwnFrequency(PassivityClaim):
    """The condition (12) of the paper."""

    name: ClassVar[str] = "L0"
    title: ClassVar[str] = "passive at its own frequency"
    rank: ClassVar[float] = 0
    claims: ClassVar[str] = (
        "Re Z_h >= 0 at each row's own frequency: the paper's (12); a table of one row runs at every frequency of the"
        " problem, and is judged there"
    )
    leaves: ClassVar[str] = "anything of the other frequencies, though the hand excites them all"
    where: ClassVar[Where] = "own"
    scope: ClassVar[Scope | None] = "pointwise"
