"""The stiffest wall that a set of hands can hold at all, exactly: rigid coupling and a contact damper, no friction.

The force K x + D (x - x')/T is held for T; D is the damping of wall and contact damper together. The loop is linear,
and its spectral radius with each hand says whether it dies out. No coupling in series can hold a stiffer wall: it only
softens it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.loop import DEVICE, GROUND, Hand, Plant, StylusHand, hand_corners, transition
from avc_casadi.problem import Hands, whole_delay
from avc_casadi.support import FloatArray, IndexArray
from avc_casadi.trial import STYLUS_RANGES, Population

if TYPE_CHECKING:
    from avc_casadi.problem import Device


_SCAN = 121
_HALVINGS = 40


def corner_subjects(population: Population) -> Hand | StylusHand:
    """Every corner of the ranges of a population: the extreme people."""
    if population == "A":
        return hand_corners(Hands())
    corners = np.array(list(product(*STYLUS_RANGES.values())))
    return StylusHand(**dict(zip(STYLUS_RANGES, corners.T, strict=True)))


def loop_radius(
    device: Device, subjects: Hand | StylusHand, stiffness_n_per_m: FloatArray, damping_ns_per_m: FloatArray
) -> FloatArray:
    """Spectral radius of the frozen loop in contact, shape (walls, people).

    Args:
        device: mass, damping, sample time, delay.
        subjects: the people.
        stiffness_n_per_m: K, shape (walls,).
        damping_ns_per_m: D, shape (walls,).
    """
    plant = Plant()
    plant.add_mass(DEVICE, device.mass_kg)
    plant.join(DEVICE, GROUND, 0.0, device.damping_ns_per_m)
    subjects.mechanics(plant)
    linear = plant.linear()
    moves = transition(linear, device.sample_time_s)
    n, d = linear.states, whole_delay(device.delay_samples, "the stiffest wall of a recommendation")
    rate = damping_ns_per_m / device.sample_time_s
    # States: those of the plant, the position before, and d forces under way, the newest first.
    loop = np.zeros((len(stiffness_n_per_m), len(subjects), n + 1 + d, n + 1 + d))
    loop[:, :, :n, :n] = moves.matrix
    loop[:, :, n, 0] = 1.0
    asked = np.zeros((len(stiffness_n_per_m), n + 1 + d))
    asked[:, 0], asked[:, n] = stiffness_n_per_m + rate, -rate
    if d == 0:
        loop[:, :, :n, :] += asked[:, None, None, :] * moves.force[..., None]
    else:
        loop[:, :, n + 1, :] = asked[:, None, :]
        loop[:, :, np.arange(n + 2, n + 1 + d), np.arange(n + 1, n + d)] = 1.0
        loop[:, :, :n, n + d] += moves.force
    return np.asarray(np.abs(np.linalg.eigvals(loop)).max(axis=-1))


@dataclass(frozen=True)
class DampingRange:
    """Damping of a wall within which every hand is stable.

    Attributes:
        stiffness_n_per_m: K.
        lowest_ns_per_m: smallest D; not a number where no damping will do.
        highest_ns_per_m: largest D.
    """

    stiffness_n_per_m: float
    lowest_ns_per_m: float
    highest_ns_per_m: float


def damping_range(device: Device, subjects: Hand | StylusHand, stiffness_n_per_m: float) -> DampingRange:
    """Find the damping with which a wall is stable with everybody.

    The stable damping of each hand is an interval below 2 m/T of all that moves.
    """
    radius = _radius(device, subjects, stiffness_n_per_m)
    scan, inside = _stable_dampings(radius, _most_damping(device, subjects))
    if len(inside) == 0:
        return DampingRange(stiffness_n_per_m, np.nan, np.nan)
    low = 0.0 if scan[inside[0]] == 0 else _edge(radius, scan[inside[0] - 1], scan[inside[0]])
    last = len(scan) - 1
    high = scan[-1] if inside[-1] == last else _edge(radius, scan[inside[-1] + 1], scan[inside[-1]])
    return DampingRange(stiffness_n_per_m, float(low), float(high))


def _most_damping(device: Device, subjects: Hand | StylusHand) -> float:
    return 2 * (device.mass_kg + float(np.max(subjects.mass_kg))) / device.sample_time_s


def _radius(
    device: Device, subjects: Hand | StylusHand, stiffness_n_per_m: float
) -> Callable[[FloatArray], FloatArray]:
    def radius(damping: FloatArray) -> FloatArray:
        every = loop_radius(device, subjects, np.full(len(damping), stiffness_n_per_m), damping)
        return np.asarray(every.max(axis=1))

    return radius


def _stable_dampings(radius: Callable[[FloatArray], FloatArray], most: float) -> tuple[FloatArray, IndexArray]:
    """Return a scan of dampings and which of them are stable; finer about the least radius where none is."""
    scan = np.linspace(0.0, most, _SCAN)
    found = radius(scan)
    if not (found < 1).any():
        best = int(np.argmin(found))
        scan = np.linspace(scan[max(best - 1, 0)], scan[min(best + 1, _SCAN - 1)], _SCAN)
        found = radius(scan)
    return scan, np.flatnonzero(found < 1)


def _edge(radius: Callable[[FloatArray], FloatArray], outside: float, inside: float) -> float:
    for _ in range(_HALVINGS):
        middle = (outside + inside) / 2
        if radius(np.array([middle]))[0] < 1:
            inside = middle
        else:
            outside = middle
    return inside


def stiffest_wall(device: Device, subjects: Hand | StylusHand) -> DampingRange:
    """Find the stiffest wall that is stable with everybody for some damping, to 0.01 %."""
    most = _most_damping(device, subjects)
    low, high = 1.0, 4 * most / device.sample_time_s
    while high > 1.0001 * low:
        middle = float(np.sqrt(low * high))
        if len(_stable_dampings(_radius(device, subjects, middle), most)[1]):
            low = middle
        else:
            high = middle
    return damping_range(device, subjects, low)
