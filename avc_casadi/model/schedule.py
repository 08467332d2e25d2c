"""GainSchedule: the gains at each interaction frequency, with the impedance that they render."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.arrays import BoolArray, ComplexArray, FloatArray
from avc_casadi._util.printed import Columns, Tabular, short

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem, Structure
    from avc_casadi.model.runtime import StateFeedback


class Status(StrEnum):
    """Outcome at one frequency; the last of this list that applies."""

    SOLVED = "solved"
    ACTIVE_BOUND = "active-bound"
    NOT_REALISABLE = "not-realisable"
    INFEASIBLE = "infeasible"
    FAILED = "failed"

    @property
    def has_gains(self) -> bool:
        """Whether the row carries gains that may be used."""
        return self in {Status.SOLVED, Status.ACTIVE_BOUND}


@dataclass(frozen=True, eq=False, repr=False)
class GainSchedule(Tabular):
    """Gains of a coupling against interaction frequency; every array has shape (n,) in the order of ``frequency_hz``.

    Attributes:
        problem: name of the problem.
        method: closed-form, direct, exact, ...
        solver: its name, or None where the method has no solver.
        structure: series or damped.
        model: hold model that the gains were designed for.
        sample_time_s: T.
        frequency_hz: interaction frequencies, Hz.
        damping_ns_per_m: b; not a number where the row has no gains.
        stiffness_n_per_m: k; the same.
        contact_damping_ns_per_m: b_p of the damped structure, otherwise 0.
        impedance: perceived Z_h_avc, N.s/m.
        target: Z_h_ds, N.s/m.
        status: a `Status` for each row.
        reason: a sentence for each row, or empty.
        requested_damping_ns_per_m: requested by an unrealisable row, otherwise equal to the gains.
        requested_stiffness_n_per_m: the same for the stiffness; both infinite for a rigid coupling.
        requested_contact_damping_ns_per_m: the same for the contact damper.
        build_seconds: time to set the method up.
        solve_seconds: time to solve all rows.
        notes: further printed facts, for example a quality statement.
        state_feedback: observer and feedback that belong to the gains; None for gains without.
        stated: the problem given to `solve`, for ``print``; None for gains from elsewhere.

    Example:
        >>> gains = avc.solve("soft", "exact")
        >>> gains.rows, len(gains.stiffness_n_per_m)
        (200, 200)
    """

    problem: str
    method: str
    solver: str | None
    structure: Structure
    model: str
    sample_time_s: float
    frequency_hz: FloatArray
    damping_ns_per_m: FloatArray
    stiffness_n_per_m: FloatArray
    contact_damping_ns_per_m: FloatArray
    impedance: ComplexArray
    target: ComplexArray
    status: tuple[Status, ...]
    reason: tuple[str, ...]
    requested_damping_ns_per_m: FloatArray
    requested_stiffness_n_per_m: FloatArray
    requested_contact_damping_ns_per_m: FloatArray
    build_seconds: float = 0.0
    solve_seconds: float = 0.0
    notes: tuple[str, ...] = ()
    state_feedback: StateFeedback | None = None
    stated: Problem | None = None

    @property
    def rows(self) -> int:
        """Number of frequencies."""
        return len(self.frequency_hz)

    @property
    def usable(self) -> BoolArray:
        """Whether each row carries gains, shape (n,)."""
        return np.array([status.has_gains for status in self.status], dtype=bool)

    @property
    def requested_rigid(self) -> BoolArray:
        """Whether each row requested a rigid coupling, shape (n,): an infinite spring or damper."""
        rigid: BoolArray = np.isinf(self.requested_damping_ns_per_m) | np.isinf(self.requested_stiffness_n_per_m)
        return rigid

    @property
    def magnitude_error(self) -> FloatArray:
        """||Z_h_ds| - |Z_h_avc||, N.s/m: the root of the paper's goal (11)."""
        error: FloatArray = np.abs(np.abs(self.target) - np.abs(self.impedance))
        return error

    @property
    def complex_error(self) -> FloatArray:
        """|Z_h_avc - Z_h_ds|/|Z_h_ds|, relative."""
        with np.errstate(divide="ignore", invalid="ignore"):
            error: FloatArray = np.abs(self.impedance - self.target) / np.abs(self.target)
        return error

    @property
    def real_part(self) -> FloatArray:
        """Re Z_h_avc, N.s/m, which (12) keeps at or above the margin."""
        return np.real(self.impedance)

    def to_dict(self) -> Columns:
        """Return the rows as columns by name with unit, each of shape (n,)."""
        return {
            "frequency_hz": self.frequency_hz,
            "damping_ns_per_m": self.damping_ns_per_m,
            "stiffness_n_per_m": self.stiffness_n_per_m,
            "contact_damping_ns_per_m": self.contact_damping_ns_per_m,
            "impedance_ns_per_m": self.impedance,
            "target_ns_per_m": self.target,
            "magnitude_error_ns_per_m": self.magnitude_error,
            "complex_error": self.complex_error,
            "status": np.array([status.value for status in self.status]),
        }

    def _summary(self) -> str:
        found = ", ".join(f"{count} {status}" for status, count in self.counts().items())
        return (
            f"{self.problem!r} by {self.method}, {self.rows} rows {short(self.frequency_hz, 'Hz')}: {found};\n"
            f"  b {short(self.damping_ns_per_m)}, k {short(self.stiffness_n_per_m)}, "
            f"b_p {short(self.contact_damping_ns_per_m)}"
        )

    def counts(self) -> dict[str, int]:
        """Return how many rows have each status."""
        return dict(Counter(status.value for status in self.status))
