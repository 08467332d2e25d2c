"""The one change with which a loop of one rate settles: its cause."""

from __future__ import annotations

import math

import numpy as np
from scipy import ndimage

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

_NO_MOTION_M = 1e-12
"""Motion that stands for none, so that its logarithm is finite."""

_FELL_LN = 3.0
"""ln of the ratio by which a motion fell below one that grows as the swing does, from which on it had rested."""

_GREW_LN = math.log(3.0)
"""ln of the ratio by which the motion grew after its rest."""

_GROWTH_SHARE = 0.5
"""Least rate of that growth, as a share of the loop's own; at a limit of the force a motion grows more slowly."""


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
    s(t) = s_0 e^(g t) with its growth g, until a limit of the force holds s, and ln s(t) - g t falls. The device has
    rested where this level fell by more than `_FELL_LN`, and s then grew by `_GREW_LN` as that of a loop that no limit
    holds.
    """
    ticks_of_cycle = min(max(round(1 / swing.frequency_hz / log.period_s), 2), log.position_m.size)
    motion_m = np.ptp(np.lib.stride_tricks.sliding_window_view(log.position_m, ticks_of_cycle), axis=1)
    motion_ln = np.log(np.maximum(motion_m, log.encoder_m + _NO_MOTION_M))
    growth_a_tick = growth_per_s * log.period_s
    touching = log.touching[: motion_m.size]
    ticks = np.flatnonzero(touching)
    level = motion_ln[ticks] - growth_a_tick * ticks
    fell = np.maximum.accumulate(level) - level > _FELL_LN
    ahead = min(math.ceil(_GREW_LN / (_GROWTH_SHARE * growth_a_tick)), motion_m.size - 1) + 1
    largest_ahead = ndimage.maximum_filter1d(np.where(touching, motion_ln, -np.inf), ahead, origin=-(ahead // 2))
    grew = largest_ahead[ticks] - motion_ln[ticks] > _GREW_LN
    return bool(np.any(fell & grew))
