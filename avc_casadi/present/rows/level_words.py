"""English of certificates: what a level claims and finds, what a pair and a port are certified for."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import singledispatch

from avc_casadi._util.text import quantity
from avc_casadi._util.units import Units
from avc_casadi.claims.engine_port import PortPassivity
from avc_casadi.claims.level_claims import (
    BandOfOneRow,
    BandOfRows,
    BehindFeedback,
    DelayTooLong,
    DetentsBehindFeedback,
    HandsClaim,
    LevelFinding,
    LevelName,
    NegativeStiffness,
    NonIdeality,
    NoProofWithPaperHold,
    NoRowHasGains,
    NotJudged,
    NotMet,
    ObserverClaim,
    PassivityClaim,
    PassivityCondition,
    RestFinding,
    RowFault,
    RowsMissing,
    UnstableBehindObserver,
    UnstablePole,
    UnstableRows,
    Unsupported,
    WhyNotJudged,
)
from avc_casadi.claims.prove.grounds import Outcome
from avc_casadi.claims.zwidth import CurveKey, NoWallProof, WallClaim
from avc_casadi.design.pair_certificate import PairCertificate
from avc_casadi.design.virtual_tool import PairFault
from avc_casadi.model.hands import hand_text
from avc_casadi.model.problem import Model
from avc_casadi.recommendation.recommendation import LimitCycleFreedom

_HOLDS: dict[Model, str] = {"paper": "the paper's hold", "sampled-data": "the sampled-data hold"}
_NON_IDEALITIES = {
    NonIdeality.AMPLIFIER: "device.amplifier_bandwidth_hz",
    NonIdeality.RESONANCE: "device.resonance",
    NonIdeality.PART_OF_SAMPLE: "part of a sample of delay (device.delay_samples)",
}
_WORST_FIRST: tuple[Outcome, ...] = ("refuted", "open", "proved")
"""Outcomes of proofs in the order in which they are counted."""


@dataclass(frozen=True)
class LevelText:
    """What a level is called, what it claims if it is met, and what it does not cover."""

    title: str
    claims: str
    leaves: str


LEVEL_TEXTS = {
    "L0": LevelText(
        "passive at each row's own frequency",
        "Re Z_h >= 0 at each row's own frequency, the paper's (12); a table of one row is judged at every frequency of"
        " the problem",
        "other frequencies, although the hand excites them all",
    ),
    "L1": LevelText(
        "passive in a band about each row's own frequency",
        "Re Z_h >= 0 in a band of frequencies about each row's own (`band_factor`)",
        "frequencies outside the band",
    ),
    "L2": LevelText(
        "passive at all frequencies, paper's hold",
        "each frozen row is passive with this wall at every frequency, with the paper's hold",
        "the hold of a real device, which keeps each force for a whole sample",
    ),
    "L3": LevelText(
        "passive at all frequencies, sampled-data hold",
        "each frozen row is passive with this wall at every frequency, with the sampled-data hold: the exact condition"
        " of Colgate and Schenkel",
        "changing gains; friction, encoder, saturation",
    ),
    "L4": LevelText(
        "passive with any passive wall (Llewellyn)",
        "Llewellyn's condition (6): passive with any passive wall that the device's own loop computes each sample",
        "what L2 or L3 does not cover, whichever has the problem's hold; the tool of a physics engine (see the "
        "engine's port)",
    ),
    "L5": LevelText(
        "linearly stable with every hand of the range",
        "with the gains of any single row, the sampled loop without friction is linearly stable with every hand of the "
        "range; *checked* with extreme hands, random hands and a search for the worst hand",
        "passivity; hands outside the range; switching between rows",
    ),
    "L7": LevelText(
        "settles with every hand, making and breaking contact",
        "the device settles with each frozen row and every hand of the range, for any place of rest and any initial"
        " state, making and breaking contact (with `--prove`)",
        "changing gains; friction, encoder; backlash, with which the claim is open",
    ),
}
"""Words of `claims.levels.LEVELS`."""


def level_name_clauses(name: LevelName, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    """Return the title of a level."""
    return (LEVEL_TEXTS[name.key].title,)


@singledispatch
def level_clauses(finding: LevelFinding, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    """Return what a level claims, or what it finds of the rows where that is not met."""
    raise TypeError(f"no words for {type(finding).__name__}")


@level_clauses.register
def _passivity_claim(claim: PassivityClaim, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    """Return the claim of a level of passivity: its condition, the hold of the model, and the corners judged."""
    if claim.condition is PassivityCondition.LLEWELLYN:
        condition = "each row of gains, kept constant, meets Llewellyn's condition (6) for any passive environment"
    elif claim.condition is PassivityCondition.PASSIVE:
        condition = "each row of gains, kept constant, is passive with this wall at every frequency up to Nyquist"
    else:
        condition = f"Re Z_h >= 0 {_band(claim.band)}"
    text = f"{condition}, with {_HOLDS[claim.hold]}"
    if claim.corners is not None:
        text += ", with the device as declared"
    if claim.corners is not None and claim.corners > 1:
        text += f" at {claim.corners} extreme combinations of [device.range]"
    return (text,)


def _band(band: BandOfRows | BandOfOneRow | None) -> str:
    """Return the frequencies of a claim on Re Z_h."""
    if isinstance(band, BandOfOneRow):
        return f"from {band.low_hz:.4g} to {band.high_hz:.4g} Hz, where the only row of gains runs"
    if isinstance(band, BandOfRows) and band.factor != 1:
        return f"from 1/{band.factor:g} to {band.factor:g} times the frequency of each row of gains"
    return "at the frequency of each row of gains"


@level_clauses.register
def _hands_claim(claim: HandsClaim, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    effort = f"{claim.corners} extreme hands, {claim.draws} random hands (seed {claim.seed}) and a search of the ranges"
    stable = f"each row of gains, kept constant, is linearly stable, without friction, with {effort}"
    return stable, "switching between rows of gains is not covered"


@level_clauses.register
def _observer_claim(claim: ObserverClaim, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    stable = "the loop with observer and state feedback is linearly stable, without friction"
    hand = "with the worst hand that a search of [hands] found"
    shares = (
        "for any share of the innovation that passes the dead zone, and any share of the force that the limit leaves"
    )
    return (f"{stable}, {hand}, {shares}",)


@level_clauses.register
def _no_row_has_gains(finding: NoRowHasGains, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    return (f"Not met: none of {finding.rows} rows has gains",)


@level_clauses.register
def _rows_missing(finding: RowsMissing, units: Units) -> tuple[str, ...]:
    return f"Not met: {_without_gains(finding.missing)}", *level_clauses(finding.claim, units)


def _without_gains(rows: int) -> str:
    return f"{rows} rows of the table have no gains"


@level_clauses.register
def _not_met(finding: NotMet, units: Units) -> tuple[str, ...]:
    failed = f"Not met by {finding.failed} of {finding.rows} rows"
    fact = f"{failed}: that of {finding.worst_hz:.5g} Hz has {_row_fault(finding.fault, units)}"
    return (fact, _without_gains(finding.missing)) if finding.missing else (fact,)


def _row_fault(fault: RowFault, units: Units) -> str:
    """Return what fails of a row."""
    if isinstance(fault, UnstablePole):
        return "a pole outside the unit circle"
    if isinstance(fault, NegativeStiffness):
        return f"a negative DC stiffness of {quantity(fault.stiffness_n_per_m, units.unit('N/m'))}"
    where = f"at {fault.frequency_hz:.5g} Hz" if fault.frequency_hz > 0 else "towards zero frequency"
    return f"a margin of {fault.margin_ns_per_m:.4g} {units.unit('N.s/m')} {where}"


@level_clauses.register
def _unstable_rows(finding: UnstableRows, units: Units) -> tuple[str, ...]:
    worst = finding.worst
    failed = f"Not met by {finding.failed} of {finding.rows} rows: the row of {finding.worst_hz:.5g} Hz"
    radius = f"a spectral radius of {worst.radius:.6g} (at {worst.frequency_hz:.4g} Hz)"
    fact = f"{failed} has {radius} with {hand_text(worst.hand, units.unit)}"
    return (fact, _without_gains(finding.missing)) if finding.missing else (fact,)


@level_clauses.register
def _unstable_behind_observer(finding: UnstableBehindObserver, units: Units) -> tuple[str, ...]:
    worst = finding.worst
    hand = hand_text(worst.hand, units.unit) if any(worst.hand.values()) else "the device released"
    share = f"{worst.values['share']:.3g} of the {'force' if finding.clipped else 'innovation'}"
    return (f"Not met: spectral radius {worst.radius:.6g} with {hand} and {share}",)


@level_clauses.register
def _rest(finding: RestFinding, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    """Return the outcome of the proofs of rest of all rows, and the sentence of the worst."""
    if finding.worst is None:
        return ("no row has gains",)
    outcomes = finding.outcomes
    if len(outcomes) == 1:
        return (finding.worst.sentence,)
    counts = ", ".join(f"{outcomes.count(outcome)} {outcome}" for outcome in _WORST_FIRST if outcome in outcomes)
    return (
        f"{counts} of {len(outcomes)} rows, each with constant gains",
        f"the row of {finding.worst_hz:.5g} Hz: {finding.worst.sentence}",
        "gains that change over time are not covered",
    )


@level_clauses.register
def _not_judged(finding: NotJudged, units: Units) -> tuple[str, ...]:
    fact, *more = refusal_clauses(finding.refusal, units)
    return fact, *more


@singledispatch
def refusal_clauses(refusal: WhyNotJudged, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    """Return why a level is not judged."""
    raise TypeError(f"no words for {type(refusal).__name__}")


@refusal_clauses.register
def _behind_feedback(refusal: BehindFeedback, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    return ("the claim covers gains alone, and these gains run behind an observer with state feedback",)


@refusal_clauses.register
def _detents_behind_feedback(refusal: DetentsBehindFeedback, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    return ("state feedback together with [detent]",)


@refusal_clauses.register
def _no_proof_with_paper_hold(refusal: NoProofWithPaperHold, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    no_proof = f"{refusal.level} with the paper's hold has no proof on a device with {properties(refusal.properties)}"
    judged_by = 'L3 judges the device as declared, and L4 with stability.model = "sampled-data"'
    return f"{no_proof}: the paper's hold gives no loop from sample to sample", judged_by


def properties(of_device: Iterable[NonIdeality]) -> str:
    """Return the properties that make a device not ideal."""
    return " and ".join(_NON_IDEALITIES[name] for name in of_device)


@refusal_clauses.register
def _delay_too_long(refusal: DelayTooLong, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    return (f"more than {refusal.most_samples} samples of delay",)


@refusal_clauses.register
def _unsupported(refusal: Unsupported, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    return (refusal.message,)


def limit_cycle_clauses(freedom: LimitCycleFreedom, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    """Return the claim of rest with every hand, or why none was tried."""
    if freedom.proof is None:
        return ("no proof attempted", "avc recommend P --prove tries a proof, which takes minutes")
    return (freedom.proof.claim, *(("for the wall alone, without [detent]",) if freedom.without_detents else ()))


def pair_clauses(certificate: PairCertificate, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    """Return what the certificate of a pair claims."""
    claim = (
        "the loop is linearly stable with every hand of [hands] and with the device released, for every device, tool, "
        "delay, steady step and contact of the declared ranges (extreme values, then a search for the worst), and for "
        "every phase of the two clocks (at samples alone if the device starts each step)"
    )
    return (claim,)


def port_clauses(passivity: PortPassivity, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    """Return what passivity at the engine's port claims."""
    claim = (
        "the port between engine and coupling is passive, with the extreme hands of [hands] and when released: "
        "the loop is stable with any engine that is passive at this port, for any mass and contact of its tool. An "
        "engine is passive if it solves the tool together with the coupling's force (implicit); an engine that moves a "
        "mass explicitly is not passive"
    )
    return (claim,)


