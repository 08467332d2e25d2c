"""The estimators of the interaction frequency by name; the robust one is a bank of leaky resonators."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from avc_casadi.simulation.tick import Expr, Step, StepBuilder, ca, insert

HIGHEST_SHARE = 0.2
"""Highest frequency of an estimator as a share of the sampling rate."""
NARROWEST_BAND = 1.5
"""Least ratio of the highest frequency of an estimator to the lowest."""


@dataclass(frozen=True)
class EstimatorSettings:
    """Thresholds of motion of an estimator, in the unit of the position: metres, or rad for a rotary device."""

    low_hz: float = 1.0
    high_hz: float = 60.0
    floor_m_per_s: float = 3e-3
    fastest_m_per_s: float = 5.0

    def top_hz(self, sample_time_s: float) -> float:
        """Highest frequency at a sampling rate."""
        return max(min(self.high_hz, HIGHEST_SHARE / sample_time_s), NARROWEST_BAND * self.low_hz)

    @classmethod
    def for_encoder(cls, resolution_m: float, sample_time_s: float, metres_per_unit: float = 1.0) -> EstimatorSettings:
        """Return settings with the floor above the response of the estimators' low pass to one encoder step."""
        handle = cls()
        corner = min(1.0, math.tau * handle.top_hz(sample_time_s) * sample_time_s)
        floor, fastest = handle.floor_m_per_s / metres_per_unit, handle.fastest_m_per_s / metres_per_unit
        return cls(floor_m_per_s=max(floor, 0.5 * corner * resolution_m / sample_time_s), fastest_m_per_s=fastest)


def band_pass(builder: StepBuilder, velocity: Expr, settings: EstimatorSettings, sample_time_s: float) -> Expr:
    """Remove drift by a first-order high pass at half the lowest frequency, noise by two low passes."""
    mean = builder.state("mean_m_per_s")
    slow = 1.0 - ca.exp(-math.tau * 0.5 * settings.low_hz * sample_time_s)
    seen = ca.fmin(ca.fmax(velocity, -settings.fastest_m_per_s), settings.fastest_m_per_s)
    builder.follow("mean_m_per_s", mean + slow * (seen - mean))
    signal = seen - mean
    fast = 1.0 - ca.exp(-math.tau * settings.top_hz(sample_time_s) * sample_time_s)
    for name in ("smoothed_m_per_s", "twice_smoothed_m_per_s"):
        before = builder.state(name)
        signal = before + fast * (signal - before)
        builder.follow(name, signal)
    return signal


def envelope(
    builder: StepBuilder, signal: Expr, frequency_hz: Expr, settings: EstimatorSettings, sample_time_s: float
) -> Expr:
    """Return the envelope, decaying over half a period: it distinguishes a hand at rest from a filter that rings on."""
    before = builder.state("envelope_m_per_s")
    held = ca.fmax(ca.fabs(signal), before * (1 - 2 * sample_time_s * ca.fmax(frequency_hz, settings.low_hz)))
    builder.follow("envelope_m_per_s", held)
    return held


_RESONATORS_PER_DECADE = 9
_RESONATOR_QUALITY = 4.0
"""Centre frequency of a resonator over its decay rate."""
_INSTANT_OVER_TOP = 1.5
"""Largest instantaneous frequency over the highest of the settings."""
_SMOOTHING_PERIODS = 0.3
"""Time constant of the smoothed frequency, in periods of it."""
_PERIODS_NEEDED = 0.75
"""Periods of motion before the estimate of the resonators is valid."""


def _arc_tangent(slope: Expr) -> Expr:
    """Return s (1 + a s^2)/(1 + b s^2 + c s^4), the arc tangent of slopes up to 2 to within 2e-4 of it.

    A motion of 60 Hz at 1 kHz has a slope of 0.4.
    """
    a, b, c = _ARC_TANGENT
    square = slope * slope
    return slope * (1 + a * square) / (1 + square * (b + c * square))


_ARC_TANGENT = (0.43157974, 0.76443945, 0.05831938)


