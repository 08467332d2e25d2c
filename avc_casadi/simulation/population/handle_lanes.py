"""Handles of an admittance device in many parallel runs (lanes): exact between events, contacts one-sided.

A hand holds the handle or has released it, and the handle touches its contact or not. These are four linear plants,
each with its exact transition over a sample. Where a handle may touch or leave within a sample, its motion is a power
series of the time, and the moment of the event a root of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray, IndexArray
from avc_casadi.loops.spectrum import root
from avc_casadi.model.admittance import AdmittanceDevice
from avc_casadi.model.driven import driven_plant, sensor_row
from avc_casadi.model.hands import Hand
from avc_casadi.model.plant import LinearPlant, discretised, transition

_TOUCHES = 1
"""Added to the number of a plant, 0 of a released handle in free space, where the handle touches."""
_HELD = 2
"""Added to the number of a plant where a hand holds the handle."""
_TERMS = 16
"""Terms of a power series: over a step, in which no pole turns by more than a radian, the next one is 1/16! = 5e-14."""
_LOOKS = 4
"""Points of a step at which a contact is looked at."""
_AT_LOOKS = np.vander(np.arange(1, _LOOKS + 1) / _LOOKS, _TERMS, increasing=True)
"""Powers of these shares of a step, (looks, terms)."""
_MOST_EVENTS = 32
"""Events in a sample: a handle that bounces more often passes the rest of the sample as it is."""
_REACH = 2.0
"""How much farther a handle may move in a sample than by the sum of all its speeds."""
_ROUNDING = 1e-12
"""Share of a sample below which no time is left of it."""


@dataclass(frozen=True)
class HandTarget:
    """Where the hands of all lanes aim, at constant speed over a sample; both of shape (lanes,)."""

    position_m: FloatArray
    velocity_m_per_s: FloatArray


@dataclass(frozen=True, eq=False)
class _Plants:
    """The four plants of every lane; lanes are the last axis, but of `rates`.

    Attributes:
        matrix: transition over a sample, (4, n, n, lanes).
        new: of the command that arrives within the sample, (4, n, lanes).
        old: of the one before, which acts until then.
        aim: of position and velocity of the target, (4, n, 2, lanes).
        rates: time derivatives, of state, command, position and velocity of the target, (4, lanes, n, n + 3).
    """

    matrix: FloatArray
    new: FloatArray
    old: FloatArray
    aim: FloatArray
    rates: FloatArray

    @classmethod
    def of(cls, device: AdmittanceDevice, hands: Hand, contacts: Hand) -> _Plants:
        """Return the plants of a device with the hand and the contact of each lane."""
        nothing = np.zeros(len(hands))
        plants = [
            _touching(device, hand, contacts) if touches else driven_plant(device, hand)
            for hand in (Hand(nothing, nothing, nothing), hands)
            for touches in (False, True)
        ]
        matrix, new, old = discretised(plants, [device] * len(plants))
        aim = np.stack([transition(plant, device.sample_time_s).target for plant in plants])
        rates = [np.concatenate([plant.matrix, plant.force[..., None], plant.target], axis=-1) for plant in plants]
        matrix, new, old, aim = (np.ascontiguousarray(np.moveaxis(part, 1, -1)) for part in (matrix, new, old, aim))
        return cls(matrix, new, old, aim, np.stack(rates))

    def plant(self, number: int) -> _Plants:
        """Return a copy of the same plant of every lane, without the first axis."""
        return _Plants(
            matrix=self.matrix[number].copy(),
            new=self.new[number].copy(),
            old=self.old[number].copy(),
            aim=self.aim[number].copy(),
            rates=self.rates[number].copy(),
        )

    def set(self, lanes: IndexArray, numbers: IndexArray, plants: _Plants) -> None:
        """Set some lanes of these, which have no first axis, to plants of others, by their numbers."""
        self.rates[lanes] = plants.rates[numbers, lanes]
        for part, chosen in zip(self._by_lane, plants._by_lane, strict=True):
            part[..., lanes] = np.moveaxis(chosen[numbers, ..., lanes], 0, -1)

    @property
    def _by_lane(self) -> tuple[FloatArray, ...]:
        return self.matrix, self.new, self.old, self.aim


def _touching(device: AdmittanceDevice, hand: Hand, contact: Hand) -> LinearPlant:
    """Return the plant of a handle that touches: its contact is joined to the ground, not to the hand's target."""
    carried = Hand(
        mass_kg=hand.mass_kg,
        damping_ns_per_m=hand.damping_ns_per_m + contact.damping_ns_per_m,
        stiffness_n_per_m=hand.stiffness_n_per_m + contact.stiffness_n_per_m,
    )
    return replace(driven_plant(device, carried), target=driven_plant(device, hand).target)


