"""Level L1: passive in a band about its own frequency."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from avc_casadi.claims.registry import PassivityClaim, Where

if TYPE_CHECKING:
    from avc_casadi.model.problem import Scope


class Band(PassivityClaim):
    """The condition (12) in a band."""

    name: ClassVar[str] = "L1"
    title: ClassVar[str] = "passive in a band about its own frequency"
    rank: ClassVar[float] = 10
    claims: ClassVar[str] = "the same in a band about it (`band_factor`)"
    leaves: ClassVar[str] = "the rest of the spectrum"
    where: ClassVar[Where] = "band"
    scope: ClassVar[Scope | None] = "band"
