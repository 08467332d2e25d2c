"""A sample with dry friction in three pieces, for compiled code that can skip what does not happen.

Most samples hold no change between sliding and sticking, and a loop in C ends at the first stretch that fills its time.
CasADi's own evaluation has no branches and always goes through all stretches; skipped ones would not change a bit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from avc_casadi.scene.loop import Expr


@dataclass(frozen=True)
class Split:
    """The pieces, as CasADi functions.

    Attributes:
        computer: (states, inputs, parameters) -> (next of the states behind the plant's, traces, drive); the drive is
            the held force, that before it, the share of the sample until it arrives, the target and its velocity.
        until_event: (plant state, [force, target, its velocity, time left, breaking away], parameters) -> (plant state,
            [time used, breaking away]).
        to_the_end: the same arguments -> plant state.
        substeps: series a sample.
        events: changes that are located in each of them.
        late: whether the force before acts first.
        sample_time_s: T.
    """

    computer: Any
    until_event: Any
    to_the_end: Any
    substeps: int
    events: int
    late: bool
    sample_time_s: float


def column(*symbols: Expr) -> Expr:
    """Stack symbols, in the order in which CasADi stores their entries."""
    import casadi as ca  # noqa: PLC0415

    return ca.veccat(*symbols) if symbols else ca.SX(0, 1)
