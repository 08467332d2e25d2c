"""What levels of a certificate claim of the rows of a gain table, and what they find, as data. `present` words it.

A level that is met has its claim as its finding.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto

from avc_casadi._util.page import Worded
from avc_casadi.claims.prove.grounds import Outcome
from avc_casadi.claims.prove.rest import Rest
from avc_casadi.loops.plant_family import WorstCase
from avc_casadi.model.problem import Model


@dataclass(frozen=True)
class LevelName(Worded):
    """A level of `LEVELS`, by its key."""

    key: str


class LevelFinding(Worded):
    """Base of findings."""


class LevelClaim(LevelFinding):
    """Base of what a level claims of each frozen row."""


# Claims of passivity.


class PassivityCondition(Enum):
    """Conditions of passivity."""

    REAL_PART = auto()
    """Re Z_h >= 0 at the frequencies of a band."""
    PASSIVE = auto()
    """Passive with this environment at every frequency."""
    LLEWELLYN = auto()
    """Llewellyn's condition, for any passive environment."""


@dataclass(frozen=True)
class BandOfRows:
    """A band about the frequency of each row.

    Attributes:
        factor: from 1/factor to factor times that frequency; at 1 it is that frequency alone.
    """

    factor: float


@dataclass(frozen=True)
class BandOfOneRow:
    """The band in which the one row of a table runs."""

    low_hz: float
    high_hz: float


@dataclass(frozen=True)
class PassivityClaim(LevelClaim):
    """A claim of passivity.

    Attributes:
        condition: what is claimed.
        hold: the model of the hold.
        band: frequencies of a claim on Re Z_h; None of the others, which are claims on every frequency.
        corners: number of corners of the device as declared; None of an ideal device.
    """

    condition: PassivityCondition
    hold: Model
    band: BandOfRows | BandOfOneRow | None = None
    corners: int | None = None


# Claims of linear stability.


@dataclass(frozen=True)
class HandsClaim(LevelClaim):
    """Linear stability with every hand.

    Attributes:
        corners: number of corner hands.
        draws: number of drawn hands.
        seed: seed of the draws.
    """

    corners: int
    draws: int
    seed: int


@dataclass(frozen=True)
class ObserverClaim(LevelClaim):
    """Linear stability behind an observer, with the worst hand and any share of dead zone and clip."""


# What fails of a row.


@dataclass(frozen=True)
class MarginFault:
    """A margin below 0.

    Attributes:
        margin_ns_per_m: the margin.
        frequency_hz: its frequency; 0 towards zero frequency.
    """

    margin_ns_per_m: float
    frequency_hz: float


@dataclass(frozen=True)
class UnstablePole:
    """A pole of the rendering outside the unit circle."""


@dataclass(frozen=True)
class NegativeStiffness:
    """A negative DC stiffness of the rendering."""

    stiffness_n_per_m: float


RowFault = MarginFault | UnstablePole | NegativeStiffness


# Findings other than a claim that is met.


@dataclass(frozen=True)
class NoRowHasGains(LevelFinding):
    """No row has gains.

    Attributes:
        rows: number of rows.
    """

    rows: int


@dataclass(frozen=True)
class RowsMissing(LevelFinding):
    """The claim is met by the rows with gains, but some have none.

    Attributes:
        missing: number of rows without gains.
        claim: what the others meet.
    """

    missing: int
    claim: LevelClaim


@dataclass(frozen=True)
class NotMet(LevelFinding):
    """Some rows do not meet the claim.

    Attributes:
        failed: number of rows that do not.
        rows: number of rows with gains.
        missing: number of rows without.
        worst_hz: frequency of the worst row.
        fault: what fails of it.
    """

    failed: int
    rows: int
    missing: int
    worst_hz: float
    fault: RowFault


@dataclass(frozen=True)
class UnstableRows(LevelFinding):
    """Some rows are linearly unstable with a hand.

    Attributes:
        failed: number of rows that are.
        rows: number of rows with gains.
        missing: number of rows without.
        worst_hz: frequency of the worst row.
        worst: its worst loop.
    """

    failed: int
    rows: int
    missing: int
    worst_hz: float
    worst: WorstCase


@dataclass(frozen=True)
class UnstableBehindObserver(LevelFinding):
    """The loop with an observer is linearly unstable.

    Attributes:
        worst: the worst loop.
        clipped: whether its share is that of the force that the clip leaves; else that of the innovation.
    """

    worst: WorstCase
    clipped: bool


@dataclass(frozen=True)
class RestFinding(LevelFinding):
    """Rest of the rows of the deployed table, each held constant.

    Attributes:
        outcomes: outcome of each row; empty without any row.
        worst: the worst proof; None without any row.
        worst_hz: frequency of its row.
    """

    outcomes: tuple[Outcome, ...] = ()
    worst: Rest | None = None
    worst_hz: float = 0.0


# Why a level is not judged.


class NonIdeality(Enum):
    """Properties that make a device not ideal."""

    AMPLIFIER = auto()
    RESONANCE = auto()
    PART_OF_SAMPLE = auto()
    """A delay that is no whole number of samples."""


class WhyNotJudged(Worded):
    """Base of reasons why a level is not judged."""


@dataclass(frozen=True)
class BehindFeedback(WhyNotJudged):
    """The gains run behind an observer with state feedback, and the level knows gains alone."""


@dataclass(frozen=True)
class DetentsBehindFeedback(WhyNotJudged):
    """Detents are not judged behind state feedback."""


@dataclass(frozen=True)
class NoProofWithPaperHold(WhyNotJudged):
    """The paper's hold gives no loop from sample to sample on a device that is not ideal.

    Attributes:
        level: name of the level.
        properties: what makes the device not ideal.
    """

    level: str
    properties: tuple[NonIdeality, ...]


@dataclass(frozen=True)
class DelayTooLong(WhyNotJudged):
    """The delay is longer than linear stability is computed for.

    Attributes:
        most_samples: longest delay that is known.
    """

    most_samples: int


@dataclass(frozen=True)
class Unsupported(WhyNotJudged):
    """A computation that does not know the device or the gains.

    Attributes:
        message: what it says of them.
    """

    message: str


@dataclass(frozen=True)
class NotJudged(LevelFinding):
    """No row is judged.

    Attributes:
        refusal: why.
    """

    refusal: WhyNotJudged
