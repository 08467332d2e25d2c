"""The frozen loop of a contact in space: tip, hand and a coupling K n n' + s K_t (I - n n'), sample to sample.

The tip moves as L x'' + b x' + M_h x'' + B_h x' + K_h x = -F; L is that of the pose, the hand's matrices are symmetric,
each with its own axes; velocity products vanish at rest and are omitted. F is held for a sample and is that of the
springs K n n' + s K_t (I - n n') over x, and of the dampers D n n' + s D_t (I - n n') over (x - x_before)/T: s = 0
leaves the tangent free, s = 1 holds it, as a sticking proxy does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.arrays import FloatArray, IndexArray
from avc_casadi.arm.effective_mass import operational_inertia
from avc_casadi.claims.stability.frozen_loop import MAX_DELAY_SAMPLES
from avc_casadi.model.plant import expm

if TYPE_CHECKING:
    from avc_casadi.model.device import Device

# Eigenvalues of free motion along the surface, 1 but for the rounding of a double root.
_FREE = 1e-6
_AT_ONCE = 4000


@dataclass(frozen=True)
class Contacts:
    """Poses, normals and hands, p of each.

    Attributes:
        mobility_per_kg: J M^-1 J', shape (p, d, d).
        normal: of length 1, shape (p, d).
        tangent_share: s, shape (p,).
        damping_ns_per_m: b of the device, shape (p,).
        hand_mass_kg: M_h, shape (p, d, d); with the others 0 where the device is released.
        hand_damping_ns_per_m: B_h.
        hand_stiffness_n_per_m: K_h.
    """

    mobility_per_kg: FloatArray
    normal: FloatArray
    tangent_share: FloatArray
    damping_ns_per_m: FloatArray
    hand_mass_kg: FloatArray
    hand_damping_ns_per_m: FloatArray
    hand_stiffness_n_per_m: FloatArray

    def __len__(self) -> int:
        return len(self.normal)

    def pick(self, rows: IndexArray | slice) -> Self:
        """Return some of the contacts."""
        return type(self)(*(value[rows] for value in vars(self).values()))


@dataclass(frozen=True)
class ContactLoops:
    """The sampled plant of p contacts on one device.

    States: position, velocity times T, amplifier, previous measured position, delayed forces.

    Attributes:
        open_loop: shape (p, s, s).
        push: input column of the commanded force, shape (p, s, d), forces in `force_unit_n`.
        force_unit_n: shape (p,).
        along: n n', shape (p, d, d).
        across: s (I - n n'), shape (p, d, d).
        before: first state of the previous measured position.
        sample_time_s: T.
        free_states: eigenvalues of free motion along the surface, shape (p,).
    """

    open_loop: FloatArray
    push: FloatArray
    force_unit_n: FloatArray
    along: FloatArray
    across: FloatArray
    before: int
    sample_time_s: float
    free_states: IndexArray

    def radius(self, stiffness_n_per_m: FloatArray, damping_ns_per_m: FloatArray) -> FloatArray:
        """Return the spectral radius of each contact with its own coupling, shape (p,).

        Free motion along the surface, which neither decays nor grows, is excluded.

        Args:
            stiffness_n_per_m: K and K_t, shape (2, p).
            damping_ns_per_m: D and D_t, shape (2, p).
        """
        values = np.concatenate(
            [
                np.linalg.eigvals(self._closed(slice(begin, begin + _AT_ONCE), stiffness_n_per_m, damping_ns_per_m))
                for begin in range(0, len(self.push), _AT_ONCE)
            ]
            or [np.zeros((0, 1))]
        )
        size = np.abs(values)
        loose = np.flatnonzero(self.free_states)
        if loose.size:
            away = np.abs(values[loose] - 1)
            rank = away.argsort(axis=1).argsort(axis=1)
            ignored = (rank < self.free_states[loose, None]) & (away < _FREE)
            size[loose] = np.where(ignored, 0.0, size[loose])
        return np.asarray(size.max(axis=1, initial=0.0))

    def _closed(self, some: slice, stiffness: FloatArray, damping: FloatArray) -> FloatArray:
        d = self.push.shape[2]
        unit = self.force_unit_n[some]
        parts = np.stack([self.along[some], self.across[some]])
        spring, rate = (
            np.einsum("kp,kpij->pij", gain[:, some] / unit, parts) for gain in (stiffness, damping / self.sample_time_s)
        )
        law = np.zeros((len(unit), d, self.open_loop.shape[2]))
        law[:, :, :d] = spring + rate
        law[:, :, self.before : self.before + d] = -rate
        return np.asarray(self.open_loop[some] + self.push[some] @ law)


def contact_loops(device: Device, contacts: Contacts) -> ContactLoops:
    """Return the exact discretisation of contacts.

    Args:
        device: gives sample time, delay and amplifier; mass and damping are those of the contacts.
        contacts: poses, normals and hands.

    Raises:
        UnsupportedError: the device has a resonance, or more than `MAX_DELAY_SAMPLES` samples of delay.
    """
    if device.resonance is not None:
        raise UnsupportedError(
            "the coupled loop of an arm knows no resonance, whose shape in space a frequency does not tell; leave it "
            "out of the arm file to judge the arm as rigid",
            key="device.resonance",
        )
    if device.delay_samples > MAX_DELAY_SAMPLES:
        raise UnsupportedError(
            f"the coupled loop is computed up to {MAX_DELAY_SAMPLES} samples of delay", key="device.delay_samples"
        )
    d, period = contacts.normal.shape[1], device.sample_time_s
    own = operational_inertia(contacts.mobility_per_kg)
    unit = np.trace(own, axis1=1, axis2=2) / d / period**2
    loop, push, before = _delayed(*_rates(device, contacts, own, unit), device.delay_samples)
    square = contacts.normal[:, :, None] * contacts.normal[:, None, :]
    across = contacts.tangent_share[:, None, None] * (np.eye(d) - square)
    held = np.abs(contacts.hand_stiffness_n_per_m).max(axis=(1, 2), initial=0.0) > 0
    loose = ~held & (contacts.tangent_share == 0)
    # Position and velocity; with any damping the velocity decays.
    free = np.where(loose, 2 * (d - 1), 0)
    return ContactLoops(loop, push, unit, square, across, before, period, free)


def _rates(device: Device, contacts: Contacts, own: FloatArray, unit: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the rates of position, velocity and amplifier per sample, and the input matrix of scaled forces."""
    p, d = contacts.normal.shape
    period = device.sample_time_s
    rigid = np.linalg.inv(own + contacts.hand_mass_kg)
    damper = contacts.damping_ns_per_m[:, None, None] * np.eye(d) + contacts.hand_damping_ns_per_m
    order = 0 if device.amplifier_bandwidth_hz is None else device.amplifier_order
    c = d * (2 + order)
    rates, entry = np.zeros((p, c, c)), np.zeros((p, c, d))
    rates[:, :d, d : 2 * d] = np.eye(d)
    rates[:, d : 2 * d, :d] = -(period**2) * rigid @ contacts.hand_stiffness_n_per_m
    rates[:, d : 2 * d, d : 2 * d] = -period * rigid @ damper
    against = -(period**2) * unit[:, None, None] * rigid
    if order == 0:
        entry[:, d:] = against
    else:
        rates[:, d : 2 * d, 2 * d : 3 * d] = against
        turn = 2 * math.pi * (device.amplifier_bandwidth_hz or 0.0) * period
        last = slice(c - d, c)
        if order == 1:
            rates[:, last, last], entry[:, last] = -turn * np.eye(d), turn * np.eye(d)
        else:
            rates[:, 2 * d : 3 * d, last] = np.eye(d)
            rates[:, last, 2 * d : 3 * d] = -(turn**2) * np.eye(d)
            rates[:, last, last] = -2 * device.amplifier_damping_ratio * turn * np.eye(d)
            entry[:, last] = turn**2 * np.eye(d)
    return rates, entry


def _delayed(rates: FloatArray, entry: FloatArray, delay_samples: float) -> tuple[FloatArray, FloatArray, int]:
    """Return the open loop, the input columns of the commanded force, and the index of the previous position."""
    p, c, d = entry.shape
    whole = int(delay_samples)
    late = delay_samples - whole
    matrix, new = _held(rates, entry, 1.0)
    old = np.zeros_like(new)
    if late:
        _, before = _held(rates, entry, late)
        after, new = _held(rates, entry, 1 - late)
        old = after @ before
    under_way = whole + (late > 0)
    s = c + d + d * under_way
    loop, push = np.zeros((p, s, s)), np.zeros((p, s, d))
    loop[:, :c, :c] = matrix
    loop[:, c : c + d, :d] = np.eye(d)
    for ago, part in ((whole, new), (whole + 1, old)):
        if ago == 0:
            push[:, :c] += part
        elif ago <= under_way:
            loop[:, :c, c + d * ago : c + d * (ago + 1)] += part
    if under_way:
        push[:, c + d : c + 2 * d] = np.eye(d)
        loop[:, c + 2 * d :, c + d : c + d * under_way] = np.eye(d * (under_way - 1))
    return loop, push, c


def _held(rates: FloatArray, entry: FloatArray, samples: float) -> tuple[FloatArray, FloatArray]:
    """Return the transition from a state and a force held for so many samples to the state after them."""
    p, c, d = entry.shape
    augmented = np.zeros((p, c + d, c + d))
    augmented[:, :c, :c], augmented[:, :c, c:] = rates * samples, entry * samples
    found = expm(augmented)
    return found[:, :c, :c], found[:, :c, c:]
