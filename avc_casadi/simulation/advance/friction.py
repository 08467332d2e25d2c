"""Power series of the plant between two samples, with dry friction that truly sticks.

Inside a sample the plant is linear while it slides one way or sticks. Each stretch is the power series of
exp(A t), cut where the rest is below rounding; its end, where the velocity reaches 0 or the load exceeds the friction,
is a root of a polynomial. Time is counted in samples, so that all coefficients are of the size of the state.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi.model.plant import LinearPlant, time_scale
from avc_casadi.simulation.advance.advance import Continuous, Layout, PlantSymbols
from avc_casadi.simulation.tick import Expr

# The first power left out, relative to the change of the state in a sample.
_REST = 1e-17
_HIGHEST_ORDER = 22
_MOST_SUBSTEPS = 32
# Larger terms would cancel against each other and take digits with them.
_LARGEST_TERM = 1e3
_NEWTON_STEPS = 4
# Changes between sliding and sticking that are located in one series; a third one waits for its end.
_EVENTS = 2


@dataclass(frozen=True)
class TaylorSeries(Continuous):
    """Plant with dry friction, or with a force that changes inside the sample: exact to rounding.

    Attributes:
        order: last power of a series, of which there is one a substep.
    """

    order: int

    @classmethod
    def of(cls, plant: LinearPlant, sample_time_s: float, friction_n: float, substeps: int) -> TaylorSeries:
        """Choose the order, and more substeps where the plant is fast.

        Args:
            plant: the linear plant, of all hands.
            sample_time_s: T.
            friction_n: dry friction; 0 for none.
            substeps: at least that many.

        Raises:
            UnsupportedError: the plant is too fast for a reasonable number of substeps.
        """
        # Higher powers are cheaper than more substeps, as long as their sum does not cancel.
        order = _order(plant, sample_time_s / substeps)
        while order > _HIGHEST_ORDER and substeps <= _MOST_SUBSTEPS:
            substeps *= 2
            order = _order(plant, sample_time_s / substeps)
        if order > _HIGHEST_ORDER or substeps > _MOST_SUBSTEPS:
            instead = 'scene.integrator = "projected"' if friction_n > 0 else "the effect jitter with rms_s = 0"
            raise UnsupportedError(
                f"the scene's mechanics move so fast within a sample of {sample_time_s:g} s that exact dry friction or "
                f"late forces would take more than {_MOST_SUBSTEPS} substeps; take {instead}, a heavier hand or "
                "device, or a slower amplifier or resonance"
            )
        return cls(Layout.of(plant, friction_n), substeps, order)

    def _through(self, plant: PlantSymbols, state: list[Expr], force: Expr, target: Any, duration: Expr) -> list[Expr]:
        part = duration / self.substeps
        for _ in range(self.substeps):
            remaining, breaking = part, 0
            for _ in range(_EVENTS if self.layout.friction_n > 0 else 0):
                state, used, breaking = self._until_event(plant, state, force, target, remaining, breaking)
                remaining -= used
                target = plant.moved(target, used)
            state = self._to_the_end(plant, state, force, target, remaining, breaking)
            target = plant.moved(target, remaining)
        return state

    def _until_event(
        self, plant: PlantSymbols, state: list[Expr], force: Expr, target: Any, remaining: Expr, breaking: Expr
    ) -> tuple[list[Expr], Expr, Expr]:
        """Slide or stick until that ends or the time is over; returns the state, the time used and what breaks away."""
        import casadi as ca  # noqa: PLC0415

        sliding, direction = _mode(plant, state, force, target, breaking)
        series, loads = self._series(plant, state, force, target, direction * plant.friction, sliding)
        sticking = 1 - sliding
        # What must not become negative: the velocity in its direction, or what friction can still hold. While the
        # device sticks, all powers of its velocity are 0.
        sign = sliding * direction - sticking * ca.sign(_horner(loads, remaining))
        reserve = [sign * (v + sticking * r) for v, r in zip(series[1], loads, strict=False)]
        reserve[0] += sticking * plant.friction
        # From rest the velocity has a zero at the beginning, which is divided out.
        from_rest = ca.logic_and(sliding, state[1] == 0)
        reserve = [ca.if_else(from_rest, after, power) for power, after in pairwise(reserve)]
        used = _first_zero(reserve, remaining)
        moved = [_horner(powers, used) for powers in series]
        ended = used < remaining
        # At the end of sliding the velocity is exactly 0.
        moved[1] *= ca.logic_or(sticking, ca.logic_not(ended))
        return moved, used, ca.logic_and(sticking, ended)

    def _to_the_end(
        self, plant: PlantSymbols, state: list[Expr], force: Expr, target: Any, remaining: Expr, breaking: Expr
    ) -> list[Expr]:
        """Move for the rest of the time; with dry friction, a velocity that would turn is stopped at the end."""
        if self.layout.friction_n == 0:
            return [_horner(powers, remaining) for powers in self._series(plant, state, force, target)[0]]
        sliding, direction = _mode(plant, state, force, target, breaking)
        series, _ = self._series(plant, state, force, target, direction * plant.friction, sliding)
        moved = [_horner(powers, remaining) for powers in series]
        moved[1] *= direction * moved[1] >= 0
        return moved

    def _series(
        self,
        plant: PlantSymbols,
        state: list[Expr],
        force: Expr,
        target: Any,
        friction: Expr = None,
        sliding: Expr = None,
    ) -> tuple[list[list[Expr]], list[Expr]]:
        """Return the power series of each state, and that of the device's acceleration without friction."""
        powers, loads = [state], []
        for power in range(self.order):
            rates = plant.coupled(powers[-1]) if power else plant.rates(state, force, target)
            if power == 1:
                rates = plant.driven(rates, target)
            loads.append(rates[1])
            if friction is not None and power == 0:
                rates[1] -= friction
            if sliding is not None:
                rates[1] *= sliding
            powers.append([rate * (1.0 / (power + 1)) for rate in rates])
        return [list(column) for column in zip(*powers, strict=True)], loads