def spectral_peak_step(sample_time_s: float, settings: EstimatorSettings) -> Step:
    """Return the step that estimates the frequency by the phase advance of the strongest of log-spaced resonators."""
    builder = StepBuilder()
    signal = band_pass(builder, builder.input("velocity_m_per_s"), settings, sample_time_s)
    peak: Expr = 0.0
    sine: Expr = 0.0
    cosine: Expr = 0.0
    low, high = settings.low_hz, settings.top_hz(sample_time_s)
    count = max(1, math.ceil(_RESONATORS_PER_DECADE * math.log10(high / low)))
    for index in range(count + 1):
        centre = low * (high / low) ** (index / count)
        cross, dot, power = _resonator(builder, f"bin{index}", signal, centre, sample_time_s)
        # In units of the floor, so that powers of it stay far from the limits of single precision.
        level = power * (4 / settings.floor_m_per_s**2)
        peak = ca.fmax(peak, level)
        weight = level * (settings.low_hz / centre)
        weight *= (weight * weight) ** 2
        sine += weight * cross
        cosine += weight * dot
    smooth, turns = builder.state("smooth_hz"), builder.state("turns")
    moving = smooth > 0
    lasting = envelope(builder, signal, smooth, settings, sample_time_s)
    threshold = ca.if_else(moving, 0.5, 1.0)
    present = ca.logic_and(peak > threshold * threshold, lasting > threshold * settings.floor_m_per_s)
    present = ca.logic_and(present, cosine > 0)
    slope = ca.if_else(present, sine / ca.if_else(present, cosine, 1), 0)
    instant = _arc_tangent(slope) / (math.tau * sample_time_s)
    instant = ca.fmin(ca.fmax(instant, 0.5 * settings.low_hz), _INSTANT_OVER_TOP * settings.top_hz(sample_time_s))
    # The ripple at twice the frequency is smoothed.
    share = ca.fmin(instant * sample_time_s / _SMOOTHING_PERIODS, 1)
    following = ca.if_else(present, ca.if_else(moving, smooth + share * (instant - smooth), instant), 0)
    turned = ca.if_else(present, ca.fmin(turns + following * sample_time_s, 1), 0)
    valid = turned >= _PERIODS_NEEDED
    builder.follow("smooth_hz", following)
    builder.follow("turns", turned)
    return builder.build("spectral_peak", frequency_hz=ca.if_else(valid, following, 0), valid=valid)


def _resonator(
    builder: StepBuilder, name: str, signal: Expr, centre_hz: float, sample_time_s: float
) -> tuple[Expr, Expr, Expr]:
    """Return sine and cosine of the phase's advance times the power, and the power, of a Goertzel bin a period long."""
    decay = ca.exp(-math.tau * centre_hz * sample_time_s / _RESONATOR_QUALITY)
    turn = math.tau * centre_hz * sample_time_s
    real, imaginary = decay * ca.cos(turn), decay * ca.sin(turn)
    gain = 1.0 - decay
    coming: tuple[Expr, Expr] = (signal, 0.0)
    before: tuple[Expr, Expr] = (0.0, 0.0)
    for stage in ("inner", "outer"):
        before = (builder.state(f"{name}_{stage}_re"), builder.state(f"{name}_{stage}_im"))
        coming = (
            real * before[0] - imaginary * before[1] + gain * coming[0],
            imaginary * before[0] + real * before[1] + gain * coming[1],
        )
        builder.follow(f"{name}_{stage}_re", coming[0])
        builder.follow(f"{name}_{stage}_im", coming[1])
    cross = coming[1] * before[0] - coming[0] * before[1]
    dot = coming[0] * before[0] + coming[1] * before[1]
    return cross, dot, coming[0] * coming[0] + coming[1] * coming[1]


_SLOWEST_SHARE = 0.8
"""Share of the lowest frequency below which the device is at rest."""
_HALVES_NEEDED = 3
"""Half periods from rest on before the estimate is valid: the first began at rest and does not count."""
_REGULAR_SHARE = 0.12
"""Share of their mean by which regular half periods differ at most."""


