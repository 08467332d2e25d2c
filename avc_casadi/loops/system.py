"""Stability of periodic loops: spectral radius and least damped mode of many monodromy matrices."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, Protocol, Self

import numpy as np

from avc_casadi._util.arrays import ComplexArray, FloatArray, IndexArray
from avc_casadi.loops.loop import Map
from avc_casadi.loops.ranges import Box, worst_point
from avc_casadi.loops.spectrum import eigenvalues, leading_radii
from avc_casadi.model.ends import ToolGains

# Eigenvalues of these matrices are right to about 1e-12; slower decay than this is indistinguishable from none.
TOLERANCE = 1e-9
# Products of maps beyond this overflow, or soon do: their loops count as unstable.
_OVERFLOWING = 1e60
# Eigenvalues this small are deadbeat; oscillations slower than this are drift.
_DEAD, _DRIFT_HZ, _SLOW_HZ = 1e-6, 0.1, 2.0
# Growth of loops with different patterns is compared over this time.
UNIT_S = 1e-3


class Lifted(Protocol):
    """A loop over a period of its clocks."""

    @property
    def shift(self) -> FloatArray:
        """The state with all positions one metre on."""

    def maps(self, gains: ToolGains) -> Map:
        """Return the maps over one period."""


@dataclass(frozen=True)
class Pattern:
    """Loops of one pattern of samples: their maps over a period, and what each is; a radius is stated by the tick."""

    maps: Callable[[ToolGains], FloatArray]
    shift: FloatArray
    period_s: float
    ticks: int
    case: Callable[[int], Any]

    @classmethod
    def of(cls, loop: Lifted, period_s: float, ticks: int, case: Callable[[int], Any]) -> Self:
        """Return the pattern of a loop whose maps have any leading axes."""

        def maps(gains: ToolGains) -> FloatArray:
            found = loop.maps(gains)
            return np.asarray(found.reshape(-1, *found.shape[-2:]))

        return cls(maps, loop.shift, period_s, ticks, case)


@dataclass(frozen=True)
class Region:
    """Ranges that are searched, and the loops at m of their points, from values as of `Box.values`."""

    box: Box
    pattern: Callable[[dict[str, FloatArray]], Pattern]

    def worst(self, gains: ToolGains, *, slow: bool) -> tuple[float, Pattern]:
        """Return the largest growth in a millisecond that a search finds, and its loop; slow: of all modes."""

        def growth(_: IndexArray, places: FloatArray) -> ComplexArray:
            pattern = self.pattern(self.box.values(places))
            return leading(pattern.maps(gains), pattern, slow=slow)

        place, value = worst_point(growth, len(self.box.sides))
        return abs(value), self.pattern(self.box.values(place[:, None]))


@dataclass(frozen=True)
class Mode:
    """An oscillation of a loop; damping ratio 1 without one."""

    damping_ratio: float
    frequency_hz: float
    time_constant_s: float


class System:
    """Loops, of one or several patterns, that a coupling must stabilise: corners of all ranges and points inside."""

    def __init__(self, patterns: Sequence[Pattern], regions: Sequence[Region]) -> None:
        self.patterns, self.corners, self._regions = list(patterns), len(patterns), regions
        self._few: dict[int, list[int]] = {}
        # Consecutive calls have the same gains: first for some loops, then for all.
        self._last: dict[int, tuple[ToolGains, FloatArray]] = {}
        self._searched: set[ToolGains] = set()

    def search(self, gains: ToolGains) -> int:
        """Search the ranges with these gains, once; return how many loops worse than all known ones joined them."""
        if gains in self._searched:
            return 0
        self._searched.add(gains)
        place, _, radius = self.worst(gains)
        before, known = len(self.patterns), radius ** (UNIT_S / self.patterns[place].period_s) * (1 + TOLERANCE)
        with np.errstate(over="ignore", invalid="ignore"):
            for region, slow in product(self._regions, (True, False)):
                growth, pattern = region.worst(gains, slow=slow)
                if growth > known:
                    self.patterns.append(pattern)
        return len(self.patterns) - before

    def radius(self, gains: ToolGains) -> tuple[float, Any]:
        """Return the largest spectral radius, for a tick, and what its loop is, after a search of the ranges."""
        self.search(gains)
        place, row, radius = self.worst(gains)
        pattern = self.patterns[place]
        return radius ** (1 / pattern.ticks), pattern.case(row)

    def refuted(self, gains: ToolGains) -> bool:
        """Return whether a search of the ranges finds an unstable loop that was not known."""
        return self.search(gains) > 0 and not self.stable(gains)

    def stable_over_ranges(self, gains: ToolGains) -> bool:
        """Return whether every loop is stable, the worst that a search of the ranges finds included."""
        return self.stable(gains) and not self.refuted(gains)

    def stable(self, gains: ToolGains) -> bool:
        """Return whether every known loop is stable; loops that failed before are checked first."""
        if not all(
            np.abs(self.eigenvalues(place, gains, some)).max() < 1 - TOLERANCE for place, some in self._few.items()
        ):
            return False
        failed = self._first_unstable(gains)
        if failed is None:
            return True
        self._few.setdefault(failed[0], []).append(failed[1])
        return False

    def worst(self, gains: ToolGains) -> tuple[int, int, float]:
        """Return pattern and row of the fastest growing loop, and its spectral radius over a period."""
        found = []
        for place, pattern in enumerate(self.patterns):
            values = np.abs(self.eigenvalues(place, gains)).max(axis=-1)
            row = int(np.argmax(values))
            found.append((math.log(values[row]) / pattern.period_s, place, row, float(values[row])))
        _, place, row, radius = max(found)
        return place, row, radius

    def slowest(self, gains: ToolGains) -> Mode:
        """Return the least damped oscillatory mode of all loops, above 0.1 Hz."""
        found = Mode(1.0, 0.0, math.inf)
        for place, pattern in enumerate(self.patterns):
            values = self.eigenvalues(place, gains).ravel()
            poles = np.log(values[np.abs(values) > _DEAD]) / pattern.period_s
            poles = poles[np.abs(poles.imag) > 2 * np.pi * _DRIFT_HZ]
            if len(poles) == 0:
                continue
            ratio = -poles.real / np.abs(poles)
            row = int(np.argmin(ratio))
            if ratio[row] < found.damping_ratio:
                pole = poles[row]
                found = Mode(float(ratio[row]), float(abs(pole.imag) / (2 * np.pi)), float(-1 / pole.real))
        return found

    def _first_unstable(self, gains: ToolGains) -> tuple[int, int] | None:
        for place in range(len(self.patterns)):
            radii = leading_radii(self._held(place, gains))
            row = int(np.argmax(radii))
            if not radii[row] < 1 - TOLERANCE:
                return place, row
        return None

    def eigenvalues(self, place: int, gains: ToolGains, rows: Sequence[int] | None = None) -> ComplexArray:
        """Return the eigenvalues of loops without one of a free translation, shape (loops, size)."""
        return eigenvalues(self._held(place, gains, rows))

    def _held(self, place: int, gains: ToolGains, rows: Sequence[int] | None = None) -> FloatArray:
        last = self._last.get(place)
        if last is None or last[0] != gains:
            with np.errstate(over="ignore", invalid="ignore"):
                last = (gains, _held(self.patterns[place].maps(gains), self.patterns[place].shift))
            self._last[place] = last
        return last[1] if rows is None else last[1][rows]


@dataclass(frozen=True)
class WithMargin:
    """All loops, with K and B as they are and up to a gain margin times as large."""

    loops: System | WithMargin
    gain_margin: float

    def stable(self, gains: ToolGains) -> bool:
        """Return whether every loop is stable with the gains, and with larger ones."""
        factors = {self.gain_margin, 1.0, math.sqrt(self.gain_margin)}
        return all(self.loops.stable(gains.times(factor)) for factor in sorted(factors, reverse=True))

    def refuted(self, gains: ToolGains) -> bool:
        """Return whether a search of the ranges finds an unstable loop, with the margin or without."""
        return any(self.loops.refuted(gains.times(factor)) for factor in (self.gain_margin, 1.0))

    def slowest(self, gains: ToolGains) -> Mode:
        """Return the least damped oscillation of all loops."""
        return self.loops.slowest(gains)


Loops = System | WithMargin


def leading(matrices: FloatArray, pattern: Pattern, *, slow: bool) -> ComplexArray:
    """Return the largest eigenvalue of loops of a pattern (m, size, size), without a free translation."""
    values = eigenvalues(_held(matrices, pattern.shift))
    grown = values * np.maximum(np.abs(values), _DEAD) ** (UNIT_S / pattern.period_s - 1)
    size = np.abs(grown)
    if not slow:
        still = (np.abs(np.angle(values)) < 2 * np.pi * _SLOW_HZ * pattern.period_s) & (size < 1)
        size = np.where(still, 0.5 * size, size)
    largest = np.argmax(size, axis=-1)[..., None]
    found = np.take_along_axis(grown, largest, axis=-1)[..., 0]
    return np.asarray(found / np.abs(found) * np.take_along_axis(size, largest, axis=-1)[..., 0])


def _held(matrices: FloatArray, shift: FloatArray) -> FloatArray:
    """Return matrices with the eigenvalue 1 of a free translation deflated, the others unchanged (Wielandt)."""
    floats = np.abs(matrices @ shift - shift).max(axis=-1) < 1e-9
    taken = matrices - shift[:, None] * matrices[..., :1, :]
    found = np.where(floats[..., None, None], taken, matrices)
    finite = np.abs(found).max(axis=(-2, -1)) < _OVERFLOWING
    return np.where(finite[..., None, None], found, _OVERFLOWING * np.eye(found.shape[-1]))
