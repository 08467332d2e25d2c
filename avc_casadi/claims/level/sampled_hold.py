"""Level L3: passive at all frequencies, sampled-data hold."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from avc_casadi.claims.registry import PassivityClaim

if TYPE_CHECKING:
    from avc_casadi.model.problem import Model, Scope


class SampledHold(PassivityClaim):
    """Passivity at all frequencies under the hold of a sampled loop (Colgate and Schenkel)."""

    name: ClassVar[str] = "L3"
    title: ClassVar[str] = "passive at all frequencies, sampled-data hold"
    rank: ClassVar[float] = 30
    claims: ClassVar[str] = "the same, sampled-data hold: the condition of Colgate and Schenkel, exact"
    leaves: ClassVar[str] = "changing gains; friction, encoder, saturation"
    hold: ClassVar[Model | None] = "sampled-data"
    scope: ClassVar[Scope | None] = "all"