def pair_fault_clauses(fault: PairFault, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    """Return why a pair should not run on a device."""
    if fault.least_gain_margin is None:
        return ("linearly unstable",)
    return (
        f"linearly stable, but the gain margin of K and B, or of one motor alone, is below {fault.least_gain_margin:g}",
    )


_WALLS: dict[CurveKey, str] = {
    "passive-paper": "passive, paper's hold",
    "passive-sampled-data": "passive, sampled-data",
    "passive-delayed": "passive, sampled-data, 1 sample of delay",
    "stable-released": "linearly stable without a hand",
    "stable-hands": "linearly stable with every hand",
}


def wall_claim_clauses(claim: WallClaim, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    """Return what is claimed of walls, with its qualification."""
    text = _WALLS[claim.key]
    late = claim.delay_samples
    if late:
        text += f", {late:g} sample{'' if late == 1 else 's'} of delay"
    if claim.filtered:
        text += ", with the velocity filter of the scene"
    if claim.corners > 1:
        text += f", at {claim.corners} extreme combinations of [device.range]"
    return (text,)


def no_wall_proof_clauses(refusal: NoWallProof, units: Units) -> tuple[str, ...]:  # noqa: ARG001
    """Return why passivity with the paper's hold has no proof."""
    not_known = properties(refusal.properties) or "a velocity filter"
    no_proof = f"passive with the paper's hold: no proof on a device with {not_known}"
    return (f"{no_proof}, for which the paper's hold gives no loop from sample to sample",)
