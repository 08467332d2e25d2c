"""Stability of periodic loops: spectral radius and least damped mode of many monodromy matrices."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray
from avc_casadi.claims.stability.eigenvalues import eigenvalues, leading_radii

if TYPE_CHECKING:
    from avc_casadi.model.lifted_loop import ToolGains

# Eigenvalues of these matrices are right to about 1e-12; slower decay than this is indistinguishable from none.
TOLERANCE = 1e-9
# Products of maps beyond this overflow, or soon do: their loops count as unstable.
_OVERFLOWING = 1e60
# Eigenvalues this small are deadbeat; oscillations slower than this are drift.
_DEAD, _DRIFT_HZ = 1e-6, 0.1


class Periodic(Protocol):
    """Properties common to loops of one pattern of samples.

    Attributes:
        shift: the state in which all is displaced by one metre, shape (size,).
        period_s: of the pattern.
    """

    shift: FloatArray
    period_s: float


@dataclass(frozen=True)
class Mode:
    """An oscillation of a loop.

    Attributes:
        damping_ratio: as a share of critical damping; 1 without oscillation.
        frequency_hz: of the oscillation.
        time_constant_s: of its decay to 1/e.
    """

    damping_ratio: float
    frequency_hz: float
    time_constant_s: float


class Loops(Protocol):
    """All loops that a coupling must stabilise."""

    def stable(self, gains: ToolGains) -> bool:
        """Return whether every loop is stable."""

    def slowest(self, gains: ToolGains) -> Mode:
        """Return the least damped oscillation of all loops."""


@dataclass(frozen=True)
class WithMargin:
    """All loops, with K and B as they are and up to a gain margin times as large.

    Attributes:
        loops: all loops.
        gain_margin: required.
    """

    loops: Loops
    gain_margin: float

    def stable(self, gains: ToolGains) -> bool:
        """Return whether every loop is stable with the gains, and with larger ones."""
        factors = {self.gain_margin, 1.0, math.sqrt(self.gain_margin)}
        return all(self.loops.stable(gains.times(factor)) for factor in sorted(factors, reverse=True))

    def slowest(self, gains: ToolGains) -> Mode:
        """Return the least damped oscillation of all loops."""
        return self.loops.slowest(gains)


class PeriodicLoops(ABC):
    """Loops, of one or several patterns, that a coupling must stabilise."""

    patterns: Sequence[Periodic]

    def __init__(self) -> None:
        self._few: list[list[int]] = [[] for _ in self.patterns]
        # Consecutive calls have the same gains: first for some loops, then for all.
        self._last: dict[int, tuple[ToolGains, FloatArray]] = {}

    @abstractmethod
    def matrices(self, place: int, gains: ToolGains) -> FloatArray:
        """Return the monodromy matrices of the loops of a pattern, shape (loops, size, size)."""

    def stable(self, gains: ToolGains) -> bool:
        """Return whether every loop is stable; loops that failed before are checked first."""
        if not self._settle(gains, self._few):
            return False
        failed = self._first_unstable(gains)
        if failed is None:
            return True
        self._few[failed[0]].append(failed[1])
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

    def _settle(self, gains: ToolGains, rows: Sequence[Sequence[int]]) -> bool:
        return all(_contracts(self.eigenvalues(place, gains, some)).all() for place, some in enumerate(rows) if some)

    def _first_unstable(self, gains: ToolGains) -> tuple[int, int] | None:
        for place in range(len(self.patterns)):
            radii = leading_radii(self._held(place, gains)[None], 1)[0]
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
                last = (gains, _held(self.matrices(place, gains), self.patterns[place].shift))
            self._last[place] = last
        return last[1] if rows is None else last[1][rows]


def _contracts(values: ComplexArray) -> BoolArray:
    return np.asarray(np.abs(values).max(axis=-1) < 1 - TOLERANCE)


def _held(matrices: FloatArray, shift: FloatArray) -> FloatArray:
    """Return matrices with the eigenvalue 1 of a free translation deflated, the others unchanged (Wielandt)."""
    floats = np.abs(matrices @ shift - shift).max(axis=-1) < 1e-9
    taken = matrices - shift[:, None] * matrices[..., :1, :]
    found = np.where(floats[..., None, None], taken, matrices)
    finite = np.abs(found).max(axis=(-2, -1)) < _OVERFLOWING
    return np.where(finite[..., None, None], found, _OVERFLOWING * np.eye(found.shape[-1]))
