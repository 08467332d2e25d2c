"""Stability of periodic loops: spectral radius and least damped mode of many monodromy matrices."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from fractions import Fraction
from functools import partial
from itertools import combinations, product
from typing import Any

import numpy as np

from avc_casadi._util.arrays import ComplexArray, FloatArray, IndexArray
from avc_casadi.loops.spectrum import ClosedLoops, leading_radii, moving_poles
from avc_casadi.model.corners import LINEAR_KEYS, device_ranges, devices_with
from avc_casadi.model.device import Device
from avc_casadi.model.ends import ToolGains
from avc_casadi.model.hands import Hand, hand_ranges
from avc_casadi.model.plant import SampledPlant, sampled_plant
from avc_casadi.model.problem import Problem

Leading = Callable[[IndexArray, FloatArray], ComplexArray]
"""The leading eigenvalue of each of m loops, by row (m,) and place in the unit box (sides, m)."""

Ranges = dict[str, tuple[float, float]]
"""[lowest, highest] by name."""

KNOT_DRAWS, SCREENED_DRAWS = 2, 1
"""Corners of the other sides that are drawn at each knot of a side of many cells: in a search, and before it."""
SEARCHED_OF_A_KIND = 3
"""Regions that differ in their clocks alone and are searched; the others grow more slowly at corners and knots."""

_HAND = tuple(f"hand.{item.name}" for item in fields(Hand))


@dataclass(frozen=True)
class Box:
    """Ranges as a box; a range of one value is no side of it.

    A side is one cell, from 0 to 1, or has as many as its range has `knots`, less one: a loop that changes often over a
    range is searched in each cell. Between two knots, all above 0, the value is that of its logarithm.
    """

    ranges: Ranges
    knots: Mapping[str, FloatArray] = field(default_factory=dict)

    @property
    def sides(self) -> tuple[str, ...]:
        """Names of the ranges of more than one value."""
        return tuple(name for name, (low, high) in self.ranges.items() if high > low)

    @property
    def cells(self) -> tuple[int, ...]:
        """Length of each side in cells."""
        return tuple(max(len(self.knots.get(name, ())) - 1, 1) for name in self.sides)

    def values(self, places: FloatArray) -> dict[str, FloatArray]:
        """Return the values at places (sides, m), each of shape (m,)."""
        shares = dict(zip(self.sides, places, strict=True))
        values = {}
        for name, (low, high) in self.ranges.items():
            share = shares.get(name)
            if share is None:
                values[name] = np.full(places.shape[1], low)
                continue
            knots = self.knots.get(name)
            if knots is not None:
                inside = np.exp(np.interp(share, np.arange(len(knots)), np.log(knots)))
                values[name] = np.clip(inside, low, high)
                continue
            # A range that spans more than this factor is searched by its logarithm.
            wide = low > 0 and high > 3 * low
            inside = low * (high / low) ** share if wide else low + (high - low) * share
            values[name] = np.clip(inside, low, high)
        return values


def corners_and_knots(cells: Sequence[int], draws: int) -> FloatArray:
    """Return corners (sides, m) of a box, at most 64, and each knot, with drawn corners of the other sides."""
    sides, top = len(cells), np.array(cells, dtype=np.float64)[:, None]
    corners = np.random.default_rng(0).integers(0, 2, (sides, 64)).astype(np.float64)
    if sides <= 6:
        corners = np.array(list(product((0.0, 1.0), repeat=sides))).reshape(2**sides, sides).T
    places = [top * corners]
    for side, count in enumerate(cells):
        if count > 1:
            drawn = top * np.random.default_rng(side).integers(0, 2, (sides, draws * (count + 1)))
            drawn[side] = np.tile(np.arange(count + 1.0), draws)
            places.append(drawn)
    return np.concatenate(places, axis=1)


def _everywhere(cells: Sequence[int]) -> FloatArray:
    """Return places (sides, m) all over a box: corners, knots, edges of one cell, points inside."""
    sides, top = len(cells), np.array(cells, dtype=np.float64)[:, None]
    places = corners_and_knots(cells, KNOT_DRAWS)
    corners = places[:, : 2 ** min(sides, 6)]
    inner = [
        np.insert(np.delete(corners, side, 0), side, share, 0)
        for side, count in enumerate(cells)
        for share in (0.25, 0.5, 0.75)
        if count == 1
    ]
    sample = np.random.default_rng(1).random((sides, 40 * sides)) * top
    return np.concatenate([places, *inner, sample], axis=1)


def worst_point(
    leading: Callable[[FloatArray], ComplexArray], sides: int, cells: Sequence[int] = ()
) -> tuple[FloatArray, ComplexArray]:
    """Return the places (sides, kinds) of a box where each kind of eigenvalue has its largest modulus, and it.

    The box is the unit box, or has sides of as many cells as are given, with about one maximum in each.
    """
    # Many points, edges, lines and ascents: maxima near a resonance of tool, contact or device are narrow.
    cells = cells or (1,) * sides
    top = np.array(cells, dtype=np.float64)[:, None]
    places = _everywhere(cells)
    values = np.atleast_2d(leading(places))
    kinds = np.arange(len(values))
    if not sides:
        return places[:, 0 * kinds], values[:, 0]
    # Neighbouring knots may belong to one maximum; within a cell a quarter of it lies apart.
    apart = np.where(top > 1, 6.0, 1.0)
    for _ in range(2):
        far = dict.fromkeys(at for one in values for at in _far_apart(np.abs(one), places / apart, 6))
        lines = np.concatenate([_lines(places[:, at], top[:, 0]) for at in far], axis=1)
        places = np.concatenate([places, lines], axis=1)
        values = np.concatenate([values, np.atleast_2d(leading(lines))], axis=1)
    starts = [_far_apart(np.abs(one), places / apart, 5 if top.max() == 1 else 8) for one in values]
    rows = np.repeat(kinds, [len(one) for one in starts])
    tops, ends = ascend(
        lambda rows, at: np.atleast_2d(leading(at))[rows, np.arange(len(rows))],
        rows,
        places[:, np.concatenate(starts)],
        top,
    )
    best = [int(np.where(rows == kind, np.abs(ends), -1.0).argmax()) for kind in kinds]
    return tops[:, best], ends[best]


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


def worst_case(
    device: Device,
    hand: Ranges,
    leading: Callable[[SampledPlant, Mapping[str, FloatArray]], ComplexArray],
    **more: tuple[float, float],
) -> tuple[complex, dict[str, float], Device, dict[str, FloatArray]]:
    """Return the largest eigenvalue over a hand's and a device's ranges: its hand, its device and all its values."""
    box = Box({**hand, **device_ranges(device, LINEAR_KEYS), **more})

    def of_places(places: FloatArray) -> ComplexArray:
        values = box.values(places)
        return leading(held_plant(device, values)[1], values)

    place, value = worst_point(of_places, len(box.sides))
    values = box.values(place)
    return complex(value[0]), hand_at(values, 0), held_plant(device, values)[0][0], values


def _lines(place: FloatArray, top: FloatArray) -> FloatArray:
    """Return points along each side of the box through a place (sides,); along many cells, those about the place."""
    lines = np.repeat(place[:, None], len(place) * 15, axis=1)
    for side, length in enumerate(top):
        middle = np.clip(place[side], 1.5, length - 1.5) if length > 3 else length / 2
        reach = min(length / 2, 1.5)
        lines[side, side * 15 : (side + 1) * 15] = np.linspace(middle - reach, middle + reach, 15)
    return lines


def _far_apart(values: FloatArray, places: FloatArray, count: int) -> list[int]:
    """Return where the largest values are that lie apart, the largest first."""
    chosen: list[int] = []
    left = np.where(np.isnan(values), -np.inf, values)
    while len(chosen) < count and np.isfinite(left).any():
        worst = int(left.argmax())
        chosen.append(worst)
        left = np.where(np.abs(places - places[:, [worst]]).max(axis=0) < 0.25, -np.inf, left)
    return chosen or [0]


def ascend(
    leading: Leading, rows: IndexArray, places: FloatArray, high: FloatArray | float = 1.0
) -> tuple[FloatArray, ComplexArray]:
    """Ascend the modulus of each row from its place (sides, m); return the last places and their eigenvalues.

    The box reaches from 0 to `high` along each side (sides, 1).
    """
    at, reach = places.copy(), np.full(len(rows), 0.2)
    top = leading(rows, at)
    going = np.arange(len(rows))
    for _ in range(12):
        here, near, best = at[:, going], reach[going], top[going]
        probes = np.clip(here + _moves(here, near, high), 0.0, high)
        values = _at(leading, rows[going], probes)
        ends = -np.minimum(here, 2 * near), np.minimum(high - here, 2 * near)
        guess = here + _model_top(probes - here, np.abs(values) - np.abs(best), *ends)
        value = _at(leading, rows[going], guess[None])
        probes = np.concatenate([here[None], probes, guess[None]])
        values = np.concatenate([best[None], values, value])
        chosen, pick = np.abs(values).argmax(axis=0), np.arange(len(going))
        at[:, going], top[going] = probes[chosen, :, pick].T, values[chosen, pick]
        moved = np.abs(at[:, going] - here).max(axis=0)
        reach[going] = np.where(moved < near, near * 0.45, near)
        # An ascent ends below a gain, a step and a reach, the last two as shares of a cell.
        gained = (np.abs(top[going]) > np.abs(best) + 1e-10) & (moved > 1e-4)
        going = going[gained | (reach[going] > 3e-3)]
        if not going.size:
            break
    return at, top


def _at(leading: Leading, rows: IndexArray, places: FloatArray) -> ComplexArray:
    """Return the eigenvalues at p places for each row, (p, sides, m), as (p, m)."""
    flat = places.transpose(1, 0, 2).reshape(places.shape[1], -1)
    return leading(np.tile(rows, len(places)), flat).reshape(-1, len(rows))


def _moves(at: FloatArray, reach: FloatArray, high: FloatArray | float) -> FloatArray:
    """Return probes both ways along each side of the box, then inwards along two sides at once, (p, sides, m)."""
    sides = len(at)
    inner = np.where(at <= 0.5 * high, reach, -reach)
    along = np.eye(sides)[:, :, None] * inner
    both = [along[i] + along[j] for i, j in combinations(range(sides), 2)]
    return np.array([*(move for one in along for move in (one, -one)), *both])


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
    for _ in range(15):
        for i in range(sides):
            rise = slope[i] + (bend[i] * step).sum(axis=0) - bend[i, i] * step[i]
            curved = bend[i, i] < 0
            top = np.where(curved, -rise / np.where(curved, bend[i, i], 1.0), np.where(rise > 0, np.inf, -np.inf))
            step[i] = np.clip(np.where(~curved & (rise == 0), 0.0, top), low[i], high[i])
    return step


# Eigenvalues of these matrices are right to about 1e-12; slower decay than this is indistinguishable from none.
TOLERANCE = 1e-9
# Eigenvalues this small are deadbeat.
_DEAD = 1e-6
# Growth of loops with different patterns is compared over this time.
UNIT_S = 1e-3


def clock_ratio(ratio: float) -> Fraction:
    """Return a ratio of two clocks as a fraction whose pattern recurs soon: 1/60 s recurs after three of 50 ms."""
    return Fraction(ratio).limit_denominator(8) or Fraction(1, 8)


@dataclass(frozen=True)
class Pattern:
    """Loops of one pattern of samples over a period, and what each is; a radius is stated by the tick."""

    loops: Callable[[ToolGains], ClosedLoops]
    period_s: float
    ticks: int
    case: Callable[[int], Any]

    def closed(self, gains: ToolGains) -> ClosedLoops:
        """Return the loops, with one leading axis."""
        loops = self.loops(gains)
        return ClosedLoops(loops.maps.reshape(-1, *loops.maps.shape[-2:]), loops.rests)


@dataclass(frozen=True)
class Region:
    """Ranges that are searched, and the loops at m of their points, from values as of `Box.values`.

    Regions of one kind differ in their clocks alone.
    """

    box: Box
    pattern: Callable[[dict[str, FloatArray]], Pattern]
    kind: Hashable

    def _growth(self, gains: ToolGains, places: FloatArray) -> ComplexArray:
        pattern = self.pattern(self.box.values(places))
        return leading(pattern.closed(gains), pattern.period_s)

    def screened(self, gains: ToolGains) -> float:
        """Return the largest growth at corners and knots: where among regions of one kind a search is worth it."""
        return float(np.abs(self._growth(gains, corners_and_knots(self.box.cells, SCREENED_DRAWS))).max())

    def worse(self, gains: ToolGains, growth_limit: float) -> list[tuple[float, Pattern]]:
        """Return the loops that a search finds to grow more than this in a millisecond, each after its growth."""
        places, values = worst_point(partial(self._growth, gains), len(self.box.sides), self.box.cells)
        growth = np.abs(values)
        return [
            (float(growth[at]), self.pattern(self.box.values(places[:, [at]])))
            for at in np.flatnonzero(growth > growth_limit)
        ]


def _worse_of_a_kind(regions: Sequence[Region], gains: ToolGains, growth_limit: float) -> list[Pattern]:
    """Return loops that grow more than a limit, of regions of one kind.

    Of many clocks those are searched that grow fastest at corners and knots, and one loop stands for its neighbours.
    """
    if len(regions) <= SEARCHED_OF_A_KIND:
        return [loop for region in regions for _, loop in region.worse(gains, growth_limit)]
    ranked = sorted(regions, key=lambda region: -region.screened(gains))[:SEARCHED_OF_A_KIND]
    found = [worse for region in ranked for worse in region.worse(gains, growth_limit)]
    return [max(found, key=lambda worse: worse[0])[1]] if found else []


@dataclass(frozen=True)
class Mode:
    """An oscillation of a loop; damping ratio 1 without one."""

    damping_ratio: float
    frequency_hz: float
    time_constant_s: float


class System:
    """Loops, of one or several patterns, that a coupling must stabilise: corners of all ranges and points inside."""

    def __init__(self, patterns: Sequence[Pattern], regions: Sequence[Region], motors: int = 1) -> None:
        self.patterns, self.corners, self.motors = list(patterns), len(patterns), motors
        self._kinds: dict[Hashable, list[Region]] = {}
        for region in regions:
            self._kinds.setdefault(region.kind, []).append(region)
        self._few: dict[int, list[int]] = {}
        # Consecutive calls have the same gains: first for some loops, then for all.
        self._last: dict[int, tuple[ToolGains, FloatArray]] = {}
        self._searched: set[ToolGains] = set()

    def search(self, gains: ToolGains) -> int:
        """Search the ranges with these gains, once; return how many loops worse than all so far it adds."""
        if gains in self._searched:
            return 0
        self._searched.add(gains)
        place, _, radius = self.worst(gains)
        before, limit = len(self.patterns), radius ** (UNIT_S / self.patterns[place].period_s) * (1 + TOLERANCE)
        with np.errstate(over="ignore", invalid="ignore"):
            for alike in self._kinds.values():
                self.patterns += _worse_of_a_kind(alike, gains, limit)
        return len(self.patterns) - before

    def radius(self, gains: ToolGains) -> tuple[float, Any]:
        """Return the largest spectral radius, for a tick, and what its loop is, after a search of the ranges."""
        self.search(gains)
        place, row, radius = self.worst(gains)
        pattern = self.patterns[place]
        return radius ** (1 / pattern.ticks), pattern.case(row)

    def has_counterexample(self, gains: ToolGains) -> bool:
        """Return whether a search of the ranges adds an unstable loop."""
        return self.search(gains) > 0 and not self.stable(gains)

    def stable_over_ranges(self, gains: ToolGains) -> bool:
        """Return whether every loop is stable, the worst that a search of the ranges finds included."""
        return self.stable(gains) and not self.has_counterexample(gains)

    def stable(self, gains: ToolGains) -> bool:
        """Return whether every loop so far is stable; loops that failed before are checked first."""
        if not all(
            np.abs(self.eigenvalues(place, gains, some)).max() < 1 - TOLERANCE for place, some in self._few.items()
        ):
            return False
        unstable = self._first_unstable(gains)
        if unstable is None:
            return True
        self._few.setdefault(unstable[0], []).append(unstable[1])
        return False

    def worst(self, gains: ToolGains) -> tuple[int, int, float]:
        """Return pattern and row of the fastest growing loop, and its spectral radius over a period."""
        worst = []
        for place, pattern in enumerate(self.patterns):
            values = np.abs(self.eigenvalues(place, gains)).max(axis=-1)
            row = int(np.argmax(values))
            worst.append((math.log(values[row]) / pattern.period_s, place, row, float(values[row])))
        _, place, row, radius = max(worst)
        return place, row, radius

    def slowest(self, gains: ToolGains) -> Mode:
        """Return the least damped oscillatory mode of all loops, above 0.1 Hz."""
        every = ((pattern, self.eigenvalues(place, gains)) for place, pattern in enumerate(self.patterns))
        poles = np.concatenate([np.log(each[np.abs(each) > _DEAD]) / pattern.period_s for pattern, each in every])
        poles = poles[np.abs(poles.imag) > 2 * np.pi * 0.1]
        if len(poles) == 0:
            return Mode(1.0, 0.0, math.inf)
        ratio = -poles.real / np.abs(poles)
        pole = poles[np.argmin(ratio)]
        return Mode(float(ratio.min()), float(abs(pole.imag) / (2 * np.pi)), float(-1 / pole.real))

    def _first_unstable(self, gains: ToolGains) -> tuple[int, int] | None:
        for place in range(len(self.patterns)):
            radii = leading_radii(self._relative(place, gains))
            row = int(np.argmax(radii))
            if not radii[row] < 1 - TOLERANCE:
                return place, row
        return None

    def eigenvalues(self, place: int, gains: ToolGains, rows: Sequence[int] | None = None) -> ComplexArray:
        """Return the poles of loops, shape (loops, size)."""
        return moving_poles(self._relative(place, gains, rows))

    def _relative(self, place: int, gains: ToolGains, rows: Sequence[int] | None = None) -> FloatArray:
        last = self._last.get(place)
        if last is None or last[0] != gains:
            with np.errstate(over="ignore", invalid="ignore"):
                last = (gains, self.patterns[place].closed(gains).relative)
            self._last[place] = last
        return last[1] if rows is None else last[1][rows]


@dataclass(frozen=True)
class WithMargin:
    """All loops with K and B as they are and up to a gain margin larger, and with each motor stronger by its margin."""

    loops: System | WithMargin
    gain_margin: float
    motor_margin: float

    @property
    def motors(self) -> int:
        """Number of motors."""
        return self.loops.motors

    def _off(self, gains: ToolGains) -> list[ToolGains]:
        """Return the gains at the margins."""
        return [gains.times(self.gain_margin), *(gains.times(self.motor_margin, one) for one in range(self.motors))]

    def stable(self, gains: ToolGains) -> bool:
        """Return whether every loop is stable with the gains, and with larger ones."""
        between = gains.times(math.sqrt(self.gain_margin))
        return all(map(self.loops.stable, [*self._off(gains), between, gains]))

    def has_counterexample(self, gains: ToolGains) -> bool:
        """Return whether a search of the ranges finds an unstable loop, with the margin or without."""
        return any(map(self.loops.has_counterexample, [*self._off(gains), gains]))

    def slowest(self, gains: ToolGains) -> Mode:
        """Return the least damped oscillation of all loops."""
        return self.loops.slowest(gains)


Loops = System | WithMargin


def leading(loops: ClosedLoops, period_s: float) -> ComplexArray:
    """Return the largest pole of each of m loops, grown over a unit of time: of all modes and of fast ones, (2, m)."""
    values = loops.poles
    grown = values * np.maximum(np.abs(values), _DEAD) ** (UNIT_S / period_s - 1)
    slow = (np.abs(np.angle(values)) < 2 * np.pi * 2.0 * period_s) & (np.abs(grown) < 1)
    both = np.stack([grown, np.where(slow, 0.5 * grown, grown)])
    largest = np.argmax(np.abs(both), axis=-1)[..., None]
    return np.asarray(np.take_along_axis(both, largest, axis=-1)[..., 0])