def _mode(plant: PlantSymbols, state: list[Expr], force: Expr, target: Any, breaking: Expr) -> tuple[Expr, Expr]:
    """Return whether the device slides (1) or sticks (0), and the direction in which it slides or would break away.

    At the moment of breaking away the load equals the friction but for rounding, so that the comparison is not asked.
    """
    import casadi as ca  # noqa: PLC0415

    velocity, load = state[1], plant.rates(state, force, target)[1]
    moving = velocity != 0
    sliding = ca.logic_or(ca.logic_or(moving, breaking), ca.fabs(load) > plant.friction)
    return sliding, ca.sign(velocity) + (1 - moving) * ca.sign(load)


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
    low: Expr = 0
    high = until
    for _ in range(_NEWTON_STEPS):
        inside = ca.logic_and(guess >= low, guess <= high)
        guess = ca.if_else(inside, guess, 0.5 * (low + high))
        value = _horner(powers, guess)
        high, low = ca.if_else(value < 0, guess, high), ca.if_else(value < 0, low, guess)
        guess -= value / _horner(slopes, guess)
    return ca.if_else(_horner(powers, until) < 0, ca.fmin(ca.fmax(guess, low), high), remaining)


def _horner(powers: list[Expr], at: Expr) -> Expr:
    value = powers[-1]
    for power in reversed(powers[:-1]):
        value = power + at * value
    return value


def _order(plant: LinearPlant, step_s: float) -> int:
    """Return the power after which no term of exp(A h) counts, with velocities in metres a step."""
    scale = time_scale(plant, step_s)
    matrix = plant.matrix * step_s * scale[:, None] / scale
    term = np.eye(plant.states)
    for power in range(1, _HIGHEST_ORDER + 1):
        term = term @ matrix / power
        largest = np.abs(term).max()
        if largest < _REST:
            return power
        if largest > _LARGEST_TERM:
            break
    return _HIGHEST_ORDER + 1
