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

# Eigenvalues of these matrices are right to about 1e-12; slower decay than this is not told from none.
TOLERANCE = 1e-9
# Eigenvalues this small belong to what is forgotten within a step; slower swings than this are drift.
_DEAD, _DRIFT_HZ = 1e-6, 0.1


class Periodic(Protocol):
    """What is known of loops that share a pattern of samples.

    Attributes:
        shift: the state that has everything one metre on, shape (size,).
        period_s: after which the pattern recurs.
    """

    shift: FloatArray
    period_s: float


@dataclass(frozen=True)
class Mode:
    """An oscillation of a loop.

    Attributes:
        damping_ratio: as a share of the critical; 1 where nothing swings.
        frequency_hz: of the oscillation.
        time_constant_s: in which it falls to 1/e.
    """

    damping_ratio: float
    frequency_hz: float
    time_constant_s: float


class PeriodicLoops(ABC):
    """Loops, some of each pattern, that a coupling must make stable."""

    patterns: Sequence[Periodic]

    def __init__(self) -> None:
        self._few: list[list[int]] = [[] for _ in self.patterns]
        # The gains asked about last are asked about again: first of some loops, then of all.
        self._last: dict[int, tuple[ToolGains, FloatArray]] = {}

    @abstractmethod
    def matrices(self, place: int, gains: ToolGains) -> FloatArray:
        """Return the monodromy matrices of the loops of a pattern, shape (loops, size, size)."""

    def stable(self, gains: ToolGains) -> bool:
        """Whether every loop is; those that failed before are asked first."""
        if not self._settle(gains, self._few):
            return False
        failed = self._first_unstable(gains)
        if failed is None:
            return True
        self._few[failed[0]].append(failed[1])
        return False

    def worst(self, gains: ToolGains) -> tuple[int, int, float]:
        """Return pattern and row of the loop that grows fastest in time, and its spectral radius over a period."""
        found = []
        for place, pattern in enumerate(self.patterns):
            values = np.abs(self.eigenvalues(place, gains)).max(axis=-1)
            row = int(np.argmax(values))
            found.append((math.log(values[row]) / pattern.period_s, place, row, float(values[row])))
        _, place, row, radius = max(found)
        return place, row, radius

    def slowest(self, gains: ToolGains) -> Mode:
        """Return the least damped mode of all loops that swings, faster than once in ten seconds."""
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
        """Return the eigenvalues of loops, one of what floats freely taken out, shape (loops, size)."""
        return eigenvalues(self._held(place, gains, rows))

    def _held(self, place: int, gains: ToolGains, rows: Sequence[int] | None = None) -> FloatArray:
        last = self._last.get(place)
        if last is None or last[0] != gains:
            last = (gains, _held(self.matrices(place, gains), self.patterns[place].shift))
            self._last[place] = last
        return last[1] if rows is None else last[1][rows]


def _contracts(values: ComplexArray) -> BoolArray:
    return np.asarray(np.abs(values).max(axis=-1) < 1 - TOLERANCE)


def _held(matrices: FloatArray, shift: FloatArray) -> FloatArray:
    """Take the eigenvalue 1 of a free translation out of matrices that have it, the others staying (Wielandt)."""
    floats = np.abs(matrices @ shift - shift).max(axis=-1) < 1e-9
    taken = matrices - shift[:, None] * matrices[..., :1, :]
    return np.where(floats[..., None, None], taken, matrices)
