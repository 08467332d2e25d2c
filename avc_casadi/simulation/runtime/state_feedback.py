"""An observer with a dead zone and state feedback, sample by sample."""

from __future__ import annotations

from functools import lru_cache

from avc_casadi.model.runtime import StateFeedback
from avc_casadi.simulation.runtime.step import Step, StepBuilder


def state_feedback_step(settings: StateFeedback) -> Step:
    """Believe the prediction as long as the encoder does not contradict it by more than the dead zone.

    Quantiser and dead zone together let a share between 0 and 1 of the innovation pass, so that a loop that is damped
    for every such share does not buzz between two steps of an encoder. The force that was asked for is known, with its
    way through delay and amplifier; the push of the hand is a state.

    The matrices are parameters: one compiled step serves all that are of a size.

    Args:
        settings: of the same size and places as those that will run.

    Returns:
        position_m, force_n (asked for in the tick before, positive against +x; what is asked is what the actuator can
        give) -> position_m that the wall sees. The first tick takes the position as it is, the device at rest.
    """
    return _step_of(settings.states, tuple(settings.positions), settings.measures)


@lru_cache(maxsize=64)
def _step_of(n: int, positions: tuple[int, ...], measures: int) -> Step:
    import casadi as ca  # noqa: PLC0415

    builder = StepBuilder()
    measured, asked = builder.input("position_m"), builder.input("force_n")
    started = builder.state("started")
    before = [builder.state(f"s{place + 1}_m") for place in range(n)]
    a = [[builder.parameter(f"a{row + 1}_{column + 1}") for column in range(n)] for row in range(n)]
    b, gain, weight = ([builder.parameter(f"{name}{row + 1}") for row in range(n)] for name in "blr")
    half, face = builder.parameter("dead_zone_m"), builder.parameter("face_m")
    seen = measured + face
    predicted = [
        ca.if_else(
            started,
            b[row] * asked + sum((a[row][column] * before[column] for column in range(n)), ca.SX(0)),
            seen if row in positions else 0,
        )
        for row in range(n)
    ]
    error = seen - predicted[measures]
    error = error - ca.fmin(ca.fmax(error, -half), half)
    corrected = [value + gain[row] * error for row, value in enumerate(predicted)]
    builder.follow("started", 1)
    for row, value in enumerate(corrected):
        builder.follow(f"s{row + 1}_m", value)
    builder.output("position_m", sum((weight[row] * value for row, value in enumerate(corrected)), ca.SX(0)))
    return builder.done("state_feedback")
