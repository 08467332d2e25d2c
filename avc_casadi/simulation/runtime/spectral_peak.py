"""A bank of leaky resonators and the frequency of the strongest: the robust estimator."""

from __future__ import annotations

import math

from avc_casadi.simulation.runtime.signal import EstimatorSettings, band_passed, envelope
from avc_casadi.simulation.runtime.step import Expr, Step, StepBuilder

# Resonators a decade, and the centre frequency of each over its rate of decay.
_PER_DECADE = 9
_QUALITY = 4.0
# Smoothing of the ripple at twice the frequency, in periods; and periods of motion before the estimate is valid.
_RIPPLE_PERIODS = 0.3
_FIRST_TURN = 0.75


def spectral_peak_step(sample_time_s: float, settings: EstimatorSettings) -> Step:
    """Frequency of the strongest of logarithmically spaced resonators, read from the advance of their phases.

    Each resonator is a pair of complex leaky integrators that turn at its centre frequency (a Goertzel bin whose window
    is the gamma function of order 2, as long as fits its frequency). Power over frequency, half way between the spectra
    of position and velocity, lets neither drift nor harmonics win; its fifth power weighs the advance of each phase
    (besides the power in it), which leaves the strongest and its equals without a switch between them.

    Returns:
        velocity_m_per_s -> frequency_hz (0 where not valid), valid.
    """
    import casadi as ca  # noqa: PLC0415

    builder = StepBuilder()
    signal = band_passed(builder, builder.input("velocity_m_per_s"), settings, sample_time_s)
    peak: Expr = 0.0
    sine: Expr = 0.0
    cosine: Expr = 0.0
    for index, centre in enumerate(_centres_hz(settings, sample_time_s)):
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
    instant = ca.fmin(ca.fmax(instant, 0.5 * settings.low_hz), 1.5 * settings.top_hz(sample_time_s))
    share = ca.fmin(instant * sample_time_s / _RIPPLE_PERIODS, 1)
    following = ca.if_else(present, ca.if_else(moving, smooth + share * (instant - smooth), instant), 0)
    turned = ca.if_else(present, ca.fmin(turns + following * sample_time_s, 1), 0)
    valid = turned >= _FIRST_TURN
    builder.follow("smooth_hz", following)
    builder.follow("turns", turned)
    builder.output("frequency_hz", ca.if_else(valid, following, 0))
    builder.output("valid", valid)
    return builder.done("spectral_peak")


def _centres_hz(settings: EstimatorSettings, sample_time_s: float) -> list[float]:
    low, high = settings.low_hz, settings.top_hz(sample_time_s)
    steps = max(1, math.ceil(_PER_DECADE * math.log10(high / low)))
    return [low * (high / low) ** (index / steps) for index in range(steps + 1)]


def _resonator(
    builder: StepBuilder, name: str, signal: Expr, centre_hz: float, sample_time_s: float
) -> tuple[Expr, Expr, Expr]:
    """Return the sine and cosine of the phase's advance in this tick, times the power, and the power."""
    decay = math.exp(-math.tau * centre_hz * sample_time_s / _QUALITY)
    turn = math.tau * centre_hz * sample_time_s
    real, imaginary = decay * math.cos(turn), decay * math.sin(turn)
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


def _arc_tangent(slope: Expr) -> Expr:
    """Arc tangent for slopes up to 2, where 60 Hz at 1 kHz is 0.4; error below 2e-4 of it."""
    square = slope * slope
    return slope * (1 + 0.43157974 * square) / (1 + square * (0.76443945 + 0.05831938 * square))
