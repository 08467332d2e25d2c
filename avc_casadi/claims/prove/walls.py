"""Stiffest proved wall and stiffest wall stable in contact: the cost of a proof."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from avc_casadi.claims.prove.held_device import SampledPlantBox
from avc_casadi.claims.prove.rest import promising, prove_rest, sampled_hands, unstable_hand

if TYPE_CHECKING:
    from avc_casadi.claims.prove.law import ContactLaw
    from avc_casadi.model.device import Device

# Candidate laws at a stiffness of the wall.
Laws = Callable[[float], Sequence["ContactLaw"]]

_STEPS = 12
# Reduction of the stiffness where the stiffest promising wall is not verified.
_BACK = 0.998
_TRIES = 5


@dataclass(frozen=True)
class WallGap:
    """The stiffest walls, N/m.

    Attributes:
        proved_n_per_m: with which rest is proved; 0 where none was.
        promised_n_per_m: with a multiplier at the corners of the box: an upper bound of the proved stiffness.
        linear_n_per_m: with which the loop is stable in contact with the corners of the hands and draws.
    """

    proved_n_per_m: float
    promised_n_per_m: float
    linear_n_per_m: float


def wall_gap(
    laws: Laws,
    device: Device,
    hand: Mapping[str, tuple[float, float]],
    highest_n_per_m: float,
    *,
    steps: int = _STEPS,
    most_cells: int | None = None,
) -> WallGap:
    """Return the stiffest proved wall and the stiffest linearly stable one, by bisection.

    Args:
        laws: the candidate laws at a stiffness.
        device: the device as declared.
        hand: the box of hands.
        highest_n_per_m: a stiffness above both.
        steps: of the bisection.
        most_cells: limit of a verification; None is `MOST_CELLS` of such hands.
    """
    held = SampledPlantBox(device, hand)
    hands = sampled_hands(hand, 0)
    assert hands is not None  # noqa: S101 - `HeldDevice` has refused others

    def stable(stiffness: float) -> bool:
        return any(unstable_hand(law, device, hands) is None for law in laws(stiffness))

    def promises(stiffness: float) -> bool:
        return any(promising(law, held) > 0 for law in laws(stiffness))

    linear = _last(stable, highest_n_per_m, steps)
    wall = promised = _last(promises, linear, steps)
    for _ in range(_TRIES):
        best = max(laws(wall), key=lambda law: promising(law, held), default=None) if wall > 0 else None
        if best is None:
            break
        proof = prove_rest(best, "clip-last", device, hand, most_cells=most_cells, orbits=False)
        if proof.outcome == "proved":
            break
        wall *= _BACK
    else:
        wall = 0.0
    return WallGap(wall, promised, linear)


def same_gains(law: ContactLaw) -> Laws:
    """Return the law with other walls."""
    return lambda stiffness: (replace(law, wall_stiffness_n_per_m=stiffness),)


def _last(holds: Callable[[float], bool], highest: float, steps: int) -> float:
    """Return the last stiffness that holds, from soft to stiff."""
    if highest <= 0 or holds(highest):
        return max(highest, 0.0)
    low, high = 0.0, highest
    for _ in range(steps):
        middle = (low + high) / 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low
