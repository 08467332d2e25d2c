"""The loops of a coupling to an engine or a follower, of many patterns of samples: corners of ranges, and inside."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np

from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi._util.progress import UNSEEN_STAGES, Stages
from avc_casadi.loops.search import Box, corners_and_knots, worst_point
from avc_casadi.loops.spectrum import ClosedLoops, leading_radii, moving_poles
from avc_casadi.model.ends import ToolGains

SCREENED_DRAWS = 1
"""Corners of the other sides that are drawn at each knot of a side of many cells, before a search."""
SEARCHED_OF_A_KIND = 3
"""Regions that differ in their clocks alone and are searched; the others grow more slowly at corners and knots."""
# Eigenvalues of these matrices are right to about 1e-12; slower decay than this is indistinguishable from none.
TOLERANCE = 1e-9
# Eigenvalues this small are deadbeat.
_DEAD = 1e-6
# What swings more slowly is no oscillation that a hand feels; below the second frequency a decaying mode is slow.
_SLOWEST_HZ = 0.1
_SLOW_HZ = 2.0
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
class SearchRegion:
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
            (float(growth[kind]), self.pattern(self.box.values(places[:, [kind]])))
            for kind in np.flatnonzero(growth > growth_limit)
        ]


def _worse_of_a_kind(
    regions: Sequence[SearchRegion], gains: ToolGains, growth_limit: float, stages: Stages
) -> list[Pattern]:
    """Return loops that grow more than a limit, of regions of one kind; each region is a stage.

    Of many clocks those are searched that grow fastest at corners and knots, and one loop stands for its neighbours.
    """
    few = len(regions) <= SEARCHED_OF_A_KIND
    ranked = regions if few else sorted(regions, key=lambda region: -region.screened(gains))[:SEARCHED_OF_A_KIND]
    worse: list[tuple[float, Pattern]] = []
    for region in ranked:
        stages.begin("searches of the ranges")
        worse += region.worse(gains, growth_limit)
    if few:
        return [loop for _, loop in worse]
    return [max(worse, key=lambda loop: loop[0])[1]] if worse else []


@dataclass(frozen=True)
class LeastDampedMode:
    """An oscillation of a loop; damping ratio 1 without one."""

    damping_ratio: float
    frequency_hz: float
    time_constant_s: float


class LoopFamily:
    """Loops, of one or several patterns, that a coupling must stabilise: corners of all ranges and points inside."""

    def __init__(self, patterns: Sequence[Pattern], regions: Sequence[SearchRegion], motors: int = 1) -> None:
        """Keep the loops at the corners of all ranges, and the regions in which others are searched.

        `motors` counts the motors whose force may be wrong.
        """
        self.patterns = list(patterns)
        self.corners = len(patterns)
        self.motors = motors
        self._kinds: dict[Hashable, list[SearchRegion]] = {}
        for region in regions:
            self._kinds.setdefault(region.kind, []).append(region)
        self._few: dict[int, list[int]] = {}
        # Consecutive calls have the same gains: first for some loops, then for all.
        self._last: dict[int, tuple[ToolGains, FloatArray]] = {}
        self._searched: set[ToolGains] = set()

    @property
    def regions(self) -> int:
        """Number of regions of the ranges that one search looks through."""
        return sum(min(len(alike), SEARCHED_OF_A_KIND) for alike in self._kinds.values())

    def search(self, gains: ToolGains, stages: Stages = UNSEEN_STAGES) -> int:
        """Search the ranges with these gains, once; return how many loops worse than all so far it adds.

        Each region that is searched is a stage.
        """
        if gains in self._searched:
            return 0
        self._searched.add(gains)
        place, _, radius = self.worst(gains)
        before = len(self.patterns)
        limit = radius ** (UNIT_S / self.patterns[place].period_s) * (1 + TOLERANCE)
        with np.errstate(over="ignore", invalid="ignore"):
            for alike in self._kinds.values():
                self.patterns += _worse_of_a_kind(alike, gains, limit, stages)
        return len(self.patterns) - before

    def radius(self, gains: ToolGains, stages: Stages = UNSEEN_STAGES) -> tuple[float, Any]:
        """Return the largest spectral radius, for a tick, and what its loop is, after a search of the ranges."""
        self.search(gains, stages)
        place, row, radius = self.worst(gains)
        pattern = self.patterns[place]
        return radius ** (1 / pattern.ticks), pattern.case(row)

    def has_counterexample(self, gains: ToolGains, stages: Stages = UNSEEN_STAGES) -> bool:
        """Return whether a search of the ranges adds an unstable loop."""
        return self.search(gains, stages) > 0 and not self.stable(gains)

    def stable_over_ranges(self, gains: ToolGains, stages: Stages = UNSEEN_STAGES) -> bool:
        """Return whether every loop is stable, the worst that a search of the ranges finds included."""
        return self.stable(gains) and not self.has_counterexample(gains, stages)

    def stable(self, gains: ToolGains) -> bool:
        """Return whether every loop so far, of corners and of searches, is stable; those that failed come first."""
        for place, rows in self._few.items():
            if not np.abs(self.eigenvalues(place, gains, rows)).max() < 1 - TOLERANCE:
                return False
        unstable = self._first_unstable(gains)
        if unstable is None:
            return True
        self._few.setdefault(unstable[0], []).append(unstable[1])
        return False

    def worst(self, gains: ToolGains) -> tuple[int, int, float]:
        """Return pattern and row of the loop of the largest ln(radius)/period, and its spectral radius of a period."""
        worst = []
        for place, pattern in enumerate(self.patterns):
            values = np.abs(self.eigenvalues(place, gains)).max(axis=-1)
            row = int(np.argmax(values))
            worst.append((math.log(values[row]) / pattern.period_s, place, row, float(values[row])))
        _, place, row, radius = max(worst)
        return place, row, radius

    def slowest(self, gains: ToolGains) -> LeastDampedMode:
        """Return damping ratio, frequency and time constant of the least damped oscillation of all loops.

        Of an eigenvalue z over a period p, s = ln(z)/p, the ratio is -Re s/|s|. Modes slower than `_SLOWEST_HZ` do not
        count.
        """
        rates = []
        for place, pattern in enumerate(self.patterns):
            values = self.eigenvalues(place, gains)
            rates.append(np.log(values[np.abs(values) > _DEAD]) / pattern.period_s)
        poles = np.concatenate(rates)
        poles = poles[np.abs(poles.imag) > 2 * np.pi * _SLOWEST_HZ]
        if len(poles) == 0:
            return LeastDampedMode(1.0, 0.0, math.inf)
        ratio = -poles.real / np.abs(poles)
        pole = poles[np.argmin(ratio)]
        return LeastDampedMode(float(ratio.min()), float(abs(pole.imag) / (2 * np.pi)), float(-1 / pole.real))

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
class PairMargins:
    """Gain margins of a spring and damper to another end than a wall.

    Attributes:
        gain_margin: of K and B at both ends.
        motor_margins: of the device's motor alone, and of the follower's.
    """

    gain_margin: float
    motor_margins: tuple[float, ...]


@dataclass(frozen=True)
class WithGainMargin:
    """All loops with K and B as they are and up to a gain margin larger, and with each motor stronger by its margin."""

    loops: LoopFamily | WithGainMargin
    gain_margin: float
    motor_margin: float

    @property
    def motors(self) -> int:
        """Number of motors."""
        return self.loops.motors

    def _off(self, gains: ToolGains) -> list[ToolGains]:
        """Return the gains at the margins."""
        stronger = [gains.times(self.motor_margin, motor) for motor in range(self.motors)]
        return [gains.times(self.gain_margin), *stronger]

    def stable(self, gains: ToolGains) -> bool:
        """Return whether every loop is stable with the gains, and with larger ones."""
        between = gains.times(math.sqrt(self.gain_margin))
        return all(map(self.loops.stable, [*self._off(gains), between, gains]))

    def has_counterexample(self, gains: ToolGains, stages: Stages = UNSEEN_STAGES) -> bool:
        """Return whether a search of the ranges finds an unstable loop, with the margin or without."""
        return any(self.loops.has_counterexample(tried, stages) for tried in [*self._off(gains), gains])

    def slowest(self, gains: ToolGains) -> LeastDampedMode:
        """Return the least damped oscillation of all loops."""
        return self.loops.slowest(gains)


Loops = LoopFamily | WithGainMargin


def leading(loops: ClosedLoops, period_s: float) -> ComplexArray:
    """Return the largest pole of each of m loops, grown over a unit of time: of all modes and of fast ones, (2, m)."""
    values = loops.poles
    grown = values * np.maximum(np.abs(values), _DEAD) ** (UNIT_S / period_s - 1)
    slow = (np.abs(np.angle(values)) < 2 * np.pi * _SLOW_HZ * period_s) & (np.abs(grown) < 1)
    kinds = np.stack([grown, np.where(slow, 0.5 * grown, grown)])
    largest = np.argmax(np.abs(kinds), axis=-1)[..., None]
    return np.asarray(np.take_along_axis(kinds, largest, axis=-1)[..., 0])
