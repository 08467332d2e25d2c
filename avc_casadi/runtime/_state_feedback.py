"""An observer with a dead zone and state feedback: the wall sees a weighted sum of what the observer believes."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from functools import lru_cache

import numpy as np

from avc_casadi._errors import Fault, InputError
from avc_casadi.runtime._step import Step, StepBuilder
from avc_casadi.support import FloatArray

MOST_STATES = 16

Row = tuple[float, ...]


@dataclass(frozen=True)
class StateFeedback:
    """e = dz(x + face - s_m), s+ = s + L e, y = R s+, and after the force F: s = A s+ + B F.

    x is the measured position, m the state that stands for it, dz the dead zone, y the position that the wall sees. All
    states are lengths: velocities are counted by the sample, forces by a stiffness.

    Attributes:
        state: A, n rows of n numbers.
        force_m_per_n: B, n numbers.
        innovation: L, n numbers.
        feedback: R, n numbers.
        positions: which states are positions; they start where the device stands.
        measures: m, one of the positions.
        dead_zone_m: half width of the dead zone; 0 for none.
        face_m: how far the face of the wall is moved out, against the lag of the dead zone.
    """

    state: tuple[Row, ...]
    force_m_per_n: Row
    innovation: Row
    feedback: Row
    positions: tuple[int, ...]
    measures: int
    dead_zone_m: float = 0.0
    face_m: float = 0.0

    def __post_init__(self) -> None:
        faults = list(self._faults())
        if faults:
            raise InputError([Fault("", None, key, message) for key, message in faults])

    def _faults(self) -> list[tuple[str, str]]:
        n = len(self.force_m_per_n)
        if not 1 <= n <= MOST_STATES:
            return [("force_m_per_n", f"has {n} numbers; allowed: 1 to {MOST_STATES}, one for each state")]
        found = [
            (name, f"has {len(getattr(self, name))} numbers; allowed: {n}, as force_m_per_n")
            for name in ("innovation", "feedback", "state")
            if len(getattr(self, name)) != n
        ]
        found += [
            (f"state[{row}]", f"has {len(values)} numbers; allowed: {n}")
            for row, values in enumerate(self.state)
            if len(values) != n
        ]
        numbers = {"force_m_per_n": self.force_m_per_n, "innovation": self.innovation, "feedback": self.feedback}
        numbers |= {f"state[{row}]": values for row, values in enumerate(self.state)}
        found += [
            (name, "has a number that is not finite")
            for name, values in numbers.items()
            if not all(map(math.isfinite, values))
        ]
        if any(not 0 <= place < n for place in self.positions) or self.measures not in self.positions:
            found.append(("positions", f"is {list(self.positions)}; allowed: places from 0 to {n - 1}, measures among"))
        for name in ("dead_zone_m", "face_m"):
            if not 0 <= getattr(self, name) < math.inf:
                found.append((name, f"is {getattr(self, name)!r}; allowed: a finite length, 0 or more"))
        return found

    @property
    def states(self) -> int:
        """Number of states n."""
        return len(self.force_m_per_n)

    def numbers(self) -> FloatArray:
        """Return A by rows, B, L, R, dead zone and face, in the order of the step's parameters."""
        rows = [value for row in self.state for value in row]
        return np.array([*rows, *self.force_m_per_n, *self.innovation, *self.feedback, self.dead_zone_m, self.face_m])


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


STATE_FEEDBACK_KEYS: tuple[str, ...] = tuple(item.name for item in fields(StateFeedback))
