"""Power series of the plant between two samples, with dry friction that truly sticks.

Inside a sample the plant is linear while it slides one way or sticks. Each stretch is the power series of
exp(A t), cut where the rest is below rounding; its end, where the velocity reaches 0 or the load exceeds the friction,
is a root of a polynomial. Time is counted in samples, so that all coefficients are of the size of the state.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from avc_casadi.scene._advance import Drive
from avc_casadi.scene._plant import LinearPlant
from avc_casadi.scene._propagation import time_scale
from avc_casadi.scene._tick import Expr, Tick

FloatArray = NDArray[np.float64]

# The first power left out, relative to the change of the state in a sample.
_REST = 1e-17
_HIGHEST_ORDER = 14
_NEWTON_STEPS = 3
# Changes between sliding and sticking that are located in one series; a third one waits for its end.
_EVENTS = 2


@dataclass(frozen=True)
class TaylorSeries:
    """Plant with dry friction, or with a force that changes inside the sample.

    Attributes:
        entries: the entries (row, column) of A that differ from 0 for any hand.
        force_row: the state on which the actuator acts.
        target_row: the velocity on which the hand's target acts; None without a hand.
        friction_n: dry friction; 0 for none.
        order: last power of a series.
        substeps: series a sample.
    """

    entries: tuple[tuple[int, int], ...]
    force_row: int
    target_row: int | None
    friction_n: float
    order: int
    substeps: int

    def step(self, tick: Tick, state: list[Expr], drive: Drive) -> list[Expr]:
        """Add the plant's numbers and return the state one sample later."""
        plant = _Symbols(self, tick)
        if drive.late is None:
            return self._through(plant, state, drive.force, drive.target, 1.0)
        middle = self._through(plant, state, drive.force_before, drive.target, drive.late)
        target = None if drive.target is None else plant.moved(drive.target, drive.late)
        return self._through(plant, middle, drive.force, target, 1.0 - drive.late)

    def parameters(self, plant: LinearPlant, sample_time_s: float) -> FloatArray:
        """Return the plant's numbers over one sample, shape (..., p)."""
        columns = [plant.matrix[..., row, column] for row, column in self.entries]
        columns.append(plant.force[..., self.force_row])
        if self.target_row is not None:
            columns += [plant.target[..., self.target_row, 0], plant.target[..., self.target_row, 1]]
        if self.friction_n > 0:
            columns.append(-self.friction_n * plant.friction[..., 1])
        return np.stack(columns, axis=-1) * sample_time_s

    def _through(self, plant: _Symbols, state: list[Expr], force: Expr, target: Any, duration: Expr) -> list[Expr]:
        part = duration / self.substeps
        for _ in range(self.substeps):
            if self.friction_n > 0:
                state = self._with_friction(plant, state, force, target, part)
            else:
                series, _ = plant.series(state, force, target)
                state = [_horner(powers, part) for powers in series]
            target = None if target is None else plant.moved(target, part)
        return state

    def _with_friction(self, plant: _Symbols, state: list[Expr], force: Expr, target: Any, part: Expr) -> list[Expr]:
        remaining = part
        for _ in range(_EVENTS):
            state, used = _until_event(plant, state, force, target, remaining)
            remaining -= used
            target = None if target is None else plant.moved(target, used)
        return _to_the_end(plant, state, force, target, remaining)


class _Symbols:
    """The plant's numbers as parameters of the sample."""

    def __init__(self, series: TaylorSeries, tick: Tick) -> None:
        self.sample_time_s = tick.sample_time_s
        self.order = series.order
        self.entries = {entry: tick.parameter(f"plant_{entry[0]}_{entry[1]}") for entry in series.entries}
        self.force = (series.force_row, tick.parameter("plant_force"))
        self.target: Any = None
        if series.target_row is not None:
            self.target = (series.target_row, tick.parameter("plant_spring"), tick.parameter("plant_damper"))
        self.friction: Expr = tick.parameter("plant_friction") if series.friction_n > 0 else None

    def moved(self, target: tuple[Expr, Expr], share: Expr) -> tuple[Expr, Expr]:
        """Return the target a share of a sample later."""
        return target[0] + target[1] * (self.sample_time_s * share), target[1]

    def rates(self, state: list[Expr], power: int, force: Expr, target: Any) -> list[Expr]:
        """Return A times a coefficient and the inputs that belong to its power of time, per sample."""
        rates: list[Expr] = [0.0] * len(state)
        for (row, column), entry in self.entries.items():
            rates[row] += entry * state[column]
        if power == 0 and force is not None:
            rates[self.force[0]] += self.force[1] * force
        if target is not None and power <= 1:
            row, spring, damper = self.target
            position, velocity = target
            rates[row] += (
                spring * position + damper * velocity if power == 0 else spring * (velocity * self.sample_time_s)
            )
        return rates

    def series(
        self, state: list[Expr], force: Expr, target: Any, friction: Expr = None, sliding: Expr = None
    ) -> tuple[list[list[Expr]], list[Expr]]:
        """Return the power series of each state, and that of the acceleration without friction."""
        powers = [state]
        loads = []
        for power in range(self.order):
            rates = self.rates(powers[-1], power, force, target)
            loads.append(rates[1])
            if friction is not None and power == 0:
                rates[1] -= friction
            if sliding is not None:
                rates[1] *= sliding
            powers.append([rate * (1.0 / (power + 1)) for rate in rates])
        return [list(column) for column in zip(*powers, strict=True)], loads


