"""`direct` against `exact`, which solve the same problem independently: where they differ, and why."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.json_values import plain
from avc_casadi.design.comparison.verdict import AGREEMENT
from avc_casadi.model.schedule import GainSchedule

_NEARER = 1e-6
"""Points of the same magnitude error whose distances to Z_h_ds differ by more than this, relative to
|Z_d| + |H Z_ds|, are two points."""


@dataclass(frozen=True)
class Parting:
    """One frequency at which `direct` and `exact` differ.

    Attributes:
        frequency_hz: the frequency.
        reason: why.
    """

    frequency_hz: float
    reason: str


@dataclass(frozen=True)
class CrossCheck:
    """Differences between `direct` and `exact`.

    Attributes:
        magnitude_error: largest difference in ||Z_h_ds| - |Z_h_avc||, relative to |Z_d| + |H Z_ds|, where both have
            gains.
        distance: the same for |Z_h_avc - Z_h_ds|.
        only_one: rows where only one of the two has gains.
        partings: the frequencies at which they differ.
    """

    magnitude_error: float
    distance: float
    only_one: int
    partings: tuple[Parting, ...]

    @property
    def agree(self) -> bool:
        """Whether both reach the same magnitude error wherever they have gains, and have gains at the same rows."""
        return self.magnitude_error <= AGREEMENT and self.only_one == 0

    def document(self) -> dict[str, Any]:
        """Return JSON values."""
        values = {"magnitude_error": self.magnitude_error, "distance": self.distance, "only_one": self.only_one}
        return {"agree": self.agree, **plain(values), "partings": [plain(vars(each)) for each in self.partings]}


def cross_check(direct: GainSchedule, exact: GainSchedule, scale: FloatArray) -> CrossCheck:
    """Compare two solutions of (11)-(12).

    Args:
        direct: that of CasADi's NLP.
        exact: that of the geometry of arcs.
        scale: |Z_d| + |H Z_ds|, N.s/m, shape (n,).
    """
    both = direct.usable & exact.usable
    magnitude = np.where(both, direct.magnitude_error - exact.magnitude_error, 0.0) / scale
    farther = np.abs(direct.impedance - direct.target) - np.abs(exact.impedance - exact.target)
    distance = np.where(both, farther, 0.0) / scale
    one = direct.usable != exact.usable
    parted = np.flatnonzero(one | (np.abs(magnitude) > AGREEMENT) | (np.abs(distance) > _NEARER))
    partings = [
        Parting(float(direct.frequency_hz[row]), _reason(direct, exact, row, float(magnitude[row])))
        for row in parted.tolist()
    ]
    most, farthest = (float(np.abs(each).max(initial=0.0)) for each in (magnitude, distance))
    return CrossCheck(most, farthest, int(one.sum()), tuple(partings))


def _reason(direct: GainSchedule, exact: GainSchedule, row: int, magnitude: float) -> str:
    if not (direct.usable[row] and exact.usable[row]):
        without = exact if direct.usable[row] else direct
        return without.reason[row] or f"{without.method} has no gains"
    if abs(magnitude) > AGREEMENT:
        farther = direct if magnitude > 0 else exact
        return (
            f"{farther.method} stopped short: its magnitude error is larger by {abs(magnitude):.2g} of |Z_d| + |H Z_ds|"
        )
    return "the same magnitude error at another point: a local minimum of the distance to Z_h_ds"
