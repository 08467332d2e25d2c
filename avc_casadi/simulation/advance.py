"""From one sample to the next: the device and the hand move while the force is held.

Without dry friction a step is the matrix exponential. With it each stretch of sliding or sticking is a power series,
its end a root of a polynomial, time counted in samples; quicker is friction by projection, in substeps.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.arrays import FloatArray
from avc_casadi.model.plant import LinearPlant, time_scale, transition
from avc_casadi.simulation.tick import Expr, Tick, ca

# Higher powers cost less than more substeps, as long as their sum does not cancel.
_HIGHEST_ORDER = 22
_MOST_SUBSTEPS = 32
_NEGLIGIBLE_TERM = 1e-17
"""A term of exp(A h) relative to the change of the state in a sample."""
_LARGEST_TERM = 1e3
"""The same: larger terms cancel and lose digits."""
_ROOT_STEPS = 4
"""Newton steps, each within a bracket that shrinks, from the root of a parabola to the zero of a power series."""


class PlantSymbols:
    """The numbers of a plant as parameters of a sample; time is counted in samples."""

    def __init__(self, series: TaylorSeries, tick: Tick) -> None:
        self._sample_time_s = tick.sample_time_s
        self._entries = {entry: tick.parameter(f"plant_{entry[0]}_{entry[1]}") for entry in series.entries}
        self._force = (series.force_row, tick.parameter("plant_force"))
        self._target: Any = None
        if series.target_row is not None:
            self._target = (series.target_row, tick.parameter("plant_spring"), tick.parameter("plant_damper"))
        self.friction: Expr = tick.parameter("plant_friction") if series.friction_n > 0 else None

    def target_after(self, target: Any, share: Expr) -> Any:
        """Return the target a share of a sample later."""
        return None if target is None else (target[0] + target[1] * (self._sample_time_s * share), target[1])

    def rates(self, state: list[Expr], force: Expr, target: Any) -> list[Expr]:
        """Return the change of the state in a sample, A x + B F + the hand's pull to its target, without friction.

        The target is position and velocity of what the hand aims at.
        """
        rates = self.free_rates(state)
        if force is not None:
            rates[self._force[0]] += self._force[1] * force
        if target is not None:
            row, spring, damper = self._target
            rates[row] += spring * target[0] + damper * target[1]
        return rates

    def free_rates(self, state: list[Expr]) -> list[Expr]:
        """Return A times a state, per sample."""
        rates: list[Expr] = [0.0] * len(state)
        for (row, column), entry in self._entries.items():
            rates[row] += entry * state[column]
        return rates

    def add_target_rates(self, rates: list[Expr], target: Any) -> list[Expr]:
        """Add how the rates change because the target moves, per sample squared."""
        if target is not None:
            row, spring, _ = self._target
            rates[row] += spring * (target[1] * self._sample_time_s)
        return rates


@dataclass(frozen=True)
class Drive:
    """Inputs of the plant between two samples."""

    force: Expr
    force_before: Expr
    late: Expr
    target: tuple[Expr, Expr] | None


@dataclass(frozen=True)
class _Stretch:
    """A part of a sample in which the force is constant."""

    name: str
    """Of its transition matrix among the parameters."""
    begin: float
    """Share of the sample before it."""
    share: float
    """Its share of the sample."""
    before: bool = False
    """Whether the force is still that of the sample before."""


@dataclass(frozen=True)
class MatrixExponential:
    """Linear plant, its force held or changing at one moment, exact; dry friction projected, implicit."""

    substeps: int
    has_force: bool
    has_target: bool
    late: float = 0.0
    friction_n: float = 0.0

    @property
    def _stretches(self) -> list[_Stretch]:
        """Parts of a sample of constant force; the last one has the new force."""
        new = _Stretch("transition", self.late, 1.0 - self.late)
        return [_Stretch("transition_before", 0.0, self.late, before=True), new] if self.late else [new]

    def step(self, tick: Tick, state: list[Expr], drive: Drive) -> list[Expr]:
        """Add the transition matrices and return the state one sample later."""
        x = ca.vertcat(*state)
        for stretch in self._stretches:
            force = drive.force_before if stretch.before else drive.force
            x = self._through(tick, stretch, x, force, drive.target)
        return list(ca.vertsplit(x))

    def _through(self, tick: Tick, stretch: _Stretch, x: Expr, force: Expr, target: Any) -> Expr:
        """Return the state x after a stretch of the sample by exact transitions x+ = A x + B F + C target in substeps.

        Dry friction acts as an impulse in each substep, which at most stops the device.
        """
        n = x.numel()
        name = stretch.name
        matrix = tick.parameter(name, ca.Sparsity.dense(n, n))
        of_force: Expr = tick.parameter(f"{name}_of_force", ca.Sparsity.dense(n, 1)) if self.has_force else None
        of_target: Expr = tick.parameter(f"{name}_of_target", ca.Sparsity.dense(n, 2)) if self.has_target else None
        rubs = self.friction_n > 0
        of_friction: Expr = tick.parameter(f"{name}_of_friction", ca.Sparsity.dense(n, 1)) if rubs else None
        for substep in range(self.substeps):
            x = ca.mtimes(matrix, x)
            if self.has_force:
                x += of_force * force
            if target is not None:
                position, velocity = target
                time_s = tick.sample_time_s * (stretch.begin + stretch.share * substep / self.substeps)
                x += ca.mtimes(of_target, ca.vertcat(position + velocity * time_s if time_s else position, velocity))
            if rubs:
                stopping = -x[1] / of_friction[1]
                friction = ca.fmin(ca.fmax(stopping, -self.friction_n), self.friction_n)
                x += of_friction * friction
                x[1] *= ca.fabs(stopping) > self.friction_n
        return x

    def parameters(self, plant: LinearPlant, sample_time_s: float) -> FloatArray:
        """Return the transition matrices of each stretch, of state, force, target and friction, columns first."""
        parts = []
        for stretch in self._stretches:
            step_s = sample_time_s * stretch.share / self.substeps
            moves = transition(plant, step_s)
            parts.append(_columns_first(moves.matrix))
            if self.has_force:
                parts.append(moves.force)
            if self.has_target:
                parts.append(_columns_first(moves.target))
            if self.friction_n > 0:
                parts.append(transition(replace(plant, force=plant.friction), step_s).force)
        return np.concatenate(parts, axis=-1)


def _columns_first(matrix: FloatArray) -> FloatArray:
    return np.swapaxes(matrix, -1, -2).reshape(*matrix.shape[:-2], -1)


@dataclass(frozen=True)
class TaylorSeries:
    """Plant with dry friction, or with a force that changes inside the sample: exact to rounding."""

    # Structure of the plant: its entries that are nonzero for any hand.
    entries: tuple[tuple[int, int], ...]
    force_row: int
    target_row: int | None
    friction_n: float
    substeps: int
    order: int

    @classmethod
    def of(cls, plant: LinearPlant, sample_time_s: float, friction_n: float, substeps: int) -> TaylorSeries:
        """Choose the order of the power series of exp(A h), and more substeps h where the plant is fast.

        Raises:
            UnsupportedError: more than `_MOST_SUBSTEPS` would be needed.
        """
        order = _order(plant, sample_time_s / substeps)
        while order > _HIGHEST_ORDER and substeps <= _MOST_SUBSTEPS:
            substeps *= 2
            order = _order(plant, sample_time_s / substeps)
        if order > _HIGHEST_ORDER or substeps > _MOST_SUBSTEPS:
            instead = 'scene.integrator = "projected"' if friction_n > 0 else "the effect jitter with rms_s = 0"
            raise UnsupportedError(
                f"the scene's mechanics move so fast within a sample of {sample_time_s:g} s that exact dry friction or "
                f"late forces would take more than {_MOST_SUBSTEPS} substeps; use {instead}, a heavier hand or "
                "device, or a slower amplifier or resonance"
            )
        hands = tuple(range(plant.matrix.ndim - 2))
        entries = tuple((int(i), int(j)) for i, j in np.argwhere(np.any(plant.matrix != 0, axis=hands)))
        force_row = int(np.flatnonzero(np.any(plant.force != 0, axis=hands))[0])
        rows = np.flatnonzero(np.any(plant.target != 0, axis=(*hands, plant.target.ndim - 1)))
        return cls(entries, force_row, int(rows[0]) if len(rows) else None, friction_n, substeps, order)

    def parameters(self, plant: LinearPlant, sample_time_s: float) -> FloatArray:
        """Return the entries of the plant, its force, target and friction, as changes in one sample, shape (..., p)."""
        columns = [plant.matrix[..., row, column] for row, column in self.entries]
        columns.append(plant.force[..., self.force_row])
        if self.target_row is not None:
            columns += [plant.target[..., self.target_row, 0], plant.target[..., self.target_row, 1]]
        if self.friction_n > 0:
            columns.append(-self.friction_n * plant.friction[..., 1])
        return np.stack(columns, axis=-1) * sample_time_s

    def step(self, tick: Tick, state: list[Expr], drive: Drive) -> list[Expr]:
        """Add the plant's numbers and return the state one sample later."""
        plant = PlantSymbols(self, tick)
        if drive.late is None:
            return self._through(plant, state, drive.force, drive.target, 1.0)
        middle = self._through(plant, state, drive.force_before, drive.target, drive.late)
        return self._through(plant, middle, drive.force, plant.target_after(drive.target, drive.late), 1.0 - drive.late)

    def _through(self, plant: PlantSymbols, state: list[Expr], force: Expr, target: Any, duration: Expr) -> list[Expr]:
        """Return the state after a stretch, whose duration is a share of the sample, by power series between events.

        Events are changes between sliding and sticking, of which two are located in a substep.
        """
        part = duration / self.substeps
        for _ in range(self.substeps):
            remaining = part
            breaking: Expr = 0
            # Two changes between sliding and sticking are located in a series; a third one waits for its end.
            for _ in range(2 if self.friction_n > 0 else 0):
                state, elapsed, breaking = self._until_event(plant, state, force, target, remaining, breaking)
                remaining -= elapsed
                target = plant.target_after(target, elapsed)
            state = self._to_the_end(plant, state, force, target, remaining, breaking)
            target = plant.target_after(target, remaining)
        return state

    def _until_event(
        self, plant: PlantSymbols, state: list[Expr], force: Expr, target: Any, remaining: Expr, breaking: Expr
    ) -> tuple[list[Expr], Expr, Expr]:
        """Return state, time used and break-away direction after sliding or sticking until an event, or the end.

        An event is a velocity of 0 while it slides, or a load above the friction while it sticks; both are zeros of a
        power series. Times are shares of a sample.
        """
        sliding, direction = _mode(plant, state, force, target, breaking)
        series, loads = self._series(plant, state, force, target, direction * plant.friction, sliding)
        sticking = 1 - sliding
        # The event function: the velocity in its direction, or the remaining friction force. While the device sticks,
        # all powers of its velocity are 0.
        sign = sliding * direction - sticking * ca.sign(_horner(loads, remaining))
        reserve = [sign * (v + sticking * r) for v, r in zip(series[1], loads, strict=False)]
        reserve[0] += sticking * plant.friction
        # From rest the velocity has a zero at the beginning, which is divided out.
        from_rest = ca.logic_and(sliding, state[1] == 0)
        reserve = [ca.if_else(from_rest, higher, power) for power, higher in pairwise(reserve)]
        elapsed = _first_zero(reserve, remaining)
        after = [_horner(powers, elapsed) for powers in series]
        event = elapsed < remaining
        # Sliding ends at a velocity of exactly 0.
        after[1] *= ca.logic_or(sticking, ca.logic_not(event))
        return after, elapsed, ca.logic_and(sticking, event)

    def _to_the_end(
        self, plant: PlantSymbols, state: list[Expr], force: Expr, target: Any, remaining: Expr, breaking: Expr
    ) -> list[Expr]:
        """Propagate for the remaining time; with dry friction, a velocity that would reverse is set to 0 at the end."""
        if self.friction_n == 0:
            return [_horner(powers, remaining) for powers in self._series(plant, state, force, target)[0]]
        sliding, direction = _mode(plant, state, force, target, breaking)
        series, _ = self._series(plant, state, force, target, direction * plant.friction, sliding)
        after = [_horner(powers, remaining) for powers in series]
        after[1] *= direction * after[1] >= 0
        return after

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
            rates = plant.free_rates(powers[-1]) if power else plant.rates(state, force, target)
            if power == 1:
                rates = plant.add_target_rates(rates, target)
            loads.append(rates[1])
            if friction is not None and power == 0:
                rates[1] -= friction
            if sliding is not None:
                rates[1] *= sliding
            powers.append([rate * (1.0 / (power + 1)) for rate in rates])
        return [list(column) for column in zip(*powers, strict=True)], loads