def zero_crossing_step(sample_time_s: float, settings: EstimatorSettings) -> Step:
    """Return the step that estimates the frequency from the last two half periods, timed by linear interpolation."""
    builder = StepBuilder()
    now = band_pass(builder, builder.input("velocity_m_per_s"), settings, sample_time_s)
    before = builder.state("before_m_per_s")
    side, counted = builder.state("side"), builder.state("halves")
    age, crossing = builder.state("age_ticks"), builder.state("crossing_ticks")
    last, earlier = builder.state("last_half_ticks"), builder.state("earlier_half_ticks")
    longest = 0.5 / (_SLOWEST_SHARE * settings.low_hz * sample_time_s)

    older = age + 1
    passes = (before < 0) != (now < 0)
    # Where both have one sign the quotient is not used, and 1 keeps it finite.
    crossed = ca.if_else(passes, older - now / ca.if_else(passes, now - before, 1), crossing)
    here = ca.if_else(now > settings.floor_m_per_s, 1, ca.if_else(now < -settings.floor_m_per_s, -1, 0))
    turned = ca.logic_and(here != 0, here != side)
    rests = ca.logic_and(ca.logic_not(turned), older > longest)
    started = side != 0
    count = ca.if_else(turned, ca.fmin(counted + started, _HALVES_NEEDED), counted)
    half = ca.if_else(turned, crossed, last)
    half_before = ca.if_else(turned, last, earlier)
    half_long_before = builder.state("earliest_half_ticks")
    half_third = ca.if_else(turned, earlier, half_long_before)
    passed = ca.if_else(turned, ca.if_else(started, older - crossed, 0), older)

    valid = ca.logic_and(count >= _HALVES_NEEDED, ca.logic_not(rests))
    halves = ca.fmax(half, passed) + ca.fmax(half_before, ca.fmin(passed, half))
    frequency = ca.if_else(valid, 1 / (sample_time_s * ca.if_else(valid, halves, 1)), 0)
    mean = 0.5 * (half + half_before)
    in_time = ca.logic_and(valid, passed < (1 + _REGULAR_SHARE) * mean)
    even = ca.logic_and(in_time, ca.fabs(half - half_before) < _REGULAR_SHARE * mean)
    regular = ca.logic_and(even, ca.fabs(half_third - half_before) < _REGULAR_SHARE * mean)

    builder.follow("before_m_per_s", now)
    builder.follow("side", ca.if_else(rests, 0, ca.if_else(turned, here, side)))
    builder.follow("halves", ca.if_else(rests, 0, count))
    builder.follow("age_ticks", ca.if_else(rests, 0, passed))
    builder.follow("crossing_ticks", ca.if_else(ca.logic_or(rests, turned), 0, crossed))
    builder.follow("last_half_ticks", half)
    builder.follow("earlier_half_ticks", half_before)
    builder.follow("earliest_half_ticks", half_third)
    moves = ca.logic_and(started, ca.logic_not(rests))
    longest_s = sample_time_s * ca.if_else(moves, ca.fmax(ca.if_else(count > 0, half, 0), passed), 0)
    return builder.build(
        "zero_crossing", frequency_hz=frequency, valid=valid, even=even, regular=regular, longest_half_s=longest_s
    )


_APART_SHARE = 0.05
"""Share of the robust estimate by which the quick one must differ to override it."""
_LONGEST_HALF = 1.5
"""No half period of a motion is longer than one and a half of the true frequency's."""


def fusion_step(sample_time_s: float, settings: EstimatorSettings) -> Step:
    """Return the step of the spectral peak, overridden by regular zero crossings until the resonators settle."""
    builder = StepBuilder()
    velocity = builder.input("velocity_m_per_s")
    fast = insert(builder, "fast", zero_crossing_step(sample_time_s, settings), [velocity])
    robust = insert(builder, "robust", spectral_peak_step(sample_time_s, settings), [velocity])
    quick, steady = fast["frequency_hz"], robust["frequency_hz"]
    apart = ca.fabs(quick - steady) > _APART_SHARE * steady
    # Harmonics add crossings and never remove any: two equal, longer half periods suffice.
    slower = ca.logic_and(fast["even"], quick < steady)
    trusted = ca.logic_and(apart, ca.logic_or(fast["regular"], slower))
    take_fast = ca.logic_or(trusted, ca.logic_not(robust["valid"]))
    bound = _LONGEST_HALF * 0.5 / ca.fmax(fast["longest_half_s"], sample_time_s)
    return builder.build(
        "fused",
        frequency_hz=ca.if_else(take_fast, quick, ca.fmin(steady, bound)),
        valid=ca.logic_or(fast["valid"], robust["valid"]),
    )


