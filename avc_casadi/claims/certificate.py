"""A certificate: one result a level, and the rows behind it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi._util.json_values import plain
from avc_casadi._util.printed import Columns, Tabular
from avc_casadi.claims.registry import CLAIMS
from avc_casadi.loops.wall import RADIUS_TOLERANCE, rigid

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling
    from avc_casadi.loops.sampled_loop import Fractions
    from avc_casadi.model.device import Device
    from avc_casadi.model.hands import Hand
    from avc_casadi.model.problem import Model, Problem
    from avc_casadi.model.schedule import GainSchedule


# A free, undamped device has the eigenvalue 1 twice: rounding moves a double one by its root, unless the matrix is
# triangular, as that of a rigid device is.
_FREE_TOLERANCE = 1e-7


def radius_limit(device: Device, parts: Fractions, hands: Hand) -> FloatArray:
    """Return the bound of the spectral radius of n renderings with h hands, shape (n, h).

    Below 1, where a spring of wall or hand restores the device. Without any its position is an eigenvalue of 1, which
    is no instability.
    """
    free = 1 + (RADIUS_TOLERANCE if rigid(device) else _FREE_TOLERANCE)
    held = np.broadcast_to(np.asarray(hands.stiffness_n_per_m) > 0, (len(hands),))
    called_back = (np.asarray(parts.integral) > 0)[:, None] | held[None, :]
    return np.where(called_back, 1 - RADIUS_TOLERANCE, free)


Level = str
"""A name in `CLAIMS`."""


@dataclass(frozen=True, eq=False)
class LevelResult:
    """One level of a certificate; row arrays have shape (n,) in the order of the gains."""

    level: Level
    passed: bool
    margin_ns_per_m: float
    frequency_hz: float
    model: Model
    claim: str
    tolerance_ns_per_m: float
    row: int | None
    row_passed: BoolArray
    row_margin_ns_per_m: FloatArray
    row_frequency_hz: FloatArray
    detail: dict[str, Any] = field(default_factory=dict)
    refused: str = ""
    outcome: str = ""

    def __repr__(self) -> str:
        return f"LevelResult({self.level}, {self.word}: {self.claim})"

    @property
    def word(self) -> str:
        """pass, fail, or refused: not judged; of a proof its outcome."""
        return self.outcome or ("refused" if self.refused else "pass" if self.passed else "fail")

    @property
    def rows_failed(self) -> int:
        """Number of rows that do not meet it."""
        return int(np.count_nonzero(~self.row_passed))

    def document(self) -> dict[str, Any]:
        """Return JSON values."""
        return {
            "pass": self.passed,
            "refused": self.refused or None,
            "outcome": self.outcome or None,
            "title": CLAIMS[self.level].title,
            "margin_ns_per_m": plain(self.margin_ns_per_m),
            "frequency_hz": plain(self.frequency_hz),
            "model": self.model,
            "claim": self.claim,
            "tolerance_ns_per_m": plain(self.tolerance_ns_per_m),
            "row": self.row,
            "rows_failed": self.rows_failed,
            "row_pass": plain(self.row_passed),
            "row_margin_ns_per_m": plain(self.row_margin_ns_per_m),
            "row_frequency_hz": plain(self.row_frequency_hz),
            **plain(self.detail),
        }


@dataclass(frozen=True, eq=False, repr=False)
class Certificate(Tabular):
    """Passivity and stability of a gain table: one claim a level, with its worst margin. The levels are never merged.

    Attributes:
        problem: name of the problem.
        requested: whether the infeasible gains of unrealisable rows were judged in place of missing ones.
        frequency_hz: interaction frequencies of the rows, shape (n,).
        rows_without_gains: number of rows without gains; each fails every level.
        levels: results by level.
        passive_limit_n_per_m: 2 b_d/((1 + d) T) at the worst of the ranges: the largest DC stiffness of any passive
            linear rendering; not a number where none is known.
        dc_stiffness_n_per_m: DC stiffness k k_e/(k + k_e) of each row, shape (n,).
        stated: the problem judged against, for ``print``.
        gains: the judged gains.

    Example:
        >>> certificate = avc.certify("soft", avc.solve("soft", "exact"))
        >>> certificate.levels["L5"].passed
        True
    """

    problem: str
    requested: bool
    frequency_hz: FloatArray
    rows_without_gains: int
    levels: dict[Level, LevelResult]
    passive_limit_n_per_m: float
    dc_stiffness_n_per_m: FloatArray
    stated: Problem
    gains: GainSchedule | Coupling

    def to_dict(self) -> Columns:
        """Return the levels as columns, each of shape (levels,)."""
        levels = list(self.levels.values())
        return {
            "level": np.array([found.level for found in levels]),
            "title": np.array([CLAIMS[found.level].title for found in levels]),
            "passed": np.array([found.passed for found in levels]),
            "margin_ns_per_m": np.array([found.margin_ns_per_m for found in levels]),
            "frequency_hz": np.array([found.frequency_hz for found in levels]),
            "model": np.array([found.model for found in levels]),
            "rows_failed": np.array([found.rows_failed for found in levels]),
            "claim": np.array([found.claim for found in levels]),
        }

    def _summary(self) -> str:
        marks = ", ".join(f"{level} {found.word}" for level, found in self.levels.items())
        judged = "requested gains" if self.requested else "gains"
        return f"{self.problem!r}, {judged} of {len(self.frequency_hz)} rows: {marks}"

    def document(self) -> dict[str, Any]:
        """Return the `certify` document: JSON values only."""
        return {
            "problem": self.problem,
            "judged": "requested gains" if self.requested else "gains",
            "frequency_hz": plain(self.frequency_hz),
            "rows_without_gains": self.rows_without_gains,
            "levels": {level: result.document() for level, result in self.levels.items()},
            "passive_limit_n_per_m": plain(self.passive_limit_n_per_m),
            "dc_stiffness_n_per_m": plain(self.dc_stiffness_n_per_m),
        }
