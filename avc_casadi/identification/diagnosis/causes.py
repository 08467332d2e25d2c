"""Counterfactual causes of an oscillation: what stabilises the loop, under hypotheses weighted by the log."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from avc_casadi.identification.diagnosis.hypothesis import (
    Hypothesis,
    Mode,
    at_period,
    growth_over,
    limit_of,
    worst_growth_of_hands,
    worst_mode,
)
from avc_casadi.identification.diagnosis.intended import Declared
from avc_casadi.identification.diagnosis.law import Law
from avc_casadi.identification.diagnosis.log import Log
from avc_casadi.identification.diagnosis.oscillation import Oscillation
from avc_casadi.identification.diagnosis.plant import Fit
from avc_casadi.identification.diagnosis.saturation import outgrows

CAUSES: Mapping[str, str] = {
    "delay": "delay",
    "damping": "too much damping",
    "encoder": "encoder limit cycle",
    "resonance": "resonance",
    "stiffness": "stiffness over the limit",
    "let-go": "hand released the device",
    "ticks": "dropped ticks",
    "rate": "halved rate",
    "relay": "a force switched by a sign",
    "rates": "two rates in one loop",
}
"""Causes by key, in words."""
OTHER = "other"
# A delay beyond the declared one by less than this, in samples, is not a finding.
_DELAY = 0.35
# Peak-to-peak amplitude, in encoder steps, above which quantisation alone does not sustain an oscillation.
_STEPS = 14.0
_MISSED = 0.01
# A hand is what is missing where the loop rests with all those of the box; with a smaller share it is half of it at
# most, and with hardly any it is not.
_HALF, _HARDLY_ANY = 0.5, 0.2
# Starting from one encoder step, an oscillation fills the device's travel after so many time constants.
_TOO_LONG = 6.0
# A larger share of the distance to stability counts as part of the cause.
_A_PART = 0.25
# Shares of the lightest and the loosest hand of the box, below which hardly any hand holds the device.
_LIGHT, _LOOSE = 0.35, 0.7
_LIKELY = 1e-3


@dataclass(frozen=True)
class Asked:
    """A weighted hypothesis.

    Attributes:
        answer: device and hand.
        weight: by the likelihood of the log.
        causes: changes that would stabilise its loop, with shares.
    """

    answer: Hypothesis
    weight: float
    causes: Mapping[str, float]


def weigh(fits: Sequence[Fit], law: Law, log: Log, found: Oscillation, declared: Declared) -> list[Asked]:
    """Return the causes under every hypothesis compatible with the log.

    A loop that would have grown far beyond the few counts over which the log oscillates is none of them, however well
    it explains those few counts.

    Args:
        fits: of the log, likeliest first.
        law: from position to force.
        log: on its tick grid.
        found: the oscillation.
        declared: the intended loop.
    """
    limit_n = declared.device.max_force_n
    fits = [fit for fit in fits if not outgrows(fit.answer, law, log, found, limit_n)] or fits
    odds = np.exp(-np.minimum(np.array([fit.cost for fit in fits]) - fits[0].cost, 700.0))
    odds /= odds.sum()
    asked = []
    for fit, weight in zip(fits, odds, strict=True):
        if weight < _LIKELY:
            continue
        some = (fit.answer, *fit.draws)
        asked += [
            Asked(answer, float(weight) / len(some), causes_of(answer, law, log, found, declared)) for answer in some
        ]
    return asked


def shares_of(asked: Sequence[Asked]) -> dict[str, float]:
    """Return the shares of the causes, largest first.

    Args:
        asked: the weighted hypotheses.
    """
    total = sum(one.weight for one in asked)
    shares: dict[str, float] = {}
    for one in asked:
        for cause, share in one.causes.items():
            shares[cause] = shares.get(cause, 0.0) + share * one.weight / total
    return dict(sorted(shares.items(), key=lambda item: -item[1]))


def causes_of(answer: Hypothesis, law: Law, log: Log, found: Oscillation, declared: Declared) -> dict[str, float]:
    """Return what would stabilise a loop: first what differs from the declaration, then what was declared itself."""
    ticks = log.ticks
    irregular = ticks.missed_share > _MISSED
    even = worst_mode(answer, law)
    slower, _, late = timing(answer, law, log, declared)
    if even.stable:
        # Over few steps quantisation sustains the oscillation, possibly because of what differs from the declaration.
        beside = {
            "ticks": irregular,
            "rate": slower or ticks.held > 1,
            "delay": late,
            "let-go": let_go(answer, declared),
            "resonance": answer.device.resonance is not None and declared.device.resonance is None,
        }
        few = found.steps < _STEPS
        if irregular and (not few or growth_over(answer, law, log.pattern) > 0):
            return {"ticks": 1.0}
        if not few:
            return {OTHER: 1.0}
        some = ["encoder", *(cause for cause, there in beside.items() if there)]
        return dict.fromkeys(some, 1 / len(some))
    causes = _of_even_ticks(answer, law, log, found, declared, even)
    missing = _share_of_ticks(answer, law, log, even.growth_per_s) if irregular else 0.0
    if missing <= _A_PART:
        return causes
    return {cause: share * (1 - missing) for cause, share in causes.items()} | {"ticks": missing}


def _of_even_ticks(
    answer: Hypothesis, law: Law, log: Log, found: Oscillation, declared: Declared, even: Mode
) -> dict[str, float]:
    """Return the causes of a loop that is unstable even without missed ticks."""
    ticks = log.ticks
    slower, meant, late = timing(answer, law, log, declared)
    faster = at_period(answer, law, intended_period(log, declared)) if slower or ticks.held > 1 else None
    if faster is not None and _rests(*faster):
        return {"rate": 1.0}
    if late and _rests(answer.delayed(meant - law.lag), shorter(law, meant)):
        return {"delay": 1.0}
    gone = 0.0
    if let_go(answer, declared):
        held = float(np.mean(worst_growth_of_hands(answer, law, declared.box()) < 0))
        if held == 1 or _changed(log, found, even.growth_per_s):
            return {"let-go": 1.0}
        gone = min(held, _HALF) if held > _HARDLY_ANY else 0.0
    left = _declared_itself(answer, law)
    # Neither the declared rate or delay nor a lower gain stabilises the loop alone: each has the share that it
    # contributes.
    differs = {"rate": faster, "delay": (answer.delayed(meant - law.lag), shorter(law, meant)) if late else None}
    for cause, mended in differs.items():
        share = 0.0 if mended is None or OTHER in left else _share_of_way(answer, mended[0], law, mended[1])
        if share > _A_PART:
            left = {cause: share} | {other: part * (1 - share) for other, part in left.items()}
            break
    return {cause: share * (1 - gone) for cause, share in left.items()} | ({"let-go": gone} if gone else {})


def timing(answer: Hypothesis, law: Law, log: Log, declared: Declared) -> tuple[bool, float, bool]:
    """Return whether the rate is slower than declared, the intended delay, and whether the delay is longer."""
    device, period = declared.device, log.ticks.period_s
    slower = declared.known and period > 1.3 * device.sample_time_s
    meant = declared.longest_delay * (device.sample_time_s / period if slower else 1.0)
    return slower, meant, float(answer.device.delay_samples) + law.lag > meant + _DELAY


def _share_of_ticks(answer: Hypothesis, law: Law, log: Log, even_per_s: float) -> float:
    """Return the share of the growth rate that missed ticks contribute."""
    as_ran = growth_over(answer, law, log.pattern)
    return max(0.0, 1 - even_per_s / as_ran) if as_ran > 0 else 0.0


def _declared_itself(answer: Hypothesis, law: Law) -> dict[str, float]:
    """Return the shares of resonance and gains of the declared loop that are too large."""
    if answer.device.resonance is not None and _rests(answer.without_mode(), law):
        return {"resonance": 1.0}
    away = {gain: _away(limit_of(answer, law, gain)) for gain in ("stiffness", "damping")}
    nearer = min(away, key=lambda gain: away[gain])
    if math.isinf(away[nearer]):
        return {OTHER: 1.0}
    left = {nearer: 1.0}
    if answer.device.resonance is None:
        return left
    share = _share_of_way(answer, answer.without_mode(), law, law)
    return {cause: part * (1 - share) for cause, part in left.items()} | ({"resonance": share} if share else {})


def _share_of_way(answer: Hypothesis, mended: Hypothesis, law: Law, law_mended: Law) -> float:
    """Return the share of the distance to the nearer gain limit, in logarithms, that a change removes."""
    now, then = (
        min(_away(limit_of(one, its_law, gain)) for gain in ("stiffness", "damping"))
        for one, its_law in ((answer, law), (mended, law_mended))
    )
    return max(0.0, 1 - then / now) if 0 < now < math.inf else 0.0


def _changed(log: Log, found: Oscillation, growth_per_s: float) -> bool:
    """Return whether the contact before was too long for this growth rate: something has changed."""
    touching = np.flatnonzero(log.touching)
    rested = found.begins_s - log.time_s[touching[0]] if touching.size else 0.0
    return bool(rested * growth_per_s > _TOO_LONG)


def let_go(answer: Hypothesis, declared: Declared) -> bool:
    """Return whether hardly any hand holds the device: neither a mass on it nor a grip."""
    hand, box = answer.hand, declared.hands
    if hand is None:
        return True
    mass, damping, stiffness = hand.values(0).values()
    if mass == 0:
        least_damping, least_stiffness = (ends[0] for ends in declared.grip())
        return declared.known and damping < _LOOSE * least_damping and stiffness < _LOOSE * least_stiffness
    return declared.known and mass < _LIGHT * box.mass_kg[0] and damping < _LOOSE * box.damping_ns_per_m[0]


def intended_period(log: Log, declared: Declared) -> float:
    """Return the intended sample time: as declared, or that of the log where forces are held over samples."""
    slower = declared.known and log.ticks.period_s > 1.3 * declared.device.sample_time_s
    return declared.device.sample_time_s if slower else log.ticks.sample_time_s


def _rests(answer: Hypothesis, law: Law) -> bool:
    return worst_mode(answer, law).stable


def shorter(law: Law, meant: float) -> Law:
    """Return the law with its lag limited to the intended delay."""
    return replace(law, lag=min(law.lag, int(meant)))


def _away(limit: float | None) -> float:
    return math.inf if limit is None else -math.log(limit)
