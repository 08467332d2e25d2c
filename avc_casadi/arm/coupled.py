"""Stability of the coupled loop in space: poses, normals and hands drawn, and searched for the smallest margin.

Designs of one axis do not imply it: the device couples the axes (Li, Tavakoli and Huang, IEEE Trans. Control Systems
Technology, 2014). The margin is the factor by which stiffness and damping together may grow until the loop with some
pose, normal and hand is unstable. It is the result of a search, no proof.

Poses, normals and hands are points of a unit box: position of the tip; normal; share of the coupling along the tangent;
damping of the device; then of the hand the principal masses, dampings and stiffnesses, and the axes of each of the
three. A hand in space is a symmetric mass, damper and spring, each with principal values in the ranges of [hands].
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.arm.contact import Contacts, contact_loops
from avc_casadi.arm.effective_mass import climb, mobility, reached, unit
from avc_casadi.claims.stability.frozen_loop import RADIUS_TOLERANCE
from avc_casadi.model.corners import device_corners
from avc_casadi.model.hands import hand_ranges

if TYPE_CHECKING:
    from avc_casadi.arm.arm import Arm
    from avc_casadi.arm.design import DirectedGains
    from avc_casadi.model.device import Device
    from avc_casadi.model.problem import Hands


_POINTS, _STARTS, _PASSES = 3000, 6, 2
# Cases with a critical factor above the worst so far by more than this ratio are not searched.
_HOPEFUL = 1.5
# Share of the coordinates at an end of the box.
_AT_END = 0.5
_LEAST, _MOST, _HALVINGS = 1 / 16, 16.0, 20
# Ratio of the gains in the search to the critical ones: the slow mode of a hand, independent of the gains, would
# otherwise mask their effect.
_BEYOND = 1.05


@dataclass(frozen=True)
class WorstContact:
    """The pose, normal and hand with the smallest critical factor of the gains.

    Attributes:
        factor: critical factor of stiffness and damping.
        radius: spectral radius at the nominal gains.
        tip_m: position of the tip, shape (d,).
        contact: the one contact.
        held: by a hand, or released.
        delay_samples: of the corner of the device.
        amplifier_bandwidth_hz: of the corner of the device.
    """

    factor: float
    radius: float
    tip_m: FloatArray
    contact: Contacts
    held: bool
    delay_samples: float
    amplifier_bandwidth_hz: float | None

    def document(self) -> dict[str, Any]:
        """Return its numbers by name."""
        one = self.contact
        return {
            "factor": self.factor,
            "radius": self.radius,
            "tip_m": self.tip_m,
            "normal": one.normal[0],
            "tangent_share": float(one.tangent_share[0]),
            "held": self.held,
            "damping_ns_per_m": float(one.damping_ns_per_m[0]),
            "delay_samples": self.delay_samples,
            "amplifier_bandwidth_hz": self.amplifier_bandwidth_hz,
            "inertia_kg": np.linalg.inv(one.mobility_per_kg[0]),
            "hand_mass_kg": one.hand_mass_kg[0],
            "hand_damping_ns_per_m": one.hand_damping_ns_per_m[0],
            "hand_stiffness_n_per_m": one.hand_stiffness_n_per_m[0],
        }


@dataclass(frozen=True)
class CoupledCertificate:
    """Result of the search.

    Attributes:
        stable: with all evaluated contacts, at the nominal gains.
        worst: that with the smallest critical factor.
        radius: largest spectral radius at the nominal gains, of the drawn contacts and of the worst.
        looked_at: number of evaluated poses with normals and hands.
    """

    stable: bool
    worst: WorstContact
    radius: float
    looked_at: int


def coupled_certificate(
    arm: Arm, gains: DirectedGains, *, points: int = _POINTS, seed: int = 0, progress: Progress = SILENT
) -> CoupledCertificate:
    """Search for the pose, normal, hand and device with the least margin, held by hands in space and released.

    Args:
        arm: workspace, device with its ranges, hands.
        gains: of the coupling, any share of which may act along the tangent.
        points: drawn for each corner of the device, held and released.
        seed: of the draws.
        progress: reported over the corners.

    Raises:
        UnsupportedError: the device has a resonance.
    """
    cases = [
        _Case.of(arm, gains, device, held=held, points=points, seed=seed)
        for device in electronics(arm)
        for held in (True, False)
    ]
    found: list[WorstContact] = []
    for number, case in enumerate(sorted(cases, key=lambda one: one.factor)):
        progress.advance(number, len(cases), "corners")
        # The search lowers a factor by some per cent.
        if not found or case.factor < _HOPEFUL * min(one.factor for one in found):
            found.append(case.searched(seed))
    least = min(found, key=lambda one: one.factor)
    radius = max(*(case.radius for case in cases), *(one.radius for one in found))
    stable = least.factor > 1 and radius < 1 - RADIUS_TOLERANCE
    return CoupledCertificate(stable, least, radius, points * len(cases))


def electronics(arm: Arm) -> list[Device]:
    """Return the corners of delay and amplifier."""
    return device_corners(arm.file.device, ("delay_samples", "amplifier_bandwidth_hz", "amplifier_damping_ratio"))


def random_points(arm: Arm, count: int, seed: int, *, held: bool, at_end: float = 0.0) -> FloatArray:
    """Return points of the unit box of contacts, uniform but for a share of coordinates at an end of the box.

    Args:
        arm: the arm.
        count: p.
        seed: of the draw.
        held: by a hand, or released.
        at_end: that share.
    """
    random = np.random.default_rng(seed)
    points = random.random((count, coordinates(arm, held=held)))
    # Positions and normals are not moved to ends: these are few among many.
    ends = random.random(points.shape) < at_end
    ends[:, : 2 * len(arm.axes)] = False
    return np.where(ends, np.round(points), points)


def radii(
    arm: Arm, gains: DirectedGains, device: Device, points: FloatArray, *, held: bool
) -> Callable[[float], FloatArray]:
    """Return the spectral radii at points as a function of the factor of the gains; not a number without contact.

    Args:
        arm: the arm.
        gains: of the coupling.
        device: a corner of `electronics`.
        points: shape (p, coordinates).
        held: by a hand, or released.
    """
    some = drawn(arm, points, held=held)
    loops = contact_loops(device, some.contacts)
    stiffness, damping = gains.at(some.tip_m, some.contacts.normal)

    def radius(factor: float) -> FloatArray:
        found = np.full(len(points), np.nan)
        found[some.there] = loops.radius(factor * stiffness, factor * damping)
        return found

    return radius


@dataclass(frozen=True)
class _Case:
    """Points drawn at one corner of the device, with hands or released.

    Attributes:
        factor: smallest critical factor of the gains.
        radius: largest spectral radius at the nominal gains.
    """

    arm: Arm
    gains: DirectedGains
    device: Device
    held: bool
    pool: FloatArray
    starts: FloatArray
    factor: float
    radius: float

    @classmethod
    def of(cls, arm: Arm, gains: DirectedGains, device: Device, *, held: bool, points: int, seed: int) -> _Case:
        pool = random_points(arm, points, seed, held=held, at_end=_AT_END)
        at = radii(arm, gains, device, pool, held=held)
        here, first = at(1.0), critical_factor(at)
        beyond = at(_BEYOND * first)
        order = np.argsort(-np.where(np.isnan(beyond), -np.inf, beyond))
        return cls(arm, gains, device, held, pool, pool[order[:_STARTS]], first, float(np.nanmax(here)))

    def at(self, points: FloatArray) -> Callable[[float], FloatArray]:
        return radii(self.arm, self.gains, self.device, points, held=self.held)

    def searched(self, seed: int) -> WorstContact:
        """Search from the worst of the points, and again at the critical gains of the first result."""
        places, first = self.starts, self.factor
        for again in range(_PASSES):
            factor = _BEYOND * first

            def value(some: FloatArray, factor: float = factor) -> FloatArray:
                return self.at(some)(factor)

            places, _ = climb(value, places, seed=seed + again)
            first = min(first, critical_factor(self.at(places)))
        every = np.concatenate([places, self.starts[:1]])
        each = [critical_factor(self.at(one[None])) for one in every]
        one = every[int(np.argmin(each))][None]
        some = drawn(self.arm, one, held=self.held)
        delay, band = self.device.delay_samples, self.device.amplifier_bandwidth_hz
        radius = float(self.at(one)(1.0)[0])
        return WorstContact(min(each), radius, some.tip_m[0], some.contacts, self.held, delay, band)


def critical_factor(radius: Callable[[float], FloatArray]) -> float:
    """Return the smallest factor of the gains at which a radius reaches 1, between 1/16 and 16.

    Args:
        radius: radii as a function of the factor; not a number is ignored.
    """
    low, high = _LEAST, _MOST
    for _ in range(_HALVINGS):
        middle = float(np.sqrt(low * high))
        found = radius(middle)
        if np.nanmax(found, initial=0.0) < 1:
            low = middle
        else:
            high = middle
    return high


# A normal of coordinates that are nearly 0 has no direction.
_SHORT = 0.1
# A pose nearly singular along a direction cannot move there; it is excluded from the claim.
_HEAVIEST_KG = 1e3


@dataclass(frozen=True)
class Drawn:
    """Contacts at points of the box.

    Attributes:
        contacts: of the valid points, p of them.
        tip_m: positions of the tip, shape (p, d).
        there: which points are valid, shape (points,).
    """

    contacts: Contacts
    tip_m: FloatArray
    there: BoolArray


def coordinates(arm: Arm, *, held: bool) -> int:
    """Return the number of coordinates, with a hand or for the device released."""
    d = len(arm.axes)
    return 2 * d + 2 + (3 * d + 3 * _turns(d) if held else 0)


def drawn(arm: Arm, points: FloatArray, *, held: bool) -> Drawn:
    """Return the contacts at points of the unit box.

    Args:
        arm: workspace, device and hands.
        points: shape (p, coordinates).
        held: by a hand, or released: the tangent is then free or held, not in between.
    """
    d = len(arm.axes)
    low, high = arm.box_m
    tip = low + (high - low) * points[:, :d]
    toward = 2 * points[:, d : 2 * d] - 1
    joints, there = reached(arm, tip)
    there = there & (np.linalg.norm(toward, axis=1) > _SHORT)
    here = mobility(arm, joints[there])
    movable = np.linalg.eigvalsh(here)[:, 0] > 1 / _HEAVIEST_KG
    there[np.flatnonzero(there)[~movable]] = False
    at = points[there]
    share, damping = at[:, 2 * d], at[:, 2 * d + 1]
    ends = arm.file.device.range.damping_ns_per_m or (arm.file.device.damping_ns_per_m,) * 2
    hand = _hand(arm.file.hands, at[:, 2 * d + 2 :], d) if held else np.zeros((3, len(at), d, d))
    found = Contacts(
        here[movable],
        unit(toward[there]),
        share if held else np.round(share),
        ends[0] + (ends[1] - ends[0]) * damping,
        *hand,
    )
    return Drawn(found, tip[there], there)


def _turns(d: int) -> int:
    return d * (d - 1) // 2


def _hand(hands: Hands, points: FloatArray, d: int) -> FloatArray:
    """Return mass, damping and stiffness matrices, shape (3, p, d, d)."""
    ranges, found = hand_ranges(hands), []
    for kind in range(3):
        low, high = ranges[kind]
        principal = low + (high - low) * points[:, kind * d : (kind + 1) * d]
        begin = 3 * d + kind * _turns(d)
        axes = _rotation(np.pi * (2 * points[:, begin : begin + _turns(d)] - 1))
        found.append(np.einsum("pij,pj,pkj->pik", axes, principal, axes))
    return np.array(found)


def _rotation(vector: FloatArray) -> FloatArray:
    """Return rotations by angles (p, 1) in the plane or vectors (p, 3) in space, Rodrigues' formula."""
    p, turns = vector.shape
    d = 2 if turns == 1 else 3
    angle = np.linalg.norm(vector, axis=1)
    along = vector / np.where(angle > 0, angle, 1.0)[:, None]
    cross = np.zeros((p, d, d))
    if d == 2:
        cross[:, 1, 0], cross[:, 0, 1] = along[:, 0], -along[:, 0]
    else:
        cross[:, 2, 1], cross[:, 0, 2], cross[:, 1, 0] = along.T
        cross = cross - cross.transpose(0, 2, 1)
    sine, cosine = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.asarray(np.eye(d) + sine * cross + (1 - cosine) * cross @ cross)
