"""GainSchedule: the gains chosen at each interaction frequency, with what they achieve there."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.coupling._felt import felt_impedance
from avc_casadi.loop import loop_at
from avc_casadi.support import BoolArray, Columns, ComplexArray, FloatArray, Tabular, short

if TYPE_CHECKING:
    from avc_casadi.problem import Problem, Structure
    from avc_casadi.runtime import StateFeedback


class Status(StrEnum):
    """What became of one frequency; where several hold, the last of this list."""

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
    """Gains against interaction frequency; every array has shape (n,) in the order of ``frequency_hz``.

    Attributes:
        problem: name of the problem.
        method: closed-form, direct, exact, ...
        solver: what solved it, or None where the method has no solver.
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
        reason: a sentence for each row, empty where there is nothing to say.
        requested_damping_ns_per_m: what an unrealisable row asked for, otherwise equal to the gains.
        requested_stiffness_n_per_m: the same for the stiffness; both infinite for a rigid coupling.
        requested_contact_damping_ns_per_m: the same for the contact damper.
        build_seconds: time to set the method up.
        solve_seconds: time to solve all rows.
        notes: further facts for people, for example a quality statement.
        state_feedback: observer and feedback without which the gains mean nothing; None for gains that stand alone.

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
    build_seconds: float = field(default=0.0, compare=False)
    solve_seconds: float = field(default=0.0, compare=False)
    notes: tuple[str, ...] = ()
    state_feedback: StateFeedback | None = None

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
        """Whether each row asked for a rigid coupling, shape (n,): an infinite spring or damper."""
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
        """Re Z_h_avc, N.s/m: what (12) keeps at or above the margin."""
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
            f"  b {short(self.damping_ns_per_m, 'N.s/m')}, k {short(self.stiffness_n_per_m, 'N/m')}, "
            f"b_p {short(self.contact_damping_ns_per_m, 'N.s/m')}"
        )

    def counts(self) -> dict[str, int]:
        """Return how many rows have each status."""
        return dict(Counter(status.value for status in self.status))


def gain_schedule(
    problem: Problem,
    method: str,
    gains: tuple[FloatArray, FloatArray, FloatArray],
    status: tuple[Status, ...],
    *,
    solver: str | None = None,
    reason: tuple[str, ...] | None = None,
    requested: tuple[FloatArray, FloatArray] | None = None,
    requested_contact: FloatArray | None = None,
    impedance: ComplexArray | None = None,
    frequency_hz: FloatArray | None = None,
    build_seconds: float = 0.0,
    solve_seconds: float = 0.0,
    notes: tuple[str, ...] = (),
    state_feedback: StateFeedback | None = None,
) -> GainSchedule:
    """Complete gains (b, k, b_p) into a schedule; one code recomputes the impedances of every method.

    Args:
        problem: the problem that the gains answer.
        method: name of the method.
        gains: b (N.s/m), k (N/m), b_p (N.s/m), each of shape (n,).
        status: one for each row; gains of rows without usable gains are blanked.
        solver: name of the solver.
        reason: one sentence for each row.
        requested: b and k that an unrealisable row asked for.
        requested_contact: b_p that it asked for.
        impedance: perceived impedance where it is not that of the gains (the closed form's projection).
        frequency_hz: frequencies of the rows; None is those of the problem.
        build_seconds: time to set the method up.
        solve_seconds: time to solve.
        notes: facts for people.
        state_feedback: observer and feedback that belong to the gains.
    """
    frequency = problem.frequencies_hz() if frequency_hz is None else frequency_hz
    loop = loop_at(problem, frequency)
    usable = np.array([item.has_gains for item in status], dtype=bool)
    b, k, bp = (np.where(usable, np.asarray(gain, dtype=np.float64), np.nan) for gain in gains)
    perceived = np.full(frequency.shape, np.nan, dtype=np.complex128)
    if usable.any():
        perceived[usable] = felt_impedance(
            problem, frequency[usable], (b[usable], k[usable], bp[usable]), state_feedback
        )
    return GainSchedule(
        problem=problem.name,
        method=method,
        solver=solver,
        structure=problem.coupling.structure,
        model=problem.stability.model,
        sample_time_s=problem.device.sample_time_s,
        frequency_hz=frequency,
        damping_ns_per_m=b,
        stiffness_n_per_m=k,
        contact_damping_ns_per_m=bp,
        impedance=perceived if impedance is None else impedance,
        target=np.asarray(loop.target),
        status=status,
        reason=reason or ("",) * len(status),
        requested_damping_ns_per_m=b if requested is None else requested[0],
        requested_stiffness_n_per_m=k if requested is None else requested[1],
        requested_contact_damping_ns_per_m=bp if requested_contact is None else requested_contact,
        build_seconds=build_seconds,
        solve_seconds=solve_seconds,
        notes=notes,
        state_feedback=state_feedback,
    )