class HandleLanes:
    """A device in many lanes, each with a hand and with the contact that its handle may touch, whose surface is at 0.

    The contact pushes with k x_h + b v_h where x_h > 0 and this is above 0: it never pulls.

    Args:
        device: without ranges.
        hands: the hand of each lane, which holds the handle; its spring and damper end at its target.
        contacts: spring and damper that each handle may touch, 0 where there is nothing; their masses are 0.
    """

    def __init__(self, device: AdmittanceDevice, hands: Hand, contacts: Hand) -> None:
        """Set up the plants of each lane, with and without hand and contact, at rest, and the commands on their way."""
        sensor, period_s = device.force_sensor, device.sample_time_s
        self._plants = _Plants.of(device, hands, contacts)
        self._plant = np.full(len(hands), _HELD)
        self._now = self._plants.plant(_HELD)
        self._sensor = sensor_row(device, driven_plant(device, hands).names)
        stiffness = np.asarray(contacts.stiffness_n_per_m)
        self._touchable = stiffness > 0
        self._lag_s = np.where(self._touchable, contacts.damping_ns_per_m, 0) / np.where(stiffness > 0, stiffness, 1)
        self._swing_rad_per_s = math.sqrt(sensor.stiffness_n_per_m / sensor.handle_mass_kg)
        self._step_s = _step_s(self._plants.rates, period_s)
        self._period_s = period_s
        self._late_s = (device.delay_samples - int(device.delay_samples)) * period_s
        self._commands = [np.zeros(len(hands))] * (int(device.delay_samples) + 2)
        self.state: FloatArray = np.zeros(self._now.new.shape)
        """Drive, then position and velocity of the handle, (n, lanes)."""

    @property
    def touching(self) -> BoolArray:
        """Whether each handle touches its contact."""
        return np.asarray(self._plant % _HELD == _TOUCHES)

    @property
    def sensor_n(self) -> FloatArray:
        """What each sensor reads, without noise."""
        return np.asarray(self._sensor @ self.state)

    def place(self, drive_m: FloatArray, handle_m: FloatArray, handle_m_per_s: FloatArray) -> None:
        """Set drives and handles at the beginning, the drives at rest; no handle touches."""
        self.state[0] = drive_m
        self.state[-2] = handle_m
        self.state[-1] = handle_m_per_s

    def acceleration_m_per_s2(self, target: HandTarget) -> FloatArray:
        """Return the acceleration of each handle."""
        row = self._now.rates[:, -1]
        aim = row[:, -2] * target.position_m + row[:, -1] * target.velocity_m_per_s
        return np.asarray(np.einsum("lj,jl->l", row[:, : len(self.state)], self.state) + aim)

    def release(self, lanes: BoolArray) -> None:
        """Let the hands of some lanes leave the handle, which keeps its speed."""
        self._set(np.where(lanes & (self._plant >= _HELD), self._plant - _HELD, self._plant))

    def _set(self, plant: IndexArray) -> None:
        lanes = np.flatnonzero(plant != self._plant)
        self._plant = plant
        self._now.set(lanes, plant[lanes], self._plants)

    def move(self, command: FloatArray, target: HandTarget) -> None:
        """Advance by a sample, with the velocity that is commanded at its beginning.

        x+ = A x + B_new u(k-n) + B_old u(k-n-1), of what a hand aims at in addition; by events where there may be one.
        """
        self._commands = [command, *self._commands[:-1]]
        new, old = self._commands[-2:]
        now, before = self._now, self.state
        after = np.einsum("ijl,jl->il", now.matrix, before) + now.new * new + now.old * old
        after += now.aim[:, 0] * target.position_m + now.aim[:, 1] * target.velocity_m_per_s
        near = self._may_change(np.abs(new) + np.abs(old), target)
        self.state = after
        near |= self._may_change(np.abs(new) + np.abs(old), target)
        if near.any():
            self._pass_events(np.flatnonzero(near), before, target)

    def _may_change(self, commanded_m_per_s: FloatArray, target: HandTarget) -> BoolArray:
        """Return which handles may touch or leave within a sample: by the sum of all speeds that they may reach."""
        if not self._touchable.any():
            return self._touchable.copy()
        swing = np.abs(self.acceleration_m_per_s2(target)) / self._swing_rad_per_s
        speed = np.abs(self.state[-1]) + np.abs(self.state[1]) + commanded_m_per_s + swing
        reach = _REACH * speed * (self._period_s + self._lag_s)
        return np.asarray(self._touchable & (np.abs(self.state[-2]) <= reach))

    def _pass_events(self, lanes: IndexArray, before: FloatArray, target: HandTarget) -> None:
        """Advance some lanes by a sample once more, from event to event: until a new command arrives, then with it."""
        passage = _Passage(
            rates=self._plants.rates[:, lanes],
            plant=self._plant[lanes],
            state=before[:, lanes].T.copy(),
            target_m=target.position_m[lanes].copy(),
            target_m_per_s=target.velocity_m_per_s[lanes],
            lag_s=self._lag_s[lanes],
        )
        new, old = self._commands[-2:]
        for span_s, command in ((self._late_s, old), (self._period_s - self._late_s, new)):
            passage.advance(span_s, self._step_s, command[lanes])
        self.state[:, lanes] = passage.state.T
        plant = self._plant.copy()
        plant[lanes] = passage.plant
        self._set(plant)


