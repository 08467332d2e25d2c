"""Zero crossings with hysteresis: the fast estimator, which harmonics break."""

from __future__ import annotations

from avc_casadi.runtime._signal import EstimatorSettings, band_passed
from avc_casadi.runtime._step import Step, StepBuilder

# Three half periods from rest on: the first began at rest and does not count.
_HALVES = 3
# Half periods that differ by less than this share are regular.
_REGULAR = 0.12
# Share of the lowest frequency at which the device is at rest.
_SLOWEST = 0.8


def zero_crossing_step(sample_time_s: float, settings: EstimatorSettings) -> Step:
    """Frequency from the last two half periods, timed between samples by linear interpolation.

    While no crossing comes, the frequency cannot be more than half the inverse of the time that has passed: the
    estimate falls with it, and ends at the lowest frequency. A half period counts only if it exceeds the floor.

    Args:
        sample_time_s: T.
        settings: what is taken for motion.

    Returns:
        velocity_m_per_s -> frequency_hz (0 where not valid), valid, even (1 where the last two half periods agree),
        regular (where the last three do), longest_half_s (of the last half period and the one in progress).
    """
    import casadi as ca  # noqa: PLC0415

    builder = StepBuilder()
    now = band_passed(builder, builder.input("velocity_m_per_s"), settings, sample_time_s)
    before = builder.state("before_m_per_s")
    side, counted = builder.state("side"), builder.state("halves")
    age, crossing = builder.state("age_ticks"), builder.state("crossing_ticks")
    last, earlier = builder.state("last_half_ticks"), builder.state("earlier_half_ticks")
    longest = 0.5 / (_SLOWEST * settings.low_hz * sample_time_s)

    older = age + 1
    passes = (before < 0) != (now < 0)
    # Where both are on one side the quotient is not used, and 1 keeps it finite.
    at = ca.if_else(passes, older - now / ca.if_else(passes, now - before, 1), crossing)
    here = ca.if_else(now > settings.floor_m_per_s, 1, ca.if_else(now < -settings.floor_m_per_s, -1, 0))
    turned = ca.logic_and(here != 0, here != side)
    rests = ca.logic_and(ca.logic_not(turned), older > longest)
    started = side != 0
    count = ca.if_else(turned, ca.fmin(counted + started, _HALVES), counted)
    half = ca.if_else(turned, at, last)
    half_before = ca.if_else(turned, last, earlier)
    half_long_before = builder.state("earliest_half_ticks")
    half_third = ca.if_else(turned, earlier, half_long_before)
    passed = ca.if_else(turned, ca.if_else(started, older - at, 0), older)

    valid = ca.logic_and(count >= _HALVES, ca.logic_not(rests))
    halves = ca.fmax(half, passed) + ca.fmax(half_before, ca.fmin(passed, half))
    frequency = ca.if_else(valid, 1 / (sample_time_s * ca.if_else(valid, halves, 1)), 0)
    mean = 0.5 * (half + half_before)
    in_time = ca.logic_and(valid, passed < (1 + _REGULAR) * mean)
    even = ca.logic_and(in_time, ca.fabs(half - half_before) < _REGULAR * mean)
    regular = ca.logic_and(even, ca.fabs(half_third - half_before) < _REGULAR * mean)

    builder.follow("before_m_per_s", now)
    builder.follow("side", ca.if_else(rests, 0, ca.if_else(turned, here, side)))
    builder.follow("halves", ca.if_else(rests, 0, count))
    builder.follow("age_ticks", ca.if_else(rests, 0, passed))
    builder.follow("crossing_ticks", ca.if_else(ca.logic_or(rests, turned), 0, at))
    builder.follow("last_half_ticks", half)
    builder.follow("earlier_half_ticks", half_before)
    builder.follow("earliest_half_ticks", half_third)
    builder.output("frequency_hz", frequency)
    builder.output("valid", valid)
    builder.output("even", even)
    builder.output("regular", regular)
    moves = ca.logic_and(started, ca.logic_not(rests))
    builder.output(
        "longest_half_s", sample_time_s * ca.if_else(moves, ca.fmax(ca.if_else(count > 0, half, 0), passed), 0)
    )
    return builder.done("zero_crossing")
