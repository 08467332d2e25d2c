"""A search of a box for the largest modulus of an eigenvalue: corners, edges, points inside, lines, then ascents.

A search, not a proof. A loop that changes often over a range has knots there, and is searched in each cell between two.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations, product

import numpy as np

from avc_casadi._util.arrays import ComplexArray, FloatArray, IndexArray

Leading = Callable[[IndexArray, FloatArray], ComplexArray]
"""The leading eigenvalue of each of m loops, by row (m,) and place in the unit box (sides, m)."""

Ranges = dict[str, tuple[float, float]]
"""[lowest, highest] by name."""

# Places of large values that lie apart: those with lines through them, and those from which the modulus is ascended,
# in a box of one cell and of many.
_LINED_PLACES = 6
_ASCENTS = 5
_ASCENTS_OF_CELLS = 8
# Places on a line along a side.
_LINE = 15
# An ascent: its first reach, as a share of a cell, how that shrinks, how often it moves at most, and where it ends.
_FIRST_REACH = 0.2
_SHRINKS = 0.45
_MOST_MOVES = 12
_LEAST_GAIN = 1e-10
_LEAST_MOVE = 1e-4
_LEAST_REACH = 3e-3
# Sweeps over the sides that bring a bounded quadratic to its top.
_SWEEPS = 15

KNOT_DRAWS = 2
"""Corners of the other sides that are drawn at each knot of a side of many cells, in a search."""


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
        """Return the values of each range at places of the box, (sides, m) in cells from 0 on, each of shape (m,).

        A range above 0 that spans more than a factor of 3, or has knots, is interpolated in its logarithm.
        """
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
    """Return places (sides, m) of a box: its corners, 64 at most, and each knot with drawn corners of the other sides.

    `cells` is the number of cells of each side, `draws` that of the corners that are drawn at each knot.
    """
    sides = len(cells)
    top = np.array(cells, dtype=np.float64)[:, None]
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


def everywhere(cells: Sequence[int]) -> FloatArray:
    """Return places (sides, m) all over a box: corners, knots, edges of one cell, points inside."""
    sides = len(cells)
    top = np.array(cells, dtype=np.float64)[:, None]
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


class _EachPlaceOnce:
    """The leading eigenvalues at places of a box, each place worked out once.

    Lines cross, and ascents of several kinds from one place take the same moves: half to two thirds of all places of a
    search have been looked at before.
    """

    def __init__(self, leading: Callable[[FloatArray], ComplexArray]) -> None:
        self._leading = leading
        self._known: dict[bytes, ComplexArray] = {}

    def __call__(self, places: FloatArray) -> ComplexArray:
        """Return the eigenvalues of each kind at places (sides, m), as (kinds, m)."""
        keys = [place.tobytes() for place in places.T]
        columns_of = {key: column for column, key in enumerate(keys) if key not in self._known}
        if columns_of:
            values = np.atleast_2d(self._leading(places[:, list(columns_of.values())]))
            self._known |= zip(columns_of, values.T, strict=True)
        return np.stack([self._known[key] for key in keys], axis=1)


def worst_point(
    leading: Callable[[FloatArray], ComplexArray], sides: int, cells: Sequence[int] = ()
) -> tuple[FloatArray, ComplexArray]:
    """Return the places (sides, kinds) of a box where each kind of eigenvalue has its largest modulus, and it.

    The box is the unit box, or has sides of as many cells as are given, with about one maximum in each.
    """
    # Many points, edges, lines and ascents: maxima near a resonance of tool, contact or device are narrow.
    cells = cells or (1,) * sides
    top = np.array(cells, dtype=np.float64)[:, None]
    places = everywhere(cells)
    values_at = _EachPlaceOnce(leading)
    values = values_at(places)
    kinds = np.arange(len(values))
    if not sides:
        return places[:, 0 * kinds], values[:, 0]
    # Neighbouring knots may belong to one maximum; within a cell a quarter of it lies apart.
    apart = np.where(top > 1, 6.0, 1.0)
    for _ in range(2):
        largest = dict.fromkeys(
            column for kind in values for column in far_apart(np.abs(kind), places / apart, _LINED_PLACES)
        )
        lines = np.concatenate([_lines(places[:, column], top[:, 0]) for column in largest], axis=1)
        places = np.concatenate([places, lines], axis=1)
        values = np.concatenate([values, values_at(lines)], axis=1)
    ascents = _ASCENTS if top.max() == 1 else _ASCENTS_OF_CELLS
    starts = [far_apart(np.abs(kind), places / apart, ascents) for kind in values]
    rows = np.repeat(kinds, [len(columns) for columns in starts])

    def leading_of_kinds(rows: IndexArray, places: FloatArray) -> ComplexArray:
        return np.asarray(values_at(places)[rows, np.arange(len(rows))])

    tops, ends = ascend(leading_of_kinds, rows, places[:, np.concatenate(starts)], top)
    best = [int(np.where(rows == kind, np.abs(ends), -1.0).argmax()) for kind in kinds]
    return tops[:, best], ends[best]


def _lines(place: FloatArray, top: FloatArray) -> FloatArray:
    """Return points along each side of the box through a place (sides,); along many cells, those about the place."""
    lines = np.repeat(place[:, None], len(place) * _LINE, axis=1)
    for side, length in enumerate(top):
        middle = np.clip(place[side], 1.5, length - 1.5) if length > 3 else length / 2
        reach = min(length / 2, 1.5)
        lines[side, side * _LINE : (side + 1) * _LINE] = np.linspace(middle - reach, middle + reach, _LINE)
    return lines


def far_apart(values: FloatArray, places: FloatArray, count: int) -> list[int]:
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

    The box reaches from 0 to `high` along each side (sides, 1). A move goes to the best of some probes and of the top
    of the quadratic through them.
    """
    place = places.copy()
    reach = np.full(len(rows), _FIRST_REACH)
    top = leading(rows, place)
    going = np.arange(len(rows))
    for _ in range(_MOST_MOVES):
        here = place[:, going]
        radius = reach[going]
        best = top[going]
        probes = np.clip(here + _moves(here, radius, high), 0.0, high)
        values = _at_probes(leading, rows[going], probes)
        down = -np.minimum(here, 2 * radius)
        up = np.minimum(high - here, 2 * radius)
        guess = here + _model_top(probes - here, np.abs(values) - np.abs(best), down, up)
        guess_value = _at_probes(leading, rows[going], guess[None])
        probes = np.concatenate([here[None], probes, guess[None]])
        values = np.concatenate([best[None], values, guess_value])
        chosen = np.abs(values).argmax(axis=0)
        column = np.arange(len(going))
        place[:, going] = probes[chosen, :, column].T
        top[going] = values[chosen, column]
        moved = np.abs(place[:, going] - here).max(axis=0)
        reach[going] = np.where(moved < radius, radius * _SHRINKS, radius)
        gained = (np.abs(top[going]) > np.abs(best) + _LEAST_GAIN) & (moved > _LEAST_MOVE)
        going = going[gained | (reach[going] > _LEAST_REACH)]
        if not going.size:
            break
    return place, top


