"""The stiffest wall stable with a set of hands, exactly: rigid coupling and a contact damper, no friction.

The force K x + D (x - x')/T, x the measured position, is held for T; D is the damping of wall and contact damper
together. The device is as declared: delay, amplifier and resonance, at every corner of their ranges. The loop is linear
and judged by its spectral radius with each hand. No coupling in series stabilises a stiffer wall: it only softens it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.arrays import ComplexArray, FloatArray, IndexArray
from avc_casadi.claims.stability.boundary_curves import stable_walls
from avc_casadi.claims.stability.declared_device import closed_loop, plants_with_forces
from avc_casadi.claims.stability.frozen_loop import Rendering
from avc_casadi.model.corners import LINEAR_KEYS, device_corners
from avc_casadi.model.sampled_plant import sampled_plant

if TYPE_CHECKING:
    from avc_casadi.model.device import Device
    from avc_casadi.model.hands import Hand, StylusHand


_SCAN = 121
_HALVINGS = 40
# Up to so many pairs of device and hand all are evaluated every time; of more only those once critical, the others at
# the end.
_FEW = 32
# The initial critical pairs are the worst at each of so many dampings.
_PROBED = 9
# The damping of the stiffest wall is scanned at so many values, then repeatedly at so many about the best.
_COARSE, _FINE, _ZOOMS = 61, 61, 2
# Relative distance of the result below the boundary, so that eigenvalues confirm it.
_BELOW = 5e-5


def loop_radius(
    device: Device, subjects: Hand | StylusHand, stiffness_n_per_m: FloatArray, damping_ns_per_m: FloatArray
) -> FloatArray:
    """Return the spectral radius of the frozen loop in contact at the worst corner of the device, shape (walls, hands).

    Args:
        device: the device as declared.
        subjects: the hands.
        stiffness_n_per_m: K, shape (walls,).
        damping_ns_per_m: D, shape (walls,).
    """
    every = _Loops.of(device, subjects).radius(stiffness_n_per_m, damping_ns_per_m)
    return np.asarray(every.reshape(len(every), -1, len(subjects)).max(axis=1))


def loop_poles(
    device: Device, subjects: Hand | StylusHand, stiffness_n_per_m: float, damping_ns_per_m: float
) -> ComplexArray:
    """Return the poles of the frozen loop with a spring of either sign and a damper, in contact, shape (pairs, poles).

    Args:
        device: the device as declared; its corners are the first axis.
        subjects: the hands.
        stiffness_n_per_m: K, below 0 where it repels the device.
        damping_ns_per_m: D.
    """
    loops = _Loops.of(device, subjects)
    rate = damping_ns_per_m / loops.sample_time_s
    rendering = Rendering(np.array([[stiffness_n_per_m + rate, -rate, 0.0]]), np.zeros((1, 3)))
    loop = closed_loop(loops.matrix, loops.push, loops.measured, rendering)
    return np.asarray(np.linalg.eigvals(loop[0, ..., :-1, :-1]))


@dataclass(frozen=True)
class _Loops:
    """Every corner of a device with every hand.

    Attributes:
        matrix: A with the delayed forces, shape (pairs, s, s); corners first.
        push: B, shape (pairs, s).
        measured: row of the measured position, shape (s,).
        sample_time_s: T.
        most_damping_ns_per_m: upper bound for any wall: 2 m/T of the total moving mass.
        deciding: the critical pairs, evaluated every time.
    """

    matrix: FloatArray
    push: FloatArray
    measured: FloatArray
    sample_time_s: float
    most_damping_ns_per_m: float
    deciding: set[int]

    @classmethod
    def of(cls, device: Device, subjects: Hand | StylusHand) -> _Loops:
        corners = device_corners(device, LINEAR_KEYS)
        matrix, push, measured = plants_with_forces(sampled_plant(corners, subjects))
        mass = max(corner.mass_kg for corner in corners) + float(np.max(subjects.mass_kg))
        most = 2 * mass / device.sample_time_s
        few = set(range(len(matrix))) if len(matrix) <= _FEW else set()
        return cls(matrix, push, measured, device.sample_time_s, most, few)

    def radius(
        self, stiffness_n_per_m: FloatArray, damping_ns_per_m: FloatArray, pairs: IndexArray | None = None
    ) -> FloatArray:
        """Return the spectral radius of walls with all pairs, or some, shape (walls, pairs)."""
        rate = damping_ns_per_m / self.sample_time_s
        force = np.stack([stiffness_n_per_m + rate, -rate, np.zeros_like(rate)], axis=-1)
        rendering = Rendering(force, np.zeros_like(force))
        some = slice(None) if pairs is None else pairs
        loop = closed_loop(self.matrix[some], self.push[some], self.measured, rendering)
        # The rendering has no state of its own here.
        return np.asarray(np.abs(np.linalg.eigvals(loop[..., :-1, :-1])).max(axis=-1))

    def worst(self, stiffness_n_per_m: float) -> Callable[[FloatArray], FloatArray]:
        """Return the spectral radius of a wall as a function of its damping, with the worst critical pair."""

        def radius(damping: FloatArray) -> FloatArray:
            stiffness = np.full(len(damping), stiffness_n_per_m)
            return np.asarray(self.radius(stiffness, damping, np.array(sorted(self.deciding))).max(axis=1))

        return radius

    def confirmed(self, stiffness_n_per_m: float, damping_ns_per_m: FloatArray) -> bool:
        """Return whether a wall is stable with all pairs; where it is not, the worst become critical."""
        if len(self.deciding) == len(self.matrix):
            return True
        every = self.radius(np.full(len(damping_ns_per_m), stiffness_n_per_m), damping_ns_per_m)
        found = {int(pair) for row in every if row.max() >= 1 for pair in (np.argmax(row),)} - self.deciding
        self.deciding.update(found)
        return not found

    def start(self, stiffness_n_per_m: float) -> None:
        """Take the worst pairs at a scan of dampings as critical."""
        if not self.deciding:
            damping = np.linspace(0.0, self.most_damping_ns_per_m, _PROBED)
            every = self.radius(np.full(len(damping), stiffness_n_per_m), damping)
            self.deciding.update(int(pair) for pair in np.argmax(every, axis=1))


@dataclass(frozen=True)
class DampingRange:
    """Damping of a wall within which every hand is stable.

    Attributes:
        stiffness_n_per_m: K.
        lowest_ns_per_m: smallest D; not a number where no damping suffices.
        highest_ns_per_m: largest D.
    """

    stiffness_n_per_m: float
    lowest_ns_per_m: float
    highest_ns_per_m: float


def damping_range(device: Device, subjects: Hand | StylusHand, stiffness_n_per_m: float) -> DampingRange:
    """Return the damping with which a wall is stable with every hand at every corner of the device.

    The stable damping of each hand is an interval below 2 m/T of the total moving mass.
    """
    return _damping_range(_Loops.of(device, subjects), stiffness_n_per_m)


def _damping_range(loops: _Loops, stiffness_n_per_m: float, known_ns_per_m: float | None = None) -> DampingRange:
    radius = loops.worst(stiffness_n_per_m)
    while True:
        scan, inside = _stable_dampings(loops, stiffness_n_per_m, known_ns_per_m)
        if len(inside) == 0:
            return DampingRange(stiffness_n_per_m, np.nan, np.nan)
        low = 0.0 if scan[inside[0]] == 0 else _edge(radius, scan[inside[0] - 1], scan[inside[0]])
        last = len(scan) - 1
        high = scan[-1] if inside[-1] == last else _edge(radius, scan[inside[-1] + 1], scan[inside[-1]])
        if loops.confirmed(stiffness_n_per_m, np.array([low, high])):
            return DampingRange(stiffness_n_per_m, float(low), float(high))


def _stable_dampings(
    loops: _Loops, stiffness_n_per_m: float, known_ns_per_m: float | None
) -> tuple[FloatArray, IndexArray]:
    """Return a scan of dampings and which of them are stable; finer about the least radius where none is.

    The scan is short where one stable damping is known.
    """
    most = loops.most_damping_ns_per_m
    first = np.linspace(0.0, most, _SCAN) if known_ns_per_m is None else np.array([0.0, known_ns_per_m, most])
    loops.start(stiffness_n_per_m)
    radius = loops.worst(stiffness_n_per_m)
    while True:
        scan, found = first, radius(first)
        if not (found < 1).any():
            scan = _about(scan, int(np.argmin(found)))
            found = radius(scan)
        inside = np.flatnonzero(found < 1)
        if len(inside) == 0 or loops.confirmed(stiffness_n_per_m, scan[inside[[0, -1]]]):
            return scan, inside


def _about(scan: FloatArray, best: int) -> FloatArray:
    """Return a finer scan between the neighbours of the best."""
    return np.linspace(scan[max(best - 1, 0)], scan[min(best + 1, len(scan) - 1)], _SCAN)


def _edge(radius: Callable[[FloatArray], FloatArray], outside: float, inside: float) -> float:
    for _ in range(_HALVINGS):
        middle = (outside + inside) / 2
        if radius(np.array([middle]))[0] < 1:
            inside = middle
        else:
            outside = middle
    return inside


def softest_wall_n_per_m(device: Device) -> float:
    """Return 1 N/m at the hand, the softest wall of a search."""
    return device.metres_per_unit**2


def stiffest_wall(device: Device, subjects: Hand | StylusHand) -> DampingRange:
    """Return the stiffest wall that is stable with every hand for some damping, to 0.01 %.

    For each damping the boundary curves give the largest stable stiffness. It is 0, and the damping not a number,
    without any mass, or where no damping stabilises 1 N/m at the hand.
    """
    none = DampingRange(0.0, np.nan, np.nan)
    if device.mass_kg + float(np.min(subjects.mass_kg)) == 0:
        return none
    loops, corners = _Loops.of(device, subjects), device_corners(device, LINEAR_KEYS)
    damping, stiffest, best = np.linspace(0.0, loops.most_damping_ns_per_m, _COARSE), 0.0, 0
    for _ in range(1 + _ZOOMS):
        largest = np.nan_to_num(stable_walls(corners, subjects, damping).first_n_per_m)
        best = int(np.argmax(largest))
        stiffest, known = float(largest[best]), float(damping[best])
        damping = np.linspace(damping[max(best - 1, 0)], damping[min(best + 1, len(damping) - 1)], _FINE)
    stiffest *= 1 - _BELOW
    return none if stiffest < softest_wall_n_per_m(device) else _damping_range(loops, stiffest, known)
