"""Level L4: Llewellyn, any passive environment."""

from __future__ import annotations

from typing import ClassVar

from avc_casadi.claims.registry import PassivityClaim


class Llewellyn(PassivityClaim):
    """Llewellyn's condition (6): the coupling alone protects any passive environment from any passive hand."""

    name: ClassVar[str] = "L4"
    title: ClassVar[str] = "Llewellyn, any passive environment"
    rank: ClassVar[float] = 40
    claims: ClassVar[str] = "Llewellyn's (6): passive for any passive wall that the device's own loop computes, every T"
    leaves: ClassVar[str] = (
        "as L2 or L3, in the problem's model; an engine's tool: a mass that is moved explicitly is no passive wall, "
        "nor is one at another rate a wall of this loop (`[simulation]`, the engine's port)"
    )
    any_environment: ClassVar[bool] = True
