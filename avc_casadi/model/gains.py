"""The gains of a coupling: the schedule that a method finds, the table that runs, and its thinning."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from avc_casadi._errors import InputError
from avc_casadi._util.arrays import BoolArray, ComplexArray, Float32Array, FloatArray, IndexArray
from avc_casadi._util.printed import Columns, Tabular, short
from avc_casadi.model.device import Device
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
        definition: the problem given to `solve`, for ``print``; None for gains from elsewhere.

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
    definition: Problem | None = None

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
            **{key: getattr(self, key) for key in TABLE_COLUMNS},
            "impedance_ns_per_m": self.impedance,
            "target_ns_per_m": self.target,
            "magnitude_error_ns_per_m": self.magnitude_error,
            "complex_error": self.complex_error,
            "status": np.array([status.value for status in self.status]),
        }

    def _summary(self) -> str:
        statuses = ", ".join(f"{count} {status}" for status, count in self.counts().items())
        return (
            f"{self.problem!r} by {self.method}, {self.rows} rows {short(self.frequency_hz, 'Hz')}: {statuses};\n"
            f"  b {short(self.damping_ns_per_m)}, k {short(self.stiffness_n_per_m)}, "
            f"b_p {short(self.contact_damping_ns_per_m)}"
        )

    def counts(self) -> dict[str, int]:
        """Return how many rows have each status."""
        return dict(Counter(status.value for status in self.status))


Precision = TypeVar("Precision", np.float32, np.float64)


def interpolate(
    rows: NDArray[Precision], frequency_hz: ArrayLike, ln: Callable[[Any], Any] = np.log
) -> NDArray[Precision]:
    """Return gains at frequencies: linear in ln(frequency), hence monotone between rows; constant beyond the ends."""
    wanted_hz = np.asarray(frequency_hz, dtype=rows.dtype)
    row_hz = rows[:, 0]
    gains = rows[:, 1:]
    inside = (wanted_hz > row_hz[0]) & (wanted_hz < row_hz[-1])
    safe = np.where(inside, wanted_hz, row_hz[0])
    low = np.clip(np.searchsorted(row_hz, safe, side="right") - 1, 0, max(len(rows) - 2, 0))
    high = np.minimum(low + 1, len(rows) - 1)
    base = ln(row_hz[low])
    span = ln(row_hz[high]) - base
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (ln(safe) - base) / span
    share = np.where((share >= 0) & (share <= 1), share, rows.dtype.type(0))[..., None]
    between = gains[low] + share * (gains[high] - gains[low])
    ends = np.where((wanted_hz >= row_hz[-1])[..., None], gains[-1], gains[0])
    return np.asarray(np.where(inside[..., None], between, ends))


@dataclass(frozen=True)
class DeviceLn:
    """Natural logarithm of normal positive numbers as a device computes it, operation by operation."""

    dtype: type[Any]
    bits: type[Any]
    mantissa_bits: int
    terms: int

    @property
    def coefficients(self) -> list[float]:
        """1/(2 j + 1), the smallest first."""
        return [1.0 / (2 * j + 1) for j in reversed(range(self.terms))]

    def __call__(self, x: ArrayLike) -> Any:
        """Return ln x, any shape, in this precision: e ln 2 + 2 (s + s^3/3 + ...), x = 2^e m, s = (m - 1)/(m + 1)."""
        number, whole = self.dtype, self.bits
        bits = np.asarray(x, dtype=number).view(whole)
        unit = number(1)
        fraction = whole((1 << self.mantissa_bits) - 1)
        above_one = bits >> whole(self.mantissa_bits)
        bias = np.asarray(unit).view(whole) >> whole(self.mantissa_bits)
        exponent = above_one.astype(np.int32) - np.int32(bias)
        m = ((bits & fraction) | np.asarray(unit).view(whole)).view(number)
        large = m > number(np.sqrt(2.0))
        m = np.where(large, m * number(0.5), m)
        exponent = exponent + large
        s = (m - unit) / (m + unit)
        z = s * s
        first, *rest = self.coefficients
        series = np.full_like(z, first)
        for coefficient in rest:
            series = series * z + number(coefficient)
        return exponent.astype(number) * number(np.log(2.0)) + (s + s) * series


single_ln = DeviceLn(np.float32, np.uint32, 23, 5)
double_ln = DeviceLn(np.float64, np.uint64, 52, 12)


@dataclass(frozen=True)
class Gains:
    """Constant gains of the coupling; an infinite damping or stiffness joins device and environment rigidly."""

    damping_ns_per_m: float
    stiffness_n_per_m: float
    contact_damping_ns_per_m: float = 0.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not value >= 0 or (name == "contact_damping_ns_per_m" and math.isinf(value)):
                raise InputError.of(f"is {value}; allowed: 0 or more", file="gains", key=name)

    @property
    def rigid(self) -> bool:
        """Whether device and environment are joined rigidly."""
        return math.isinf(self.damping_ns_per_m) or math.isinf(self.stiffness_n_per_m)


NO_COUPLING = Gains(math.inf, math.inf)


NEAR_RIGID_N_PER_M = 1e8
"""Spring at the handle, N/m, that no hand tells from a rigid joint."""
CONSTANT_TOLERANCE = 1e-12
"""Share of the largest gain by which the rows of a constant table may differ: rounding."""


def near_rigid_n_per_m(device: Device) -> float:
    """Return a spring imperceptibly different from a rigid joint, within single precision of a device."""
    return NEAR_RIGID_N_PER_M * device.metres_per_unit**2


def spring_before(problem: Problem, rendered_n_per_m: float) -> float:
    """Return the spring, N/m, that gives a wall a static stiffness in series; nearly rigid for a softer wall."""
    wall, rigid = problem.environment.stiffness_n_per_m, near_rigid_n_per_m(problem.device)
    if rendered_n_per_m >= wall:
        return rigid
    return min(rendered_n_per_m * wall / (wall - rendered_n_per_m), rigid)


def missing_rest_gains(schedule: GainSchedule) -> str:
    """Return a message if a schedule has no gains at its lowest frequency, which is read at rest; else empty."""
    row = int(schedule.frequency_hz.argmin())
    if schedule.status[row].has_gains:
        return ""
    where = f"no gains at {schedule.frequency_hz[row]:g} Hz, where a hand at rest begins ({schedule.status[row]})."
    return f"{where} {schedule.reason[row]} Choose another method, or gains that are stable at the lowest frequency."


def gains_at(schedule: GainSchedule, frequency_hz: float | None = None) -> Gains:
    """Return the gains of a table at one interaction frequency."""
    grid = schedule.frequency_hz
    frequency = float(grid.min()) if frequency_hz is None else frequency_hz
    low, high = np.searchsorted(grid, frequency, "right") - 1, np.searchsorted(grid, frequency)
    fault = ""
    if not grid.min() <= frequency <= grid.max():
        fault = f"is {frequency:g} Hz; allowed: {grid.min():g} to {grid.max():g} Hz, the frequencies of the gain table"
    elif not schedule.usable[low : high + 1].all():
        fault = f"has no gains at {frequency:g} Hz; choose another method or another interaction frequency"
    if fault:
        raise InputError.of(fault, file=schedule.problem, key="frequency_hz")
    return Gains(*GainTable.of(schedule)(frequency).tolist())


TABLE_COLUMNS = ("frequency_hz", "damping_ns_per_m", "stiffness_n_per_m", "contact_damping_ns_per_m")


@dataclass(frozen=True, eq=False, repr=False)
class GainTable(Tabular):
    """Gains against frequency, linear in ln(frequency) between rows and constant beyond the ends."""

    rows: FloatArray

    @classmethod
    def of(cls, schedule: GainSchedule) -> GainTable:
        """Return the table of all rows with gains, in the order of frequency."""
        if not schedule.usable.any():
            fault = f"{schedule.problem} by {schedule.method} has no row with gains"
            raise InputError.of(f"{fault}; choose another method or widen [coupling]", key="status")
        rows = np.stack([getattr(schedule, key) for key in TABLE_COLUMNS], axis=1)[schedule.usable]
        return cls(np.asarray(rows[np.argsort(rows[:, 0], kind="stable")]))

    @classmethod
    def constant_gains(cls, gains: Gains, frequency_hz: float = 1.0) -> GainTable:
        """Return the table of gains that do not vary."""
        row = [frequency_hz, gains.damping_ns_per_m, gains.stiffness_n_per_m, gains.contact_damping_ns_per_m]
        return cls(np.array([row], dtype=np.float64))

    def __len__(self) -> int:
        return len(self.rows)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, GainTable) and np.array_equal(self.rows, other.rows)

    def __hash__(self) -> int:
        return hash(self.rows.tobytes())

    def to_dict(self) -> Columns:
        """Return the rows as columns by name with unit, each of shape (n,)."""
        return dict(zip(TABLE_COLUMNS, self.rows.T, strict=True))

    def _summary(self) -> str:
        b, k, contact = self.gains
        return f"{len(self)} row{'s' if len(self) > 1 else ''}: b {short(b)}, k {short(k)}, b_p {short(contact)}"

    @property
    def frequency_hz(self) -> FloatArray:
        """Frequencies of the rows, (n,)."""
        return self.rows[:, 0]

    @property
    def gains(self) -> FloatArray:
        """b, k and b_p of the rows, (3, n)."""
        return self.rows[:, 1:].T

    @property
    def constant(self) -> bool:
        """Whether the gains are the same but for rounding at every frequency, so that no estimator is needed."""
        gains = self.rows[:, 1:]
        rounding = CONSTANT_TOLERANCE * np.abs(gains).max(axis=0)
        return len(gains) == 1 or bool(np.all(np.abs(gains - gains[0]) <= rounding))

    @property
    def rest_hz(self) -> float:
        """Frequency of the row for a device at rest: the lowest."""
        return float(self.rows[0, 0])

    @property
    def at_rest(self) -> Gains:
        """Gains of a device at rest: those of the lowest row."""
        return Gains(*self.rows[0, 1:].tolist())

    @property
    def rest_stiffness_n_per_m(self) -> float:
        """Stiffness of the lowest row, which applies to a mean force while the gains follow another frequency."""
        return self.at_rest.stiffness_n_per_m

    def __call__(self, frequency_hz: ArrayLike) -> FloatArray:
        """Return b, k and b_p at frequencies, shape (3, ...)."""
        return np.moveaxis(interpolate(self.rows, frequency_hz), -1, 0)

    def single(self) -> Float32Array:
        """Return the rows in single precision, as stored on a device; their frequencies must rise there too."""
        rows = self.rows.astype(np.float32)
        twice = rows[1:, 0][np.diff(rows[:, 0]) <= 0]
        if len(twice):
            fault = f"has rows at {twice[0]:g} Hz that are equal in the device's single precision"
            raise InputError.of(f"{fault}; allowed: frequencies that differ by 1e-7 or more", key="frequency_hz")
        return rows

    def expressions(self, frequency_hz: Any) -> list[Any]:
        """Return b, k and b_p as CasADi expressions in the frequency: sums of ramps, one for each interval."""
        import casadi as ca  # noqa: PLC0415

        knots = np.log(self.frequency_hz)
        ln_frequency = ca.log(ca.fmax(frequency_hz, self.rest_hz))
        values: list[Any] = [float(gain) for gain in self.gains[:, 0]]
        for index, width in enumerate(np.diff(knots)):
            ramp = ca.fmin(ca.fmax(ln_frequency - knots[index], 0), width)
            for gain, row in enumerate(self.gains):
                slope = (row[index + 1] - row[index]) / width
                if slope != 0:
                    values[gain] += slope * ramp
        return [ca.SX(value) for value in values]


def fewest_rows(table: FloatArray, tolerance: float) -> IndexArray:
    """Return the indices of the fewest rows of a table whose interpolation keeps all other rows within a tolerance.

    Args:
        table: per row the frequency, Hz, above 0 and ascending, then the gains, which are linear in ln(frequency).
        tolerance: the largest deviation as a share of the gain; of a gain of 0, as a share of the column's largest.
    """
    # A line from a row is within tolerance while its slope lies in the interval of each row between: a narrowing cone.
    ln_frequency, gains = np.log(table[:, 0]), table[:, 1:]
    size = np.where(gains == 0, np.maximum(gains.max(axis=0), 1.0), gains)
    room = tolerance * size
    count = len(gains)
    steps = np.full(count, count)
    steps[0] = 0
    came = np.zeros(count, dtype=np.intp)
    fewest = at_once = 64
    for first in range(count - 1):
        low = np.full((1, gains.shape[1]), -np.inf)
        high = np.full((1, gains.shape[1]), np.inf)
        start = first + 1
        while start < count and bool((low <= high).all()):
            block = slice(start, start + at_once)
            away = (ln_frequency[block] - ln_frequency[first])[:, None]
            lows = np.maximum.accumulate(np.vstack([low, (gains[block] - room[block] - gains[first]) / away]))
            highs = np.minimum.accumulate(np.vstack([high, (gains[block] + room[block] - gains[first]) / away]))
            slope = (gains[block] - gains[first]) / away
            met = np.all((lows[:-1] <= slope) & (slope <= highs[:-1]), axis=1)
            last = start + np.flatnonzero(met & (steps[block] > steps[first] + 1))
            steps[last] = steps[first] + 1
            came[last] = first
            low = lows[-1:]
            high = highs[-1:]
            start += at_once
        # The next cone ends about where this one did.
        at_once = max(fewest, start - at_once - first + int(np.count_nonzero((lows <= highs).all(axis=1))))
    path = [count - 1]
    while path[-1]:
        path.append(int(came[path[-1]]))
    return np.array(path[::-1], dtype=np.intp)
