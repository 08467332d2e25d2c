"""An adaptive notch, or frequency-locked loop: an oscillator that turns its frequency until nothing is left over."""

from __future__ import annotations

import math

from avc_casadi.runtime._signal import EstimatorSettings, band_passed, envelope
from avc_casadi.runtime._step import Step, StepBuilder

# Damping of the oscillator, and gain of the frequency loop in units of the frequency.
_DAMPING = 1.0
_LOOP_GAIN = 0.6
# Share of the signal's power that the notch may leave over and still count as locked.
_LOCKED = 0.6


def adaptive_notch_step(sample_time_s: float, settings: EstimatorSettings) -> Step:
    """Second-order generalised integrator with a frequency-locked loop, normalised by its own power.

    Args:
        sample_time_s: T.
        settings: what is taken for motion.

    Returns:
        velocity_m_per_s -> frequency_hz (0 where not valid), valid.
    """
    import casadi as ca  # noqa: PLC0415

    builder = StepBuilder()
    signal = band_passed(builder, builder.input("velocity_m_per_s"), settings, sample_time_s)
    low, high = (math.tau * hz * sample_time_s for hz in (settings.low_hz, settings.top_hz(sample_time_s)))
    start = math.sqrt(low * high)
    turn = builder.state("turn_rad", start)
    inphase, quadrature = builder.state("inphase_m_per_s"), builder.state("quadrature_m_per_s")
    left_over, whole = builder.state("left_over_power"), builder.state("power")

    rest = signal - inphase
    inphase_next = inphase + turn * (_DAMPING * rest - quadrature)
    quadrature_next = quadrature + turn * inphase_next
    power = inphase_next * inphase_next + quadrature_next * quadrature_next
    floor = settings.floor_m_per_s**2
    # The floor in the denominator keeps noise at rest from turning the frequency.
    gain = _LOOP_GAIN * _DAMPING * turn / (power + rest * rest + 0.25 * floor)
    change = ca.fmin(ca.fmax(-gain * rest * quadrature_next, -0.05), 0.05)
    turn_next = ca.fmin(ca.fmax(turn * (1 + change), low), high)

    share = turn / math.tau
    left_over_next = left_over + share * (rest * rest - left_over)
    whole_next = whole + share * (0.5 * (power + signal * signal) - whole)
    moving = whole_next > 0.5 * floor
    # The oscillator, stepped once a sample, runs at 2 asin(turn/2) a sample.
    frequency = turn_next * (1 + turn_next * turn_next / 24) / (math.tau * sample_time_s)
    lasting = envelope(builder, signal, frequency, settings, sample_time_s)
    moving = ca.logic_and(moving, lasting > 0.5 * settings.floor_m_per_s)
    valid = ca.logic_and(moving, left_over_next < _LOCKED * whole_next)
    builder.follow("turn_rad", ca.if_else(moving, turn_next, turn + share * (start - turn)))
    builder.follow("inphase_m_per_s", inphase_next)
    builder.follow("quadrature_m_per_s", quadrature_next)
    builder.follow("left_over_power", left_over_next)
    builder.follow("power", whole_next)
    builder.output("frequency_hz", ca.if_else(valid, frequency, 0))
    builder.output("valid", valid)
    return builder.done("adaptive_notch")
