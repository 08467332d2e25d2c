"""Level L2: passive at all frequencies, paper's hold."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from avc_casadi.claims.registry import PassivityClaim

if TYPE_CHECKING:
    from avc_casadi.model.problem import Model, Scope


class PaperHold(PassivityClaim):
    """Passivity at all frequencies under the hold of the paper."""

    name: ClassVar[str] = "L2"
    title: ClassVar[str] = "passive at all frequencies, paper's hold"
    rank: ClassVar[float] = 20
    claims: ClassVar[str] = "each frozen row passive with this wall at every frequency, paper's hold"
    leaves: ClassVar[str] = "the hold of a real device: each force stands for a whole sample"
    hold: ClassVar[Model | None] = "paper"
    scope: ClassVar[Scope | None] = "all"
