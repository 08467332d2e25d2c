"""The worst hand of a whole box of hands: the spectral radius has maxima inside, which corners and draws miss.

A search, not a proof: ascent on local quadratic models from the worst of some hands, all rows at once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.arrays import ComplexArray, FloatArray, IndexArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.loops.loop import Body
from avc_casadi.loops.ranges import ascend
from avc_casadi.loops.spectrum import largest_eigenvalue
from avc_casadi.loops.wall import LinearStability, Rendering, fraction_rendering, linear_stability, plants_of, wall
from avc_casadi.model.hands import Hand, hand_ranges, hand_set

if TYPE_CHECKING:
    from avc_casadi.loops.sampled_loop import Fractions, Values
    from avc_casadi.model.device import Device
    from avc_casadi.model.problem import Hands

_STARTS, _APART = 4, 0.6
_NUMBERS_AT_ONCE = 2_000_000


@dataclass(frozen=True)
class WorstHands:
    """The worst hand that was found for each of n rows."""

    radius: FloatArray
    frequency_hz: FloatArray
    hands: Hand
    known: LinearStability

    def pick(self, rows: IndexArray) -> WorstHands:
        """Return some of the rows."""
        known = LinearStability(self.known.radius[rows], self.known.frequency_hz[rows])
        return WorstHands(self.radius[rows], self.frequency_hz[rows], self.hands.pick(rows), known)


def worst_hands(
    device: Device,
    parts: Fractions,
    contact_damping_ns_per_m: Values,
    hands: Hands,
    *,
    draws: int = 24,
    seed: int = 0,
    enough: float = np.inf,
    progress: Progress = SILENT,
) -> WorstHands:
    """Search the ranges for the hand with which each frozen row has the largest spectral radius."""
    contact = np.broadcast_to(np.asarray(contact_damping_ns_per_m, dtype=np.float64), (len(parts.direct),))
    rendering = fraction_rendering(parts, contact, device.sample_time_s)
    _, one, same = np.unique(
        np.concatenate([rendering.force, rendering.state], axis=1), axis=0, return_index=True, return_inverse=True
    )
    if len(one) < len(same):
        each = worst_hands(
            device,
            parts.pick(one),
            contact[one],
            hands,
            draws=draws,
            seed=seed,
            enough=enough,
            progress=progress,
        )
        return each.pick(same.ravel())
    first = hand_set(hands, draws=draws, seed=seed)
    known = linear_stability(device, parts, contact_damping_ns_per_m, first, progress)
    n = len(parts.direct)
    ranges = hand_ranges(hands)
    at = np.array([np.broadcast_to(value, (len(first),)) for value in vars(first).values()])
    # The released device lies outside the ranges and is no initial guess.
    inside = ((at >= ranges[:, :1]) & (at <= ranges[:, 1:])).all(axis=0)
    shares = (at - ranges[:, :1]) / np.maximum(np.ptp(ranges, axis=1)[:, None], np.finfo(np.float64).tiny)
    order = _far_apart(np.where(inside, known.radius, -np.inf), shares)
    best = known.radius.argmax(axis=1)
    radius = np.take_along_axis(known.radius, best[:, None], axis=1)[:, 0]
    frequency = np.take_along_axis(known.frequency_hz, best[:, None], axis=1)[:, 0]
    place = at[:, best] if n else np.zeros((3, 0))
    wide = (ranges[:, 1] > ranges[:, 0]).any()
    going = np.flatnonzero(np.isfinite(radius) & (radius < enough)) if wide else np.zeros(0, dtype=np.intp)
    if going.size:
        search = _Search(device, rendering, ranges)
        rows = np.repeat(going, order.shape[1])
        found, top, where = search.climb(rows, at[:, order[going].ravel()])
        winner = top.reshape(len(going), -1).argmax(axis=1) + np.arange(len(going)) * order.shape[1]
        better = top[winner] > radius[going]
        better_rows, winner = going[better], winner[better]
        radius[better_rows], frequency[better_rows] = top[winner], where[winner]
        place = place.copy()
        place[:, better_rows] = found[:, winner]
    return WorstHands(radius, frequency, Hand(*place), known)


def _far_apart(radius: FloatArray, places: FloatArray) -> IndexArray:
    """Return the worst hands of each row that lie apart, worst first; places (3, h) as shares of the box."""
    distance = np.abs(places[:, :, None] - places[:, None, :]).max(axis=0)
    left = radius.copy()
    chosen = []
    for _ in range(min(_STARTS, radius.shape[1])):
        worst = left.argmax(axis=1)
        chosen.append(worst)
        left = np.where(distance[worst] < _APART, -np.inf, left)
    return np.stack(chosen, axis=1)


@dataclass(frozen=True)
class _Search:
    device: Device
    rendering: Rendering
    ranges: FloatArray

    def leading(self, rows: IndexArray, shares: FloatArray) -> ComplexArray:
        """Return the largest eigenvalue of rows (m,), each with its own hand, (3, m) in shares of the ranges."""
        low, width = self.ranges[:, :1], np.ptp(self.ranges, axis=1)[:, None]
        hands = Hand(*(low + width * shares))
        body = Body.of(plants_of([self.device], hands)).flat()
        return largest_eigenvalue(wall(body, self.rendering.pick(rows)))

    def climb(self, rows: IndexArray, places: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Ascend from initial guesses (3, m) in the box; return the final iterates, radii and frequencies."""
        low, width = self.ranges[:, :1], np.ptp(self.ranges, axis=1)[:, None]
        shares = np.clip((places - low) / np.where(width > 0, width, 1.0), 0.0, 1.0)
        size = 4 + math.ceil(self.device.delay_samples)
        at_once = max(1, _NUMBERS_AT_ONCE // (9 * size * size))
        parts = [
            ascend(self.leading, rows[begin : begin + at_once], shares[:, begin : begin + at_once])
            for begin in range(0, len(rows), at_once)
        ]
        top = np.concatenate([part[1] for part in parts])
        frequency = np.abs(np.angle(top)) / (2 * math.pi * self.device.sample_time_s)
        return low + width * np.concatenate([part[0] for part in parts], axis=1), np.abs(top), frequency