def _mode(plant: _Symbols, state: list[Expr], force: Expr, target: Any) -> tuple[Expr, Expr]:
    """Return whether the device slides (1) or sticks (0), and the direction in which it slides or would break away."""
    import casadi as ca  # noqa: PLC0415

    velocity, load = state[1], plant.rates(state, 0, force, target)[1]
    moving = velocity != 0
    return ca.logic_or(moving, ca.fabs(load) > plant.friction), ca.sign(velocity) + (1 - moving) * ca.sign(load)


def _until_event(
    plant: _Symbols, state: list[Expr], force: Expr, target: Any, remaining: Expr
) -> tuple[list[Expr], Expr]:
    """Slide or stick until that ends or the time is over; returns the state and the time used."""
    import casadi as ca  # noqa: PLC0415

    sliding, direction = _mode(plant, state, force, target)
    series, loads = plant.series(state, force, target, direction * plant.friction, sliding)
    sticking = 1 - sliding
    # What must not become negative: the velocity in its direction, or what friction can still hold. While the device
    # sticks, all powers of its velocity are 0.
    sign = sliding * direction - sticking * ca.sign(_horner(loads, remaining))
    reserve = [sign * (v + sticking * r) for v, r in zip(series[1], loads, strict=False)]
    reserve[0] += sticking * plant.friction
    used = _first_zero(reserve, remaining)
    moved = [_horner(powers, used) for powers in series]
    # At the end of sliding the velocity is exactly 0.
    moved[1] *= ca.logic_or(sticking, used >= remaining)
    return moved, used


def _to_the_end(plant: _Symbols, state: list[Expr], force: Expr, target: Any, remaining: Expr) -> list[Expr]:
    """Slide or stick for the rest of the time; a velocity that would turn is stopped at the end."""
    sliding, direction = _mode(plant, state, force, target)
    series, _ = plant.series(state, force, target, direction * plant.friction, sliding)
    moved = [_horner(powers, remaining) for powers in series]
    moved[1] *= direction * moved[1] >= 0
    return moved


def _first_zero(powers: list[Expr], remaining: Expr) -> Expr:
    """Return where a polynomial that is not negative at 0 becomes negative, or `remaining`."""
    import casadi as ca  # noqa: PLC0415

    value, slope = powers[0], powers[1]
    # The parabola with this value and slope, through the end.
    curve = ((_horner(powers, remaining) - value) / remaining - slope) / remaining
    # A dip between two ends that are not negative lies near the parabola's vertex.
    vertex = -0.5 * slope / curve
    dips = ca.logic_and(ca.logic_and(curve > 0, slope < 0), vertex < remaining)
    until = ca.if_else(dips, vertex, remaining)
    root = ca.sqrt(ca.fmax(slope * slope - 4 * value * curve, 0))
    guess = ca.if_else(slope > 0, -0.5 * (slope + root) / curve, 2 * value / (root - slope))
    slopes = [power * coefficient for power, coefficient in enumerate(powers)][1:]
    for _ in range(_NEWTON_STEPS):
        guess = ca.fmin(ca.fmax(guess, 0), until)
        guess -= _horner(powers, guess) / _horner(slopes, guess)
    return ca.if_else(_horner(powers, until) < 0, ca.fmin(ca.fmax(guess, 0), until), remaining)


def _horner(powers: list[Expr], at: Expr) -> Expr:
    value = powers[-1]
    for power in reversed(powers[:-1]):
        value = power + at * value
    return value


def taylor_series(plant: LinearPlant, sample_time_s: float, *, friction_n: float) -> TaylorSeries:
    """Choose order and substeps for a plant.

    Args:
        plant: the linear plant, of all hands.
        sample_time_s: T.
        friction_n: dry friction.
    """
    substeps, order = 1, _order(plant, sample_time_s)
    while order > _HIGHEST_ORDER:
        substeps *= 2
        order = _order(plant, sample_time_s / substeps)
    hands = tuple(range(plant.matrix.ndim - 2))
    entries = np.argwhere(np.any(plant.matrix != 0, axis=hands))
    rows = np.flatnonzero(np.any(plant.target != 0, axis=(*hands, plant.target.ndim - 1)))
    return TaylorSeries(
        entries=tuple((int(row), int(column)) for row, column in entries),
        force_row=int(np.flatnonzero(np.any(plant.force != 0, axis=hands))[0]),
        target_row=int(rows[0]) if len(rows) else None,
        friction_n=friction_n,
        order=order,
        substeps=substeps,
    )


def _order(plant: LinearPlant, step_s: float) -> int:
    """Return the power after which no term of exp(A h) counts, with velocities in metres a step."""
    scale = time_scale(plant, step_s)
    matrix = plant.matrix * step_s * scale[:, None] / scale
    term = np.eye(plant.states)
    for power in range(1, 4 * _HIGHEST_ORDER):
        term = term @ matrix / power
        if np.abs(term).max() < _REST:
            return power
    return 4 * _HIGHEST_ORDER