def _step_s(rates: FloatArray, period_s: float) -> float:
    """Return the longest part of a sample, a whole fraction of it, in which no pole turns by more than a radian."""
    fastest_per_s = float(np.abs(np.linalg.eigvals(rates[..., : rates.shape[-2]])).max())
    return period_s / max(1, math.ceil(fastest_per_s * period_s))


@dataclass(eq=False)
class _Passage:
    """Some lanes within a sample; arrays have shape (lanes,), the state (lanes, n), rates (4, lanes, n, n + 3)."""

    rates: FloatArray
    plant: IndexArray
    state: FloatArray
    target_m: FloatArray
    target_m_per_s: FloatArray
    lag_s: FloatArray
    """Damper over spring of the contact."""

    def advance(self, span_s: float, longest_step_s: float, command: FloatArray) -> None:
        """Advance by a span, in steps and from event to event."""
        left_s = np.full(len(self.plant), span_s)
        steps = math.ceil(span_s / longest_step_s) + _MOST_EVENTS
        for count in range(2 * steps):
            rows = np.flatnonzero(left_s > _ROUNDING * longest_step_s)
            if not rows.size:
                return
            step_s = np.minimum(left_s[rows], longest_step_s)
            left_s[rows] -= self._step(rows, step_s, command[rows], watched=count < steps)

    def _step(self, rows: IndexArray, step_s: FloatArray, command: FloatArray, *, watched: bool) -> FloatArray:
        """Advance rows by a step, s, by its power series, or until their handle touches or leaves; return the time."""
        terms = self._series(rows, step_s, command)
        share = np.ones(len(rows))
        if watched:
            depth, speed = terms[..., -2], terms[..., -1]
            touches = self.plant[rows] % _HELD == _TOUCHES
            share, changes = _first_event(np.stack([depth, depth + self.lag_s[rows] * speed], axis=1), touches)
            self.plant[rows] += np.where(changes, np.where(touches, -_TOUCHES, _TOUCHES), 0)
        self.state[rows] = terms.sum(axis=0)
        early = share < 1
        self.state[rows[early]] = _value(terms[:, early], share[early, None])
        self.target_m[rows] += self.target_m_per_s[rows] * share * step_s
        return np.asarray(share * step_s)

    def _series(self, rows: IndexArray, step_s: FloatArray, command: FloatArray) -> FloatArray:
        """Return the terms of x(s h) = sum of c_j s^j over a step h, (terms, rows, n).

        With x' = A x + B u + G (x_t + v_t s h), of which the last two are f_0 + f_1 s:  c_1 = h (A c_0 + f_0),
        c_2 = h (A c_1 + f_1)/2, and c_j = h A c_(j-1)/j from there on.
        """
        rates = self.rates[self.plant[rows], rows]
        n = self.state.shape[-1]
        matrix, by_command, by_place, by_speed = rates[..., :n], rates[..., n], rates[..., n + 1], rates[..., n + 2]
        step = step_s[:, None]
        speed = self.target_m_per_s[rows, None]
        held = by_command * command[:, None] + by_place * self.target_m[rows, None] + by_speed * speed
        drawn = by_place * speed * step
        terms = np.empty((_TERMS, len(rows), n))
        terms[0] = self.state[rows]
        for order in range(1, _TERMS):
            pushed = held if order == 1 else drawn if order == 2 else 0.0
            terms[order] = step / order * (np.einsum("lij,lj->li", matrix, terms[order - 1]) + pushed)
        return terms


def _first_event(deciding: FloatArray, touches: BoolArray) -> tuple[FloatArray, BoolArray]:
    """Return the share of a step until each handle touches or leaves, 1 where it does neither, and whether it does.

    The lesser of two polynomials decides, terms of shape (terms, 2, rows): the depth, and the force over the spring.
    """
    touching = np.tensordot(_AT_LOOKS, deciding, 1).min(axis=1) > 0
    changed = touching != touches
    changes = changed.any(axis=0)
    after = np.where(changes, (changed.argmax(axis=0) + 1) / _LOOKS, 1.0)
    rows = np.flatnonzero(changes)
    if rows.size:
        high = after[rows]
        low = high - 1 / _LOOKS
        event = root(lambda share: _value(deciding[..., rows], share).min(axis=0), low, high)
        after[rows] = np.clip(event, low, high)
    return after, changes


def _value(terms: FloatArray, share: FloatArray) -> FloatArray:
    """Return the value of polynomials at a share of their step, by Horner."""
    value: FloatArray = terms[-1]
    for term in terms[-2::-1]:
        value = value * share + term
    return value
