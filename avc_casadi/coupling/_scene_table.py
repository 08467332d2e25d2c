"""A gain table for the look-up in every tick: the rows that a straight line in ln(frequency) needs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from avc_casadi._errors import InputError
from avc_casadi.runtime import Expr
from avc_casadi.support import FloatArray

if TYPE_CHECKING:
    from avc_casadi.coupling._schedule import GainSchedule


# Largest deviation from a full table, as a share of each gain's largest value.
TOLERANCE = 5e-3


@dataclass(frozen=True)
class GainTable:
    """Gains against frequency, linear in ln(frequency) between rows and constant beyond the ends, as on the device.

    Attributes:
        frequency_hz: rising, shape (n,).
        gains: b (N.s/m), k (N/m) and b_p (N.s/m), shape (3, n).
    """

    frequency_hz: FloatArray
    gains: FloatArray

    @classmethod
    def of(cls, schedule: GainSchedule, tolerance: float = TOLERANCE) -> GainTable:
        """Take the rows with gains, and leave out those that the others interpolate within a tolerance.

        Args:
            schedule: a gain schedule.
            tolerance: largest deviation, as a share of each gain; 0 keeps every row.

        Raises:
            InputError: no row has gains.
        """
        if not schedule.usable.any():
            raise InputError.of(
                "has no row with gains; choose another method", file=schedule.problem, key=schedule.method
            )
        order = np.argsort(schedule.frequency_hz, kind="stable")
        order = order[schedule.usable[order]]
        frequency = schedule.frequency_hz[order]
        first = np.concatenate([[True], np.diff(frequency) > 0])
        order, frequency = order[first], frequency[first]
        gains = np.array(
            [
                values[order]
                for values in (schedule.damping_ns_per_m, schedule.stiffness_n_per_m, schedule.contact_damping_ns_per_m)
            ]
        )
        kept = _needed(np.log(frequency), gains, tolerance)
        return cls(frequency[kept], gains[:, kept])

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(self.frequency_hz)

    @property
    def rest_hz(self) -> float:
        """Frequency of the row for a device at rest: the lowest."""
        return float(self.frequency_hz[0])

    def __call__(self, frequency_hz: FloatArray) -> FloatArray:
        """Return b, k and b_p at frequencies, shape (3, ...)."""
        at = np.log(np.clip(frequency_hz, self.frequency_hz[0], self.frequency_hz[-1]))
        return np.array([np.interp(at, np.log(self.frequency_hz), gain) for gain in self.gains])

    def expressions(self, frequency_hz: Expr) -> list[Expr]:
        """Return b, k and b_p as expressions in the frequency: sums of ramps, one for each interval."""
        import casadi as ca  # noqa: PLC0415

        knots = np.log(self.frequency_hz)
        at = ca.log(ca.fmax(frequency_hz, self.rest_hz))
        values: list[Expr] = [float(gain) for gain in self.gains[:, 0]]
        for index, width in enumerate(np.diff(knots)):
            ramp = ca.fmin(ca.fmax(at - knots[index], 0), width)
            for gain, row in enumerate(self.gains):
                slope = (row[index + 1] - row[index]) / width
                if slope != 0:
                    values[gain] += slope * ramp
        return [ca.SX(value) for value in values]


def _needed(at: FloatArray, gains: FloatArray, tolerance: float) -> NDArray[np.intp]:
    """Keep the ends and, by bisection at the worst row, whatever straight lines miss."""
    scale = tolerance * np.maximum(np.abs(gains), 1e-3 * np.abs(gains).max(axis=1, keepdims=True))
    kept = {0, len(at) - 1}
    spans = [(0, len(at) - 1)]
    while spans:
        low, high = spans.pop()
        if high - low < 2:
            continue
        inner = slice(low + 1, high)
        share = (at[inner] - at[low]) / (at[high] - at[low])
        line = gains[:, [low]] + share * (gains[:, [high]] - gains[:, [low]])
        miss = np.abs(gains[:, inner] - line)
        excess = (miss - scale[:, inner]).max(axis=0)
        worst = int(excess.argmax())
        if excess[worst] > 0:
            middle = low + 1 + worst
            kept.add(middle)
            spans += [(low, middle), (middle, high)]
    return np.array(sorted(kept))