_OSCILLATOR_DAMPING = 1.0
_LOOP_GAIN = 0.6
"""Gain of the frequency loop, in units of the frequency."""
_LOCKED_SHARE = 0.6
"""Residual share of the signal's power below which the notch counts as locked."""
_FLOOR_SHARE = 0.25
"""Share of the floor's power in the denominator of the loop, which keeps noise at rest from shifting the frequency."""
_LARGEST_CHANGE = 0.05
"""Largest relative change of the frequency in a sample."""


def adaptive_notch_step(sample_time_s: float, settings: EstimatorSettings) -> Step:
    """Return the step of a second-order generalised integrator with frequency-locked loop, normalised by its power."""
    builder = StepBuilder()
    signal = band_pass(builder, builder.input("velocity_m_per_s"), settings, sample_time_s)
    low, high = (math.tau * hz * sample_time_s for hz in (settings.low_hz, settings.top_hz(sample_time_s)))
    start = ca.sqrt(low * high)
    damping = _OSCILLATOR_DAMPING
    turn = builder.state("turn_rad", start)
    inphase, quadrature = builder.state("inphase_m_per_s"), builder.state("quadrature_m_per_s")
    left_over, whole = builder.state("left_over_power"), builder.state("power")

    rest = signal - inphase
    inphase_next = inphase + turn * (damping * rest - quadrature)
    quadrature_next = quadrature + turn * inphase_next
    power = inphase_next * inphase_next + quadrature_next * quadrature_next
    floor = settings.floor_m_per_s**2
    gain = _LOOP_GAIN * damping * turn / (power + rest * rest + _FLOOR_SHARE * floor)
    change = ca.fmin(ca.fmax(-gain * rest * quadrature_next, -_LARGEST_CHANGE), _LARGEST_CHANGE)
    turn_next = ca.fmin(ca.fmax(turn * (1 + change), low), high)

    share = turn / math.tau
    left_over_next = left_over + share * (rest * rest - left_over)
    whole_next = whole + share * (0.5 * (power + signal * signal) - whole)
    moving = whole_next > 0.5 * floor
    # The oscillator, stepped once a sample, advances by 2 asin(turn/2).
    frequency = turn_next * (1 + turn_next * turn_next / 24) / (math.tau * sample_time_s)
    lasting = envelope(builder, signal, frequency, settings, sample_time_s)
    moving = ca.logic_and(moving, lasting > 0.5 * settings.floor_m_per_s)
    valid = ca.logic_and(moving, left_over_next < _LOCKED_SHARE * whole_next)
    builder.follow("turn_rad", ca.if_else(moving, turn_next, turn + share * (start - turn)))
    builder.follow("inphase_m_per_s", inphase_next)
    builder.follow("quadrature_m_per_s", quadrature_next)
    builder.follow("left_over_power", left_over_next)
    builder.follow("power", whole_next)
    return builder.build("adaptive_notch", frequency_hz=ca.if_else(valid, frequency, 0), valid=valid)


ESTIMATORS: Mapping[str, Callable[[float, EstimatorSettings], Step]] = {
    "zero-crossing": zero_crossing_step,
    "spectral-peak": spectral_peak_step,
    "adaptive-notch": adaptive_notch_step,
    "fused": fusion_step,
}


def estimator_step(method: str, sample_time_s: float, settings: EstimatorSettings | None = None) -> Step:
    """Return one tick of an estimator: velocity_m_per_s -> frequency_hz, valid; at rest both are 0."""
    return ESTIMATORS[method](sample_time_s, settings or EstimatorSettings())
