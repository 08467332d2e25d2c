"""Whether the coupled loop in space is stable: poses, normals and hands drawn, and searched where the margin is least.

Designs of one axis do not imply it: the device couples the axes (Li, Tavakoli and Huang, IEEE Trans. Control Systems
Technology, 2014). The margin is the factor by which stiffness and damping together may grow until the loop with some
pose, normal and hand is no longer stable. It is what a search finds, no proof.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.arm.contact import Contacts, contact_loops
from avc_casadi.arm.drawn import coordinates, drawn
from avc_casadi.arm.local_search import climb
from avc_casadi.claims.stability.frozen_loop import RADIUS_TOLERANCE
from avc_casadi.model.corners import device_corners

if TYPE_CHECKING:
    from avc_casadi.arm.arm import Arm
    from avc_casadi.arm.design import DirectedGains
    from avc_casadi.model.device import Device

_POINTS, _STARTS, _PASSES = 3000, 6, 2
# Cases whose first contact is unstable later than the worst found so far by more than this are not searched on.
_HOPEFUL = 1.5
# Coordinates of this share of the points stand at an end of the box.
_AT_END = 0.5
_LEAST, _MOST, _HALVINGS = 1 / 16, 16.0, 20
# While the worst is searched, gains are so many times as large as those with which the first contact is unstable: the
# slow motion of a hand that holds, which no gain changes, does not hide what the gains do.
_BEYOND = 1.05


@dataclass(frozen=True)
class WorstContact:
    """The pose, normal and hand with which the loop is the first to be unstable as the gains grow.

    Attributes:
        factor: of stiffness and damping at which it is.
        radius: spectral radius at the gains as they are.
        tip_m: place of the tip, shape (d,).
        contact: the one contact.
        held: by a hand, or let go.
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
    """What the search found.

    Attributes:
        stable: with everything that was looked at, at the gains as they are.
        worst: the first to be unstable as the gains grow.
        radius: largest spectral radius at the gains as they are, of those that were drawn and of the worst.
        looked_at: poses with normals and hands.
    """

    stable: bool
    worst: WorstContact
    radius: float
    looked_at: int


def coupled_certificate(
    arm: Arm, gains: DirectedGains, *, points: int = _POINTS, seed: int = 0, progress: Progress = SILENT
) -> CoupledCertificate:
    """Search for the pose, normal, hand and device with the least margin, held by hands in space and let go.

    Args:
        arm: workspace, device with its ranges, hands.
        gains: of the coupling, any share of which may hold the tangent.
        points: drawn for each corner of the device, held and let go.
        seed: of what is drawn.
        progress: told of the corners.

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
        # A search lowers a factor by some per cent.
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
        held: by a hand, or let go.
        at_end: that share.
    """
    random = np.random.default_rng(seed)
    points = random.random((count, coordinates(arm, held=held)))
    # Places and normals stay where they are: their ends are few of many.
    ends = random.random(points.shape) < at_end
    ends[:, : 2 * len(arm.axes)] = False
    return np.where(ends, np.round(points), points)


def radii(
    arm: Arm, gains: DirectedGains, device: Device, points: FloatArray, *, held: bool
) -> Callable[[float], FloatArray]:
    """Return the spectral radii at points, from the factor of the gains; not numbers where there is no contact.

    Args:
        arm: the arm.
        gains: of the coupling.
        device: a corner of `electronics`.
        points: shape (p, coordinates).
        held: by a hand, or let go.
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
    """Points drawn at one corner of the device, with hands or let go.

    Attributes:
        factor: of the gains at which the first of them is unstable.
        radius: largest of them at the gains as they are.
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
        """Climb from the worst of the points, and again with the gains at which the first found is unstable."""
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
        radius: radii from the factor; not numbers are left out.
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
