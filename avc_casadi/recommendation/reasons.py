"""Reasons of a recommendation, as data: why this coupling, why none, why no stiffer wall. `present` words them.

Values are in SI units of a linear device, or of one that turns.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto

from avc_casadi._util.page import Worded
from avc_casadi.claims.deployable import Deployable, DeployClaim
from avc_casadi.model.ends import Exchange
from avc_casadi.simulation.population.trial import Trial


class Reason(Worded):
    """Base of reasons."""


# Why no coupling is deployable at any gains.


@dataclass(frozen=True)
class NoMass(Reason):
    """The device has no mass: released, there is nothing that a coupling could hold.

    Attributes:
        to_wall: whether the coupling leads to a wall.
    """

    to_wall: bool


@dataclass(frozen=True)
class NoForce(Reason):
    """The wall has neither spring nor damper."""


@dataclass(frozen=True)
class TooLate(Reason):
    """The delay of the device is longer than linear stability is computed for.

    Attributes:
        delay_samples: largest delay of the device.
        most_samples: longest delay that is known.
    """

    delay_samples: float
    most_samples: int


@dataclass(frozen=True)
class DamperTooLarge(Reason):
    """The wall is a damper above the largest that is stable.

    Attributes:
        damping_ns_per_m: damping of the wall.
        largest_ns_per_m: the largest stable one.
    """

    damping_ns_per_m: float
    largest_ns_per_m: float


@dataclass(frozen=True)
class UnstableDetents(Reason):
    """The detents are unstable, whatever the coupling.

    Attributes:
        claim: the claim that fails.
    """

    claim: DeployClaim


@dataclass(frozen=True)
class UnstableEngine(Reason):
    """The engine's own contact is unstable, without any coupling.

    Attributes:
        contact_n_per_m: stiffest contact of the scene.
        step_s: longest step.
        mass_kg: lightest tool; infinite without a tool.
    """

    contact_n_per_m: float
    step_s: float
    mass_kg: float


@dataclass(frozen=True)
class NoJointGains(Reason):
    """No kp of a joint is well damped and robust over its ranges.

    Attributes:
        damping_ratio: the least damping ratio that is required.
        disk_margin: the least disk margin that is required.
    """

    damping_ratio: float
    disk_margin: float


@dataclass(frozen=True)
class NoPairStable(Reason):
    """No spring and damper is stable with every hand, released, tool and contact."""


@dataclass(frozen=True)
class UnstableStiffness(Reason):
    """No damper keeps a required stiffness stable with every hand, released, and all that the end declares.

    Attributes:
        required_n_per_m: that stiffness.
        end: kind of the end, the table that requires it.
    """

    required_n_per_m: float
    end: str


# Why nothing of a wall is rendered.


class NothingRenderedBecause(Enum):
    """What keeps every press from a rendered wall."""

    STEP_EXCEEDS_FORCE = auto()
    """One encoder step asks for more than the largest force."""
    PRESSES_SATURATE = auto()
    """Every press ends at the force limit."""
    FRICTION_HOLDS = auto()
    """Dry friction is no less than the largest force."""
    NO_CONTACT = auto()
    """No press ends in contact."""


@dataclass(frozen=True)
class NothingRendered(Reason):
    """Nothing of the wall is rendered.

    Attributes:
        because: what keeps it from that.
        step_m: encoder step of the device.
        friction_n: dry friction of the device.
        press_n: force of a press at the handle.
        limit_n: force limit of the device; None where there is none.
    """

    because: NothingRenderedBecause
    step_m: float
    friction_n: float
    press_n: float
    limit_n: float | None


# Why a coupling is not deployed, though it is linearly stable.


@dataclass(frozen=True)
class UnmetRequirement:
    """A requirement of [robustness] with which some hands do not settle.

    Attributes:
        key: of [robustness]; or held, of [device].
        value: its value.
        unsettled: hands that do not settle.
        hands: number of hands.
    """

    key: str
    value: float | str
    unsettled: int
    hands: int


@dataclass(frozen=True)
class UnmetRequirements(Reason):
    """Requirements of [robustness] are not met."""

    requirements: tuple[UnmetRequirement, ...]


@dataclass(frozen=True)
class StrikeUnsettled(Reason):
    """A corner hand that strikes the wall does not settle."""


class FlawKind(Enum):
    """What keeps a coupling from being complete."""

    BY_FRICTION_ALONE = auto()
    """Hands settle only thanks to the declared dry friction."""
    UNSETTLED = auto()
    """Not all hands settle."""
    VIBRATES = auto()
    """Too few hands stay below the vibrotactile threshold."""


@dataclass(frozen=True)
class Flaw(Reason):
    """Why a coupling is not complete.

    Attributes:
        kind: what it is.
        quiet: hands below the vibrotactile threshold.
        hands: number of hands.
    """

    kind: FlawKind
    quiet: int
    hands: int


# Why this coupling to a wall, or why none.


@dataclass(frozen=True)
class NoneStable(Reason):
    """No coupling is linearly stable with every hand and released.

    Attributes:
        considered: number of couplings.
    """

    considered: int


@dataclass(frozen=True)
class NoneSettles(Reason):
    """Not all simulated hands settle with any candidate.

    Attributes:
        candidates: number of deployable candidates.
    """

    candidates: int


@dataclass(frozen=True)
class NearerCandidate:
    """A coupling that is nearer to the wall, and not as safe or as quiet.

    Attributes:
        method: its method.
        error: its impedance error, without encoder steps.
        recommended_error: that of the recommended coupling.
        flaw: why it is not recommended; None where it has none.
    """

    method: str
    error: float
    recommended_error: float
    flaw: Flaw | None


@dataclass(frozen=True)
class NearestToWall(Reason):
    """The recommended coupling is the nearest to the wall of those that are as safe.

    Attributes:
        candidates: number of deployable candidates.
        by_friction: whether hands settle only thanks to the declared dry friction.
        nearer: one that is nearer, and why it is not recommended; None where there is none.
    """

    candidates: int
    by_friction: bool
    nearer: NearerCandidate | None


@dataclass(frozen=True)
class AsRequested(Reason):
    """The coupling is that of a method, as requested.

    Attributes:
        method: the method.
        shortfall: why it is not deployed though it is linearly stable; None where nothing is missing.
        claims: the claims of a deployable coupling, with their results.
    """

    method: str
    shortfall: Reason | None
    claims: Deployable


# Why no stiffer wall.


@dataclass(frozen=True)
class NotNear(Reason):
    """No stable coupling is near enough to a wall for a hand that moves.

    Attributes:
        within: impedance error that is near enough.
    """

    within: float


@dataclass(frozen=True)
class StifferWall(Reason):
    """Before a stiffer wall no coupling is complete.

    Attributes:
        wall_n_per_m: stiffness of that wall.
        tried: whether a coupling as near was tried there.
        why: why none is complete.
    """

    wall_n_per_m: float
    tried: bool
    why: Reason


@dataclass(frozen=True)
class NoWallRendered(Reason):
    """Not even before the softest wall that was tried is a coupling complete.

    Attributes:
        why: why none is complete.
    """

    why: Reason


# Why this spring and damper to another end, or why none.


@dataclass(frozen=True)
class Unsettled(Reason):
    """A stiffness with which hands do not settle, and the trial with its best dampers."""

    stiffness_n_per_m: float
    trial: Trial


@dataclass(frozen=True)
class StiffestSettled(Reason):
    """The stiffest coupling with which all hands settle, or the required stiffness.

    Attributes:
        required: whether the problem requires its stiffness.
        low_gain_margin: its gain margin where that is below the usual one; None where it is not.
        stiffer: the next stiffer one that was tried, with which hands do not settle; None where none was tried.
        exchange: how the engine hands out its state; None without an engine.
    """

    required: bool
    low_gain_margin: float | None
    stiffer: Unsettled | None
    exchange: Exchange | None = None


@dataclass(frozen=True)
class SettledWithFollower(Reason):
    """All hands settle with this coupling to a follower.

    Attributes:
        required: whether the problem requires its stiffness; else it is the stiffest without local dampers.
    """

    required: bool


@dataclass(frozen=True)
class NoGainMargin(Reason):
    """No damper keeps the gain margins."""


@dataclass(frozen=True)
class StiffnessNotReached(Reason):
    """A required stiffness is not to be had.

    Attributes:
        required_n_per_m: that stiffness.
        stiffest_n_per_m: the stiffest that is stable.
    """

    required_n_per_m: float
    stiffest_n_per_m: float


@dataclass(frozen=True)
class FollowerLimit(Reason):
    """No coupling to a follower is worth a trial.

    Attributes:
        stiffest_n_per_m: the stiffest that is stable.
    """

    stiffest_n_per_m: float


class LastTried(Enum):
    """Which coupling was tried last."""

    ANY = auto()
    SOFTEST = auto()
    SOFTEST_WITHOUT_DAMPING = auto()
    """The softest, to a follower that has no damping of its own."""


@dataclass(frozen=True)
class HandsUnsettled(Reason):
    """Not all hands settle with the last coupling that was tried.

    Attributes:
        trial: that trial.
        last: which coupling it was.
    """

    trial: Trial
    last: LastTried = LastTried.ANY


@dataclass(frozen=True)
class UnsettledWithDroppedSteps(Reason):
    """Not all hands settle with the last coupling that was tried where the engine misses steps.

    Attributes:
        hands: number of hands.
        settled: hands that settle.
        settled_with_dropped_steps: hands that settle where the engine misses steps.
    """

    hands: int
    settled: int
    settled_with_dropped_steps: int
