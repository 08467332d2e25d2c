"""The fitted plant in steps of time: motor force, stops and friction over parts of a tick."""

from __future__ import annotations

from dataclasses import dataclass

from avc_casadi._util.arrays import FloatArray

_STOP_DAMPING = 0.2
"""Loss of a stop, force per stop rate times momentum."""


@dataclass(frozen=True, eq=False)
class Move:
    """Steps over a part of a tick: x_next = A x + b_F F + b_f f, with the motor force F held and f on the device."""

    matrix: FloatArray
    """A of a step, shape (s, s)."""
    by_motor: FloatArray
    """b_F of a step, shape (s,)."""
    by_push: FloatArray
    """b_f of a step, shape (s,)."""
    ticks_back: int
    """Age of the force that acts, ticks."""
    steps: int


@dataclass(frozen=True, eq=False)
class Mechanics:
    """The plant of a simulation in steps of time; positions are those from the centre of the law."""

    names: tuple[str, ...]
    moves: tuple[Move, ...]
    """What a tick consists of."""
    output_row: FloatArray
    """Position of the device by the state, shape (s,)."""
    mass_kg: float
    friction_n: float
    hold_n: float
    """Constant force that holds the device against the mean force of the log, N."""
    stops_m: tuple[float, float] | None
    stop_rate_per_s: float
    """Angular frequency of the device in a stop, rad/s: beside the swing it is stiff."""

    def moved(self, state: FloatArray, move: Move, motor_n: float) -> FloatArray:
        """Return the state, shape (s,), after a part of a tick; friction takes no more than the velocity."""
        by_motor = move.by_motor * motor_n
        for _ in range(move.steps):
            push = -self.hold_n
            if self.stops_m is not None:
                push += self._stop_force(state, self.stops_m)
            state = move.matrix @ state + by_motor + move.by_push * push
            if self.friction_n:
                stopping_n = -state[1] / move.by_push[1]
                state = state + move.by_push * min(max(stopping_n, -self.friction_n), self.friction_n)
        return state

    def _stop_force(self, state: FloatArray, stops_m: tuple[float, float]) -> float:
        """Return the force of a stop, N: m w (w (x - stop) + 0.2 v) beyond it."""
        low, high = stops_m
        position = float(self.output_row @ state)
        beyond = position - min(max(position, low), high)
        speed = self.stop_rate_per_s * beyond + _STOP_DAMPING * state[1] if beyond else 0.0
        return float(self.mass_kg * self.stop_rate_per_s * speed)
