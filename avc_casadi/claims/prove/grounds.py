"""Grounds of a proof of rest, as data: what is proved, what refutes it, or why it is open. `present` words them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto
from typing import Literal

from avc_casadi._util.page import Worded
from avc_casadi.model.device import Device

Outcome = Literal["proved", "refuted", "open"]


class Ground(Worded):
    """Base of grounds."""


@dataclass(frozen=True)
class Settles(Ground):
    """The coupling settles with every hand of the range, making and breaking contact.

    Attributes:
        device: the device as declared, of which the proof covers mechanics, amplifier and delay.
        taps: number of taps of the multiplier.
        cells: number of cells in which it was verified.
    """

    device: Device
    taps: int
    cells: int


@dataclass(frozen=True)
class UnstableInContact(Ground):
    """The loop is unstable in contact.

    Attributes:
        spectral_radius: that of the loop.
        hand: numbers of the hand.
    """

    spectral_radius: float
    hand: dict[str, float]


class Nonlinearity(Enum):
    """What a proof with one nonlinearity of a slope from 0 to 1 does not cover."""

    PLAY = auto()
    """Play between motor and encoder."""
    GATED_CONTACT = auto()
    """A contact that is gated."""
    DEAD_ZONE = auto()
    """The dead zone of state feedback."""


@dataclass(frozen=True)
class NotCovered:
    """A nonlinearity that the proof does not cover.

    Attributes:
        nonlinearity: which one.
        width_m: its width; 0 of a gated contact.
    """

    nonlinearity: Nonlinearity
    width_m: float = 0.0


class NoMultiplierBecause(Enum):
    """Why no multiplier proves rest."""

    UNSTABLE_LAW = auto()
    """The law has a pole on or outside the unit circle while it gives no force."""
    UNSUPPORTED = auto()
    """The device or the range of its hand is not known to the proof."""
    NONE_SERVES = auto()
    """No multiplier serves all hands."""
    STOPPED = auto()
    """The verification stopped."""
    FAILED_BETWEEN = auto()
    """Each of six multipliers failed between the hands that it was found for."""


@dataclass(frozen=True)
class NoMultiplier:
    """Why no multiplier proves rest.

    Attributes:
        because: the reason.
        number: of taps of a multiplier that serves none, or of cells after which the verification stopped.
        message: what is not known of the device or the hand.
    """

    because: NoMultiplierBecause
    number: int = 0
    message: str = ""


@dataclass(frozen=True)
class Open(Ground):
    """Rest is neither proved nor refuted.

    Attributes:
        not_covered: nonlinearities that the proof does not cover.
        no_multiplier: why there is no multiplier; None where rest is proved without these nonlinearities.
    """

    not_covered: tuple[NotCovered, ...]
    no_multiplier: NoMultiplier | None


@dataclass(frozen=True)
class BeyondProof(Ground):
    """The runtime does what the proof does not know.

    Attributes:
        observer: whether an observer runs between encoder steps.
        guard: the guard that changes the force; None without one.
        outcome: outcome of the proof without these.
        without: its ground.
    """

    observer: bool
    guard: str | None
    outcome: Outcome
    without: Ground


@dataclass(frozen=True)
class Stated(Ground):
    """The ground of a proof that was read from a file, in its words."""

    sentence: str