Advance = MatrixExponential | TaylorSeries
"""Propagation of the continuous part from one sample to the next, and the parameters that it adds, (hands, p)."""


def _mode(plant: PlantSymbols, state: list[Expr], force: Expr, target: Any, breaking: Expr) -> tuple[Expr, Expr]:
    """Return whether the device slides (1) or sticks (0), and the direction in which it slides or would break away."""
    velocity, load = state[1], plant.rates(state, force, target)[1]
    moving = velocity != 0
    sliding = ca.logic_or(ca.logic_or(moving, breaking), ca.fabs(load) > plant.friction)
    return sliding, ca.sign(velocity) + (1 - moving) * ca.sign(load)


def _first_zero(powers: list[Expr], remaining: Expr) -> Expr:
    """Return where a polynomial, given by its powers, that is not negative at 0 becomes negative, or `remaining`.

    A parabola through the end gives a guess, which bracketed Newton steps refine.
    """
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
    for _ in range(_ROOT_STEPS):
        inside = ca.logic_and(guess >= low, guess <= high)
        guess = ca.if_else(inside, guess, 0.5 * (low + high))
        value = _horner(powers, guess)
        high, low = ca.if_else(value < 0, guess, high), ca.if_else(value < 0, low, guess)
        guess -= value / _horner(slopes, guess)
    return ca.if_else(_horner(powers, until) < 0, ca.fmin(ca.fmax(guess, low), high), remaining)


def _horner(powers: list[Expr], time: Expr) -> Expr:
    value = powers[-1]
    for power in reversed(powers[:-1]):
        value = power + time * value
    return value


def _order(plant: LinearPlant, step_s: float) -> int:
    """Return the power n beyond which the terms (A h)^n/n! of exp(A h) are negligible, A the plant and h a step, s."""
    scale = time_scale(plant, step_s)
    matrix = plant.matrix * step_s * scale[:, None] / scale
    term = np.eye(plant.states)
    for power in range(1, _HIGHEST_ORDER + 1):
        term = term @ matrix / power
        largest = np.abs(term).max()
        if largest < _NEGLIGIBLE_TERM:
            return power
        if largest > _LARGEST_TERM:
            break
    return _HIGHEST_ORDER + 1
