"""English of the claims that a deployable coupling meets, and of what to do where one fails."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import singledispatch

from avc_casadi._util.arrays import Interval
from avc_casadi._util.text import quantity
from avc_casadi._util.units import Units
from avc_casadi.claims.deployable import (
    ClaimRemedy,
    Deployable,
    DeployClaim,
    DetentClaim,
    DetentRemedy,
    DiskMarginClaim,
    NotJudgedClaim,
    StabilityClaim,
)
from avc_casadi.claims.judged_for import JudgedFor
from avc_casadi.loops.plant_family import DRAWS
from avc_casadi.model.corners import linear_values
from avc_casadi.model.hands import hand_text

_REMEDIES = {
    ClaimRemedy.RECOMMEND_OR_SOFTEN: (
        "use `avc recommend P`, which finds the deployable coupling closest to the wall, or soften the wall"
    ),
    ClaimRemedy.RECOMMEND_OR_LESS_MARGIN: ("use `avc recommend P`, soften the wall, or lower [robustness] disk_margin"),
    ClaimRemedy.WITHOUT_FEEDBACK: "use a coupling without state feedback: avc solve P --method static-tuned",
    ClaimRemedy.WITHOUT_REALISM: (
        "use a softer wall, a shorter sample time, or avc recommend, which does not require [realism]"
    ),
    ClaimRemedy.LESS_DELAY: "shorten the delay: longer delays are not computed",
}


def remedy_clauses(remedy: ClaimRemedy, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    """Return what to do where a claim fails."""
    return (_REMEDIES[remedy],)


def detent_remedy_clauses(remedy: DetentRemedy, units: Units) -> tuple[str, ...]:
    """Return what to do about unstable detents."""
    if math.isfinite(remedy.lowest_ns_per_m):
        ends = (remedy.lowest_ns_per_m, remedy.highest_ns_per_m)
        low, high = (quantity(damping, units.unit("N.s/m")) for damping in ends)
        return (f"set the damping of the detents to {low} to {high}, or make the detents weaker or wider",)
    steepest = quantity(remedy.steepest_n_per_m, units.unit("N/m"))
    return (f"make the detents weaker or wider: no damping stabilises a slope above {steepest}",)


def claim_clauses(claim: DeployClaim, units: Units) -> tuple[str, ...]:
    """Return what a claim says, or what does not hold."""
    return (f"{_fact(claim, units)}{_reservation(claim)}",)


def _reservation(claim: DeployClaim) -> str:
    """Return in which way the judged loop differs from the deployed one; empty where it does not."""
    return " (judged without the observer, which is not linear)" if claim.without_observer else ""


def detent_row_text(claim: DetentClaim, units: Units) -> str:
    """Return the claim on detents for a row that is labelled with them."""
    return f"{_detent_fact(claim, units)}{_reservation(claim)}"


def verdict_clauses(verdict: Deployable, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    """Return the verdict on a coupling: which claims fail."""
    if verdict.passed:
        return ("deployable: linearly stable with every hand of [hands] and with the device released",)
    first, *more = (claim.sentence for claim in verdict.failed)
    return f"not deployable: {first}", *more


def judged_for_clauses(judged_for: JudgedFor, units: Units) -> tuple[str, ...]:
    """Return which hands and which margin a verdict is for, in the units of the device."""
    hands = judged_for.hands
    ranges = ((hands.mass_kg, "kg"), (hands.damping_ns_per_m, "N.s/m"), (hands.stiffness_n_per_m, "N/m"))
    texts = _ranged(ranges, units)
    touched = ""
    if (contact := judged_for.contact) is not None:
        of_contact = _ranged(((contact.stiffness_n_per_m, "N/m"), (contact.damping_ns_per_m, "N.s/m")), units)
        touched = f", contacts of {', '.join(of_contact)}" if contact.touches else ", without contact"
    margins = (("a disk margin", judged_for.disk_margin), ("a gain margin", judged_for.gain_margin))
    required = [f", with {margin} of at least {least:g}" for margin, least in margins if least is not None]
    return (f"hands of {', '.join(texts)}, and released{touched}{''.join(required)}",)


def _ranged(ranges: Iterable[tuple[Interval, str]], units: Units) -> list[str]:
    """Return ranges of values with their units; of a range of one value the value."""
    return [" to ".join(quantity(end, units.unit(unit)) for end in dict.fromkeys(ends)) for ends, unit in ranges]


@singledispatch
def _fact(claim: DeployClaim, units: Units) -> str:  # noqa: ARG001
    return "the wall is not rendered: b, k and b_p are 0"


@_fact.register
def _not_judged(claim: NotJudgedClaim, units: Units) -> str:  # noqa: ARG001
    return f"not judged: {claim.refusal}"


@_fact.register
def _disk_margin(claim: DiskMarginClaim, units: Units) -> str:  # noqa: ARG001
    return f"a disk margin of {claim.margin:.2g}, below {claim.least:.2g}: may vibrate if the motor constant differs"


@_fact.register
def _stability(claim: StabilityClaim, units: Units) -> str:
    radius = f"spectral radius {claim.radius:.6g}"
    if claim.passed:
        fact = f"linearly stable {_hands_of(claim)}, {radius} at most"
    else:
        fact = f"linearly unstable {_worst_of(claim, units)}: {radius}"
    return f"in the wall with its detents: {fact}" if claim.in_detents else fact


def _hands_of(claim: StabilityClaim) -> str:
    """Return with which hands a stability claim holds."""
    if claim.name in {"let-go", "detent-let-go"}:
        return "with the device released"
    search = "search"
    if claim.corners is not None:
        search = f"{claim.corners} extreme hands, {DRAWS} random hands (seed 0) and a search"
    hands = f"with every hand of [hands] (worst by {search})"
    if claim.name == "dead-zone":
        return f"{hands}, for any output of the observer's dead zone"
    if claim.name == "clip":
        return f"{hands} and released, for any share of the force that the force limit leaves"
    return hands


def _worst_of(claim: StabilityClaim, units: Units) -> str:
    """Return the worst loop: hand, gains, device within its ranges, share of the dead zone or the clip."""
    worst = claim.worst
    text = f"with {hand_text(worst.hand, units.unit)}" if any(worst.hand.values()) else "with the device released"
    if claim.judged > 1:
        text += f" at {claim.frequency_hz:.4g} Hz ({claim.failed} of {claim.judged} gains judged)"
    if claim.ranges:
        values = linear_values(worst.device)
        text += f" (device {', '.join(f'{key} {values[key]:.4g}' for key in claim.ranges)})"
    if claim.name == "dead-zone":
        text += f" where {worst.values['share']:.3g} of the innovation passes the dead zone"
    if claim.name == "clip":
        text += f" where the force limit leaves {worst.values['share']:.3g} of the force"
    return text


@_fact.register
def _detent(claim: DetentClaim, units: Units) -> str:
    return f"detents: {_detent_fact(claim, units)}"


def _detent_fact(claim: DetentClaim, units: Units) -> str:
    """Return what holds in the valleys and at the peaks of detents, where slopes are +-slope_n_per_m, N/m."""
    slope, top = (quantity(sign * claim.slope_n_per_m, units.unit("N/m")) for sign in (1, -1))
    if claim.passed:
        leaving = (
            f"; the other hands leave the peak without oscillation, with a time constant of {claim.leaves_s:.3g} s"
        )
        return (
            f"in a valley, a spring of {slope}, linearly stable with every hand of [hands] and "
            f"released, spectral radius {claim.radius:.6g} at most; at a peak, a spring of {top}: {claim.held} of "
            f"{claim.hands} hands (or no hand) stay at the peak{'' if claim.held == claim.hands else leaving}"
        )
    if claim.in_valley:
        return f"linearly unstable at a peak, a spring of {top}: a device that leaves the peak oscillates"
    damping = quantity(claim.damping_ns_per_m, units.unit("N.s/m"))
    valley = f"in a valley, a spring of {slope} with {damping}"
    return f"linearly unstable {valley}: spectral radius {claim.radius:.6g}"
