"""Remedies of an oscillating loop, each checked on the loop model."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from avc_casadi._util.text import number
from avc_casadi.identification.diagnosis.causes import intended_period, shorter
from avc_casadi.identification.diagnosis.counterfactual import NOTHING, can_replay, replay
from avc_casadi.identification.diagnosis.hypothesis import (
    Hypothesis,
    at_period,
    growth_of_two_rates,
    growth_over,
    limit_of,
    longest_delay,
    notched_growth,
    worst_mode,
)
from avc_casadi.identification.diagnosis.intended import Declared
from avc_casadi.identification.diagnosis.law import Law
from avc_casadi.identification.diagnosis.log import Log
from avc_casadi.identification.diagnosis.model import Remedy
from avc_casadi.identification.diagnosis.relay import SwitchedForce, TwoRates
from avc_casadi.simulation.effects.filters import Notch

# Share of a limit that is used.
_RESERVE = 0.8
_FILTERS_HZ = (150.0, 60.0, 25.0)
_QUICKER = (2.0, 4.0, 8.0, 16.0, 32.0)
_FINER = (2.0, 4.0, 8.0)
_SOFTER = (0.7, 0.5, 0.35)
# Notches that are tried: frequency relative to the oscillation, gain there, relative bandwidth.
_NOTCH_TURNS = (0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.25, 1.4, 1.6)
_NOTCH_DEPTHS = (0.05, 0.3)
_NOTCH_WIDTHS = (0.5, 1.0, 2.0)
_BESIDE = 0.1
_HIGHEST = 0.45


def remedies_of(cause: str, answer: Hypothesis, law: Law, log: Log, declared: Declared) -> tuple[Remedy, ...]:
    """Return the changes that stabilise a loop, those of its cause first.

    Args:
        cause: key of the cause.
        answer: device and hand.
        law: from position to force.
        log: on its tick grid.
        declared: the intended loop.
    """
    own: Callable[[], list[Remedy]] = {
        "delay": lambda: _delay(answer, law, log, declared),
        "resonance": lambda: [
            *_notch(answer, law),
            _of("mechanics without the resonance", "resonance", math.nan, answer.without_mode(), law),
        ],
        "ticks": lambda: _ticks(answer, law, log),
        "rate": lambda: _rate(answer, law, log, declared),
        "encoder": lambda: _encoder(answer, law, log),
    }.get(cause, list)
    found = own()
    if cause != "encoder":
        gains = ["damping", "stiffness"] if cause == "damping" else ["stiffness", "damping"]
        found += [cure for gain in gains for cure in _gain(gain, answer, law)]
        found += _quicker(answer, law)
    if cause in {"stiffness", "damping"}:
        found += _delay(answer, law, log, declared)
    return tuple(cure for cure in found if cure.rests)


_SLOPES = np.geomspace(1.0, 1e-4, 33)
# The steepest minimum force: its gain relative to that of the loop.
_STEEPEST = 100.0


def remedies_of_relay(
    found: SwitchedForce, answers: Sequence[Hypothesis], log: Log, friction_n: float
) -> tuple[Remedy, ...]:
    """Return what stabilises a loop with a switched force: a boundary layer in place of an edge, or a lower level.

    Over a width w the force of a sign has the slope c/w: the loop is stable if its gain in between is at most the
    largest that is stable under every hypothesis, with a margin.

    Args:
        found: the switched force.
        answers: hypotheses compatible with the log.
        log: on its tick grid.
        friction_n: of the device.
    """
    size, law = found.force_n, found.law
    if size < 0:
        share = _RESERVE * friction_n
        change = f"{number(share, 3)} along the motion in place of {number(-size, 3)}: less than the friction"
        mode = worst_mode(answers[0], law)
        return (Remedy(change, "switched_n", share, mode.growth_per_s, mode.stable),)
    step = log.encoder_m or 1e-4 * float(np.ptp(log.position_m))
    steepest = {"position": size / step, "speed": size * log.ticks.period_s / step, "force": _STEEPEST}[found.by]
    slopes = [float(slope) for slope in steepest * _SLOPES if _all_rest(answers, _sloped(found, float(slope)))]
    if not slopes:
        return ()
    own = {"position": law.stiffness_n_per_m, "speed": law.damping_ns_per_m, "force": 1.0}[found.by]
    slope = _RESERVE * (own + slopes[0]) - own
    if not slope > 0 or not _all_rest(answers, _sloped(found, slope)):
        return ()
    width = size / slope
    change = f"the {number(size, 3)} over a width of {number(width, 3)} to either side in place of at once"
    change += f" (a slope of {number(slope, 3)})" if found.by != "force" else " (of the force itself)"
    growth = worst_mode(answers[0], _sloped(found, slope)).growth_per_s
    return (Remedy(change, "switch_width", width, growth, rests=True),)


def _sloped(found: SwitchedForce, slope: float) -> Law:
    """Return the law within the boundary layer."""
    law = found.law
    if found.by == "position":
        return replace(law, stiffness_n_per_m=law.stiffness_n_per_m + slope)
    if found.by == "speed":
        return replace(law, damping_ns_per_m=law.damping_ns_per_m + slope)
    gain = 1 + slope
    return replace(law, stiffness_n_per_m=gain * law.stiffness_n_per_m, damping_ns_per_m=gain * law.damping_ns_per_m)


def remedies_of_two_rates(found: TwoRates, answers: Sequence[Hypothesis], period_s: float) -> tuple[Remedy, ...]:
    """Return what stabilises a loop of two rates: one rate, or a lower gain of the slow part at the present rates.

    Args:
        found: the two rates.
        answers: hypotheses compatible with the log.
        period_s: of the fast part.
    """
    mode = worst_mode(answers[0], found.law)
    change = f"the {found.slow} computed every {number(1e3 * period_s, 3)} ms too"
    cures = [Remedy(change, "sample_time_s", period_s, mode.growth_per_s, mode.stable)]
    key = "stiffness_n_per_m" if found.slow == "spring" else "damping_ns_per_m"
    now = float(getattr(found.law, key))
    for factor in _SOFTER_AT_TWO_RATES:
        softer = replace(found.law, **{key: factor * now})
        growths = [growth_of_two_rates(one, softer, found.slow, found.ticks, found.late) for one in answers]
        if max(growths) < 0:
            value = _RESERVE * factor * now
            last = growth_of_two_rates(
                answers[0], replace(found.law, **{key: value}), found.slow, found.ticks, found.late
            )
            symbol = "k" if found.slow == "spring" else "b"
            change = f"{symbol} = {number(value, 3)} in place of {number(now, 3)}, at the two rates as they are"
            cures.append(Remedy(change, key, value, last, last < 0))
            break
    return tuple(cure for cure in cures if cure.rests)


def remedies_of_sign(law: Law, answers: Sequence[Hypothesis]) -> tuple[Remedy, ...]:
    """Return the damper with its sign turned, or none where that is too much.

    Args:
        law: with a damper below 0.
        answers: hypotheses compatible with the log.
    """
    now = law.damping_ns_per_m
    for value in (-now, 0.0):
        turned = replace(law, damping_ns_per_m=value)
        if _all_rest(answers, turned):
            change = f"b = {number(value, 3)} in place of {number(now, 3)}"
            growth = worst_mode(answers[0], turned).growth_per_s
            return (Remedy(change, "damping_ns_per_m", value, growth, rests=True),)
    return ()


_SOFTER_AT_TWO_RATES = np.geomspace(0.9, 0.05, 12).tolist()


def _all_rest(answers: Sequence[Hypothesis], law: Law) -> bool:
    return all(worst_mode(one, law).stable for one in answers)


def _of(change: str, key: str, value: float, answer: Hypothesis, law: Law, **factors: float) -> Remedy:
    mode = worst_mode(answer, law, **factors)
    return Remedy(change, key, value, mode.growth_per_s, mode.stable)


def _gain(gain: str, answer: Hypothesis, law: Law) -> list[Remedy]:
    limit = limit_of(answer, law, gain)
    if limit is None or limit == 1:
        return []
    key = f"{gain}_n{'' if gain == 'stiffness' else 's'}_per_m"
    now = float(getattr(law, key))
    share = _RESERVE * limit
    symbol = "k" if gain == "stiffness" else "b"
    change = (
        f"{symbol} = {number(share * now, 3)} in place of {number(now, 3)} (it settles below {number(limit * now, 3)})"
    )
    return [_of(change, key, share * now, answer, law, **{gain: share})]


def _delay(answer: Hypothesis, law: Law, log: Log, declared: Declared) -> list[Remedy]:
    meant = declared.longest_delay * declared.device.sample_time_s / log.ticks.period_s
    own = float(answer.device.delay_samples) + law.lag
    longest = longest_delay(Hypothesis(answer.delayed(own).device, answer.hand), shorter(law, 0.0))
    if longest is None or longest >= own:
        return []
    most = meant if meant <= longest else _RESERVE * longest
    change = (
        f"a delay of {number(most, 2)} in place of {number(own, 3)} samples (it settles below {number(longest, 3)})"
    )
    return [_of(change, "delay_samples", most, answer.delayed(most), shorter(law, 0.0))]


def _quicker(answer: Hypothesis, law: Law) -> list[Remedy]:
    """Return the faster velocity filter with which the loop decays fastest."""
    period = answer.device.sample_time_s
    now = law.filter_hz(period)
    if now is None:
        return []
    tried = [
        _of(
            f"a velocity filter of {number(times * now, 3)} Hz in place of {number(now, 3)}",
            "velocity_filter_hz",
            times * now,
            answer,
            replace(law, keep=law.keep**times),
        )
        for times in _QUICKER
        if times * now < _HIGHEST / period
    ]
    return sorted(tried, key=lambda cure: cure.growth_per_s)[:1]


def _notch(answer: Hypothesis, law: Law) -> list[Remedy]:
    """Return the notch with which the loop decays fastest, robust to a small detuning either way."""
    swings, period = worst_mode(answer, law).frequency_hz, answer.device.sample_time_s
    best: tuple[float, Notch] | None = None
    for turn, depth, width in itertools.product(_NOTCH_TURNS, _NOTCH_DEPTHS, _NOTCH_WIDTHS):
        if turn * swings * (1 + _BESIDE) < _HIGHEST / period:
            tried = [
                notched_growth(answer, law, Notch(turn * by * swings, depth, width))
                for by in (1 - _BESIDE, 1.0, 1 + _BESIDE)
            ]
            if best is None or max(tried) < best[0]:
                best = max(tried), Notch(turn * swings, depth, width)
    if best is None:
        return []
    growth, notch = best
    change = (
        f"a notch on the measured position at {number(notch.frequency_hz, 3)} Hz (depth {notch.depth:g}, width "
        f"{notch.width:g}), or {100 * _BESIDE:g} % beside"
    )
    return [Remedy(change, "notch_hz", notch.frequency_hz, growth, growth < 0)]


def _ticks(answer: Hypothesis, law: Law, log: Log) -> list[Remedy]:
    found = [_of("every tick in time", "dropped_share", 0.0, answer, law)]
    for factor in _SOFTER:
        softer = replace(
            law,
            stiffness_n_per_m=factor * law.stiffness_n_per_m,
            damping_ns_per_m=factor * law.damping_ns_per_m,
        )
        growth = growth_over(answer, softer, log.pattern)
        if growth < 0:
            change = (
                f"or k = {number(softer.stiffness_n_per_m, 3)} and b = {number(softer.damping_ns_per_m, 3)} "
                f" with the ticks as they are"
            )
            found.append(Remedy(change, "stiffness_n_per_m", softer.stiffness_n_per_m, growth, rests=True))
            break
    return found


def _rate(answer: Hypothesis, law: Law, log: Log, declared: Declared) -> list[Remedy]:
    period = intended_period(log, declared)
    return [_of(f"a rate of {number(1 / period)} Hz", "sample_time_s", period, *at_period(answer, law, period))]


def _encoder(answer: Hypothesis, law: Law, log: Log) -> list[Remedy]:
    """Simulate with a finer encoder, a filter and softer gains; return the first of each kind that settles."""
    if not can_replay(law):
        return []
    found = []
    step = log.encoder_m

    def small(with_law: Law, encoder_m: float, filter_hz: float | None = None) -> bool:
        played = replay(answer, with_law, log, encoder_m, filter_hz=filter_hz)
        return not played.sustained

    for factor in _SOFTER if law.damping_ns_per_m > NOTHING * log.reach_m**2 else ():
        softer = replace(law, damping_ns_per_m=factor * law.damping_ns_per_m)
        if worst_mode(answer, softer).stable and small(softer, step):
            change = f"b = {number(softer.damping_ns_per_m, 3)} in place of {number(law.damping_ns_per_m, 3)}"
            found.append(Remedy(change, "damping_ns_per_m", softer.damping_ns_per_m, math.nan, rests=True))
            break
    if law.keep == 0:
        for hertz in _FILTERS_HZ:
            keep = math.exp(-2 * math.pi * hertz * answer.device.sample_time_s)
            filtered = replace(law, keep=keep)
            if worst_mode(answer, filtered).stable and small(filtered, step):
                change = f"a velocity filter of {number(hertz)} Hz"
                found.append(Remedy(change, "velocity_filter_hz", hertz, math.nan, rests=True))
                break
    for finer in _FINER:
        if small(law, step / finer):
            change = f"an encoder of {number(1e6 * step / finer, 3)} in place of {number(1e6 * step, 3)}"
            found.append(Remedy(change, "encoder_resolution_m", step / finer, math.nan, rests=True))
            break
    return found
