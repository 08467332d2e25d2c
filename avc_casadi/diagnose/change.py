"""The one change with which a loop of one rate settles: its cause."""

from __future__ import annotations

import numpy as np

from avc_casadi.diagnose.law import FittedLaw
from avc_casadi.diagnose.oscillation import Log, Oscillation
from avc_casadi.diagnose.plant import Hypothesis, IntendedLaw, growth, stable
from avc_casadi.diagnose.remedies import limit_of, without

FEW_STEPS = 14.0
"""Encoder steps of a swing below which quantisation alone may sustain it."""

OTHER = "other"
"""Cause of a loop that no single change settles, or that settles already."""

_LATE_TICKS = 0.35
"""Ticks beyond the declared delay from which on a loop is late."""

_SMALL_SHARE = 0.15
"""Share of the swing below which a motion is small beside it."""

_NO_MOTION_M = 1e-12
"""Motion that stands for none, so that its logarithm is finite."""

_FELL_LN = 3.0
"""ln of the ratio by which a small motion fell below one that grows as the swing does, from which on it had rested."""


def cause_of(hypothesis: Hypothesis, law: FittedLaw, log: Log, swing: Oscillation, design: IntendedLaw) -> str:
    """Return the change with which the fitted loop settles, a key of `CAUSES`, or other.

    They are tried in turn: finer encoder, quicker clock, no resonance, no delay, a hand, less damping or stiffness.
    """
    if stable(hypothesis, law):
        return "encoder" if swing.steps < FEW_STEPS else OTHER
    slower = (design.known and design.samples_a_tick(log) > 1) or log.hold > 1
    if slower and stable(*without("rate", hypothesis, law, log, design)):
        return "rate"
    # A delay or the lack of a hand beside a resonance may stand for what is not known of it.
    if undeclared_mode(hypothesis, design) and stable(*without("resonance", hypothesis, law, log, design)):
        return "resonance"
    if late_alone(hypothesis, law, log, design):
        return "delay"
    if hypothesis.hand is None and _had_rest(log, swing, growth(hypothesis, law)):
        return "let-go"
    damping_limit, stiffness_limit = (limit_of(hypothesis, law, gain) for gain in ("damping", "stiffness"))
    wider = "damping" if damping_limit > stiffness_limit else "stiffness"
    return wider if max(damping_limit, stiffness_limit) else OTHER


def undeclared_mode(hypothesis: Hypothesis, design: IntendedLaw) -> bool:
    """Return whether a hypothesis has a resonance that is not declared."""
    return hypothesis.device.resonance is not None and design.device.resonance is None


def unknown_mechanics(hypothesis: Hypothesis, design: IntendedLaw) -> bool:
    """Return whether a hypothesis has a resonance or travel stops that are not declared."""
    return undeclared_mode(hypothesis, design) or hypothesis.stops is not None


def late_alone(hypothesis: Hypothesis, law: FittedLaw, log: Log, design: IntendedLaw) -> bool:
    """Return whether a loop is later than declared, and settles with the declared delay."""
    late = hypothesis.delay + law.lag > design.latest(log) + _LATE_TICKS
    return late and stable(*without("delay", hypothesis, law, log, design))


def _had_rest(log: Log, swing: Oscillation, growth_per_s: float) -> bool:
    """Return whether the device rested in contact before it swung, so that the loop is stable with some hand.

    s(t) is the peak-to-peak motion in contact over one cycle of the swing. A loop that is unstable all the time has
    s(t) = s_0 e^(g t) with its growth g, and ln s(t) - g t is constant. The device has rested where this level fell by
    more than `_FELL_LN` below an earlier one, while s is small beside the swing.
    """
    ticks_of_cycle = min(max(round(1 / swing.frequency_hz / log.period_s), 2), log.position_m.size)
    motion_m = np.ptp(np.lib.stride_tricks.sliding_window_view(log.position_m, ticks_of_cycle), axis=1)
    ticks = np.flatnonzero(log.touching[: motion_m.size])
    motion_m = motion_m[ticks]
    level = np.log(np.maximum(motion_m, log.encoder_m + _NO_MOTION_M)) - growth_per_s * log.period_s * ticks
    fell_by = np.maximum.accumulate(level) - level
    small = motion_m < _SMALL_SHARE * swing.peak_to_peak_m
    return bool(fell_by[small].max(initial=0.0) > _FELL_LN)
