"""The worst point of a box of ranges: the spectral radius has maxima inside it, which corners and draws miss.

A search, not a proof: corners, lines along the sides through the worst of them, then ascent on local quadratic models.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from itertools import combinations, product
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._util.arrays import ComplexArray, FloatArray, IndexArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi.loops.loop import Body
from avc_casadi.loops.spectrum import largest_eigenvalue
from avc_casadi.loops.wall import LinearStability, fraction_rendering, linear_stability, plants_of, wall
from avc_casadi.model.corners import LINEAR_KEYS, device_ranges, devices_with
from avc_casadi.model.hands import Hand, hand_ranges, hand_set
from avc_casadi.model.plant import sampled_plant

if TYPE_CHECKING:
    from avc_casadi.loops.sampled_loop import Fractions, Values
    from avc_casadi.model.device import Device
    from avc_casadi.model.plant import SampledPlant
    from avc_casadi.model.problem import Hands, Problem

Leading = Callable[[IndexArray, FloatArray], ComplexArray]
"""The eigenvalue of largest modulus of each of m loops, by row (m,) and place in the unit box (sides, m)."""

_ROUNDS, _SWEEPS = 12, 15
# An ascent ends below this gain, step or reach, steps and reach as shares of the box.
_GAINED, _STILL, _SHORTEST = 1e-10, 1e-4, 3e-3
_REACH, _SHRINK = 0.2, 0.45
# Boxes of more sides have drawn corners. Points drawn inside for each side, starts of lines and of ascents, points of a
# line, how far starts lie apart: maxima near a resonance of tool, contact or device are narrow.
_MOST_SIDES, _DRAWN, _LINES, _ASCENTS, _POINTS, _APART = 6, 40, 6, 5, 15, 0.25
# Initial hands of a row of gains, and how far they lie apart.
_HANDS, _HANDS_APART, _NUMBERS_AT_ONCE = 4, 0.6, 2_000_000
# A range that spans more than this factor is searched by its logarithm.
_WIDE = 3.0

Interval = tuple[float, float]
Ranges = dict[str, Interval]
"""[lowest, highest] by name."""

_HAND = tuple(f"hand.{item.name}" for item in fields(Hand))


@dataclass(frozen=True)
class Box:
    """Ranges as a unit box; a range of one value is no side of it."""

    ranges: Ranges

    @property
    def sides(self) -> tuple[str, ...]:
        """Names of the ranges of more than one value."""
        return tuple(name for name, (low, high) in self.ranges.items() if high > low)

    def values(self, places: FloatArray) -> dict[str, FloatArray]:
        """Return the values at places (sides, m), each of shape (m,)."""
        shares = dict(zip(self.sides, places, strict=True))
        found = {}
        for name, (low, high) in self.ranges.items():
            share = shares.get(name)
            if share is None:
                found[name] = np.full(places.shape[1], low)
                continue
            wide = low > 0 and high > _WIDE * low
            inside = low * (high / low) ** share if wide else low + (high - low) * share
            found[name] = np.clip(inside, low, high)
        return found


def worst_point(leading: Leading, sides: int) -> tuple[FloatArray, complex]:
    """Return the place (sides,) of a unit box with the largest modulus, and the eigenvalue there."""
    drawn = np.random.default_rng(1).random((sides, _DRAWN * sides))
    places = np.concatenate([_corners(sides), drawn], axis=1)
    values = leading(np.zeros(places.shape[1], dtype=np.intp), places)
    if not sides:
        return places[:, 0], complex(values[0])
    for _ in range(2):
        lines = np.concatenate([_lines(places[:, at]) for at in _far_apart(np.abs(values), places, _LINES)], axis=1)
        places = np.concatenate([places, lines], axis=1)
        values = np.concatenate([values, leading(np.zeros(lines.shape[1], dtype=np.intp), lines)])
    starts = _far_apart(np.abs(values), places, _ASCENTS)
    tops, ends = ascend(leading, np.zeros(len(starts), dtype=np.intp), places[:, starts])
    best = int(np.abs(ends).argmax())
    return tops[:, best], complex(ends[best])


def hand_boxes(problem: Problem) -> list[Ranges]:
    """Return the ranges of a hand by key, such as ``hand.mass_kg``, and those of none where the device has a mass."""
    low, high = hand_ranges(problem.hands).T.tolist()
    held = dict(zip(_HAND, zip(low, high, strict=True), strict=True))
    return [held, dict.fromkeys(_HAND, (0.0, 0.0))] if problem.device.mass_kg else [held]


def hand_at(values: Mapping[str, FloatArray], place: int) -> dict[str, float]:
    """Return one of m hands by name, from values as of `Box.values`."""
    return {key.removeprefix("hand."): float(values[key][place]) for key in _HAND}


def held_plant(device: Device, values: Mapping[str, FloatArray]) -> tuple[list[Device], SampledPlant]:
    """Return m devices of the declared ranges, each in its own hand, from values as of `Box.values`."""
    hands = [values[key] for key in _HAND]
    ranges = device_ranges(device, LINEAR_KEYS)
    if not ranges:
        return [device] * len(hands[0]), sampled_plant(device, Hand(*hands))
    devices = devices_with(device, {key: values[key] for key in ranges})
    return devices, sampled_plant(devices, [Hand(*row) for row in np.array(hands).T.tolist()])


def worst_held(
    device: Device,
    hand: Ranges,
    leading: Callable[[SampledPlant, Mapping[str, FloatArray]], ComplexArray],
    **more: Interval,
) -> tuple[complex, dict[str, float], Device, dict[str, FloatArray]]:
    """Return the largest eigenvalue over a hand's and a device's ranges: its hand, its device and all its values."""
    box = Box({**hand, **device_ranges(device, LINEAR_KEYS), **more})

    def of_places(_: IndexArray, places: FloatArray) -> ComplexArray:
        values = box.values(places)
        return leading(held_plant(device, values)[1], values)

    place, value = worst_point(of_places, len(box.sides))
    found = box.values(place[:, None])
    return value, hand_at(found, 0), held_plant(device, found)[0][0], found


def _corners(sides: int) -> FloatArray:
    if sides <= _MOST_SIDES:
        return np.array(list(product((0.0, 1.0), repeat=sides))).reshape(2**sides, sides).T
    return np.random.default_rng(0).integers(0, 2, (sides, 2**_MOST_SIDES)).astype(np.float64)


def _lines(place: FloatArray) -> FloatArray:
    """Return points along each side of the box through a place (sides,)."""
    lines = np.repeat(place[:, None], len(place) * _POINTS, axis=1)
    for side in range(len(place)):
        lines[side, side * _POINTS : (side + 1) * _POINTS] = np.linspace(0.0, 1.0, _POINTS)
    return lines


def _far_apart(values: FloatArray, places: FloatArray, count: int) -> list[int]:
    """Return where the largest values are that lie apart, the largest first."""
    chosen: list[int] = []
    left = np.where(np.isnan(values), -np.inf, values)
    while len(chosen) < count and np.isfinite(left).any():
        worst = int(left.argmax())
        chosen.append(worst)
        left = np.where(np.abs(places - places[:, [worst]]).max(axis=0) < _APART, -np.inf, left)
    return chosen or [0]


def ascend(leading: Leading, rows: IndexArray, places: FloatArray) -> tuple[FloatArray, ComplexArray]:
    """Ascend the modulus of each row from its place (sides, m); return the last places and their eigenvalues."""
    at, reach = places.copy(), np.full(len(rows), _REACH)
    top = leading(rows, at)
    going = np.arange(len(rows))
    for _ in range(_ROUNDS):
        here, near, best = at[:, going], reach[going], top[going]
        probes = np.clip(here + _moves(here, near), 0.0, 1.0)
        values = _at(leading, rows[going], probes)
        ends = -np.minimum(here, 2 * near), np.minimum(1 - here, 2 * near)
        guess = here + _model_top(probes - here, np.abs(values) - np.abs(best), *ends)
        value = _at(leading, rows[going], guess[None])
        probes = np.concatenate([here[None], probes, guess[None]])
        values = np.concatenate([best[None], values, value])
        chosen, pick = np.abs(values).argmax(axis=0), np.arange(len(going))
        at[:, going], top[going] = probes[chosen, :, pick].T, values[chosen, pick]
        moved = np.abs(at[:, going] - here).max(axis=0)
        reach[going] = np.where(moved < near, near * _SHRINK, near)
        gained = (np.abs(top[going]) > np.abs(best) + _GAINED) & (moved > _STILL)
        going = going[gained | (reach[going] > _SHORTEST)]
        if not going.size:
            break
    return at, top


def _at(leading: Leading, rows: IndexArray, places: FloatArray) -> ComplexArray:
    """Return the eigenvalues at p places for each row, (p, sides, m), as (p, m)."""
    flat = places.transpose(1, 0, 2).reshape(places.shape[1], -1)
    return leading(np.tile(rows, len(places)), flat).reshape(-1, len(rows))


def _moves(at: FloatArray, reach: FloatArray) -> FloatArray:
    """Return probes both ways along each side of the box, then inwards along two sides at once, (p, sides, m)."""
    sides = len(at)
    inner = np.where(at <= 0.5, reach, -reach)
    moves = [move for i in range(sides) for move in (_only(inner, i), _only(-inner, i))]
    return np.array([*moves, *(_only(inner, i) + _only(inner, j) for i, j in combinations(range(sides), 2))])


def _only(move: FloatArray, side: int) -> FloatArray:
    one = np.zeros_like(move)
    one[side] = move[side]
    return one


def _model_top(moves: FloatArray, gains: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Return the step (sides, m) to the maximum of the quadratic through the probes, between two bounds."""
    sides, m = moves.shape[1:]
    slope, bend = np.zeros((sides, m)), np.zeros((sides, sides, m))
    for i in range(sides):
        d, e = moves[2 * i, i], moves[2 * i + 1, i]
        with np.errstate(divide="ignore", invalid="ignore"):
            one, other = gains[2 * i] / d, gains[2 * i + 1] / e
            both = (d != 0) & (e != 0)
            bend[i, i] = np.where(both, 2 * (one - other) / (d - e), 0.0)
            slope[i] = np.where(both, one - 0.5 * bend[i, i] * d, np.where(d != 0, one, 0.0))
    for number, (i, j) in enumerate(combinations(range(sides), 2)):
        d, e = moves[2 * i, i], moves[2 * j, j]
        cross = gains[2 * sides + number] - gains[2 * i] - gains[2 * j]
        with np.errstate(divide="ignore", invalid="ignore"):
            bend[i, j] = bend[j, i] = np.where((d != 0) & (e != 0), cross / (d * e), 0.0)
    slope, bend = (np.where(np.isfinite(values), values, 0.0) for values in (slope, bend))
    step = np.zeros((sides, m))
    for _ in range(_SWEEPS):
        for i in range(sides):
            rise = slope[i] + (bend[i] * step).sum(axis=0) - bend[i, i] * step[i]
            curved = bend[i, i] < 0
            top = np.where(curved, -rise / np.where(curved, bend[i, i], 1.0), np.where(rise > 0, np.inf, -np.inf))
            step[i] = np.clip(np.where(~curved & (rise == 0), 0.0, top), low[i], high[i])
    return step


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
        options: dict[str, Any] = {"draws": draws, "seed": seed, "enough": enough, "progress": progress}
        each = worst_hands(device, parts.pick(one), contact[one], hands, **options)
        return each.pick(same.ravel())
    first = hand_set(hands, draws=draws, seed=seed)
    known = linear_stability(device, parts, contact_damping_ns_per_m, first, progress)
    low, width = hand_ranges(hands)[:, :1], np.ptp(hand_ranges(hands), axis=1)[:, None]
    at = np.array([np.broadcast_to(value, (len(first),)) for value in vars(first).values()])
    # The released device lies outside the ranges and is no initial guess.
    inside = ((at >= low) & (at <= hand_ranges(hands)[:, 1:])).all(axis=0)
    shares = (at - low) / np.where(width > 0, width, 1.0)
    order = _worst_apart(np.where(inside, known.radius, -np.inf), shares)
    best = np.arange(len(parts.direct)), known.radius.argmax(axis=1)
    radius, frequency, place = known.radius[best], known.frequency_hz[best], at[:, best[1]]

    def leading(rows: IndexArray, shares: FloatArray) -> ComplexArray:
        body = Body.of(plants_of([device], Hand(*(low + width * shares)))).flat()
        return largest_eigenvalue(wall(body, rendering.pick(rows)))

    going = np.flatnonzero(np.isfinite(radius) & (radius < enough) & width.any())
    starts = order.shape[1]
    at_once = max(1, _NUMBERS_AT_ONCE // (9 * starts * (4 + math.ceil(device.delay_samples)) ** 2))
    for begin in range(0, len(going), at_once):
        rows = going[begin : begin + at_once]
        begins = np.clip(shares[:, order[rows].ravel()], 0.0, 1.0)
        ends, values = ascend(leading, np.repeat(rows, starts), begins)
        winner = np.abs(values).reshape(-1, starts).argmax(axis=1) + np.arange(len(rows)) * starts
        better = np.abs(values[winner]) > radius[rows]
        rows, winner = rows[better], winner[better]
        radius[rows], place[:, rows] = np.abs(values[winner]), low + width * ends[:, winner]
        frequency[rows] = np.abs(np.angle(values[winner])) / (2 * math.pi * device.sample_time_s)
    return WorstHands(radius, frequency, Hand(*place), known)


def _worst_apart(radius: FloatArray, places: FloatArray) -> IndexArray:
    """Return the worst hands of each row that lie apart, worst first; places (3, h) as shares of the box."""
    distance = np.abs(places[:, :, None] - places[:, None, :]).max(axis=0)
    left = radius.copy()
    chosen = []
    for _ in range(min(_HANDS, radius.shape[1])):
        worst = left.argmax(axis=1)
        chosen.append(worst)
        left = np.where(distance[worst] < _HANDS_APART, -np.inf, left)
    return np.stack(chosen, axis=1)
