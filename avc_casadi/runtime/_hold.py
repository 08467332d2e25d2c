"""The frequency at which the gains are read: the estimate, held a while when it is lost, then falling to rest."""

from __future__ import annotations

from dataclasses import dataclass

from avc_casadi.runtime._step import Step, StepBuilder


@dataclass(frozen=True)
class HoldSettings:
    """How the look-up leaves an estimate that is no longer there.

    Attributes:
        hold_s: how long the last estimate is kept.
        decay_s: time constant with which the frequency then falls to that of rest.
    """

    hold_s: float = 0.0
    decay_s: float = 0.1


def hold_step(sample_time_s: float, settings: HoldSettings) -> Step:
    """Return the step from an estimate to the frequency of the look-up.

    The gains follow the rows of the table, each of which was designed, all the way to rest: the frequency falls, not
    the gains. The age stops at the hold time, so that nothing grows.

    Args:
        sample_time_s: T.
        settings: hold and decay.

    Returns:
        frequency_hz, valid, with the parameter rest_hz -> frequency_hz, held (1 while it is not an estimate of now).
    """
    import casadi as ca  # noqa: PLC0415

    builder = StepBuilder()
    estimate, valid, rest = builder.input("frequency_hz"), builder.input("valid"), builder.parameter("rest_hz")
    # The start counts as long at rest.
    frequency, age = builder.state("frequency_hz"), builder.state("age_s", settings.hold_s)
    known = ca.if_else(frequency > 0, frequency, rest)
    older = ca.fmin(age + sample_time_s, settings.hold_s)
    share = min(1.0, sample_time_s / settings.decay_s) if settings.decay_s > 0 else 1.0
    falling = known + share * (rest - known)
    lost = ca.if_else(age < settings.hold_s, known, falling)
    following = ca.if_else(valid, estimate, lost)
    builder.follow("frequency_hz", following)
    builder.follow("age_s", ca.if_else(valid, 0, older))
    builder.output("frequency_hz", following)
    builder.output("held", ca.logic_not(valid))
    return builder.done("hold")