def _at_probes(leading: Leading, rows: IndexArray, probes: FloatArray) -> ComplexArray:
    """Return the eigenvalues at p probes for each row, (p, sides, m), as (p, m)."""
    flat = probes.transpose(1, 0, 2).reshape(probes.shape[1], -1)
    return leading(np.tile(rows, len(probes)), flat).reshape(-1, len(rows))


def _moves(place: FloatArray, reach: FloatArray, high: FloatArray | float) -> FloatArray:
    """Return probes both ways along each side of the box, then inwards along two sides at once, (p, sides, m)."""
    sides = len(place)
    inwards = np.where(place <= 0.5 * high, reach, -reach)
    along = np.eye(sides)[:, :, None] * inwards
    diagonal = [along[i] + along[j] for i, j in combinations(range(sides), 2)]
    return np.array([*(move for inward in along for move in (inward, -inward)), *diagonal])


def _model_top(moves: FloatArray, gains: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Return the step (sides, m) to the maximum of the quadratic through the probes, between two bounds.

    Along side i two moves d and e with gains g_d and g_e give its bend 2 (g_d/d - g_e/e)/(d - e) and its slope
    g_d/d - bend d/2; a move along two sides gives their common bend.
    """
    sides, m = moves.shape[1:]
    slope = np.zeros((sides, m))
    bend = np.zeros((sides, sides, m))
    with np.errstate(divide="ignore", invalid="ignore"):
        for i in range(sides):
            d = moves[2 * i, i]
            e = moves[2 * i + 1, i]
            rise_d = gains[2 * i] / d
            rise_e = gains[2 * i + 1] / e
            two_ways = (d != 0) & (e != 0)
            bend[i, i] = np.where(two_ways, 2 * (rise_d - rise_e) / (d - e), 0.0)
            slope[i] = np.where(two_ways, rise_d - 0.5 * bend[i, i] * d, np.where(d != 0, rise_d, 0.0))
        for number, (i, j) in enumerate(combinations(range(sides), 2)):
            d = moves[2 * i, i]
            e = moves[2 * j, j]
            cross = gains[2 * sides + number] - gains[2 * i] - gains[2 * j]
            bend[i, j] = bend[j, i] = np.where((d != 0) & (e != 0), cross / (d * e), 0.0)
    return _top_between(np.where(np.isfinite(slope), slope, 0.0), np.where(np.isfinite(bend), bend, 0.0), low, high)


def _top_between(slope: FloatArray, bend: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Return x with the largest slope' x + x' bend x/2 between bounds, (sides, m): one side after the other in turn.

    slope is (sides, m), bend (sides, sides, m); a few rounds over the sides are made.
    """
    sides, m = slope.shape
    step = np.zeros((sides, m))
    for _ in range(_SWEEPS):
        for i in range(sides):
            rise = slope[i] + (bend[i] * step).sum(axis=0) - bend[i, i] * step[i]
            curved = bend[i, i] < 0
            top = np.where(curved, -rise / np.where(curved, bend[i, i], 1.0), np.where(rise > 0, np.inf, -np.inf))
            step[i] = np.clip(np.where(~curved & (rise == 0), 0.0, top), low[i], high[i])
    return step
