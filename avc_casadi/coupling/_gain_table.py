"""GainTable: the gains that run, one table for certificate, scene and device, with one look-up and one thinning."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._errors import InputError
from avc_casadi.coupling._gains import Gains
from avc_casadi.coupling._interpolation import interpolate
from avc_casadi.support import Columns, Float32Array, FloatArray, Tabular, short

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from avc_casadi.coupling._schedule import GainSchedule

# Rows whose gains are this near to the first's, relative to the largest, are constant gains.
_SAME = 1e-12


@dataclass(frozen=True, eq=False, repr=False)
class GainTable(Tabular):
    """Gains against frequency, linear in ln(frequency) between rows and constant beyond the ends.

    Attributes:
        rows: shape (n, 4): frequency_hz, b (N.s/m), k (N/m), b_p (N.s/m); rising in frequency.
    """

    rows: FloatArray

    @classmethod
    def of(cls, schedule: GainSchedule) -> GainTable:
        """Take every row that carries gains, in the order of frequency.

        Raises:
            InputError: no row carries gains.
        """
        if not schedule.usable.any():
            raise InputError.of(
                f"{schedule.problem} by {schedule.method} has no row with gains; choose another method or widen "
                "[coupling]",
                key="status",
            )
        columns = (
            schedule.frequency_hz,
            schedule.damping_ns_per_m,
            schedule.stiffness_n_per_m,
            schedule.contact_damping_ns_per_m,
        )
        rows = np.stack(columns, axis=1)[schedule.usable]
        return cls(np.asarray(rows[np.argsort(rows[:, 0], kind="stable")]))

    @classmethod
    def constant_gains(cls, gains: Gains, frequency_hz: float = 1.0) -> GainTable:
        """Return the table of gains that do not vary."""
        return cls(np.array([[frequency_hz, *vars(gains).values()]], dtype=np.float64))

    def __len__(self) -> int:
        return len(self.rows)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, GainTable) and np.array_equal(self.rows, other.rows)

    def __hash__(self) -> int:  # type: ignore[override]
        return hash(self.rows.tobytes())

    def to_dict(self) -> Columns:
        """Return the rows as columns by name with unit, each of shape (n,)."""
        names = ("frequency_hz", "damping_ns_per_m", "stiffness_n_per_m", "contact_damping_ns_per_m")
        return dict(zip(names, self.rows.T, strict=True))

    def _summary(self) -> str:
        b, k, contact = self.gains
        spans = f"b {short(b, 'N.s/m')}, k {short(k, 'N/m')}, b_p {short(contact, 'N.s/m')}"
        return f"{len(self)} row{'s' if len(self) > 1 else ''}: {spans}"

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
        """Whether the gains are the same at every frequency, so that nothing needs to follow it."""
        gains = self.rows[:, 1:]
        return bool(np.all(np.abs(gains - gains[0]) <= _SAME * np.abs(gains).max(axis=0)))

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
        """Stiffness of the lowest row, which a mean force keeps while the gains follow another frequency."""
        return self.at_rest.stiffness_n_per_m

    def __call__(self, frequency_hz: ArrayLike) -> FloatArray:
        """Return b, k and b_p at frequencies, shape (3, ...)."""
        return np.moveaxis(interpolate(self.rows, frequency_hz), -1, 0)

    def single(self) -> Float32Array:
        """Return the rows in single precision, as a device holds them."""
        return self.rows.astype(np.float32)

    def expressions(self, frequency_hz: Any) -> list[Any]:
        """Return b, k and b_p as CasADi expressions in the frequency: sums of ramps, one for each interval."""
        import casadi as ca  # noqa: PLC0415

        knots = np.log(self.frequency_hz)
        at = ca.log(ca.fmax(frequency_hz, self.rest_hz))
        values: list[Any] = [float(gain) for gain in self.gains[:, 0]]
        for index, width in enumerate(np.diff(knots)):
            ramp = ca.fmin(ca.fmax(at - knots[index], 0), width)
            for gain, row in enumerate(self.gains):
                slope = (row[index + 1] - row[index]) / width
                if slope != 0:
                    values[gain] += slope * ramp
        return [ca.SX(value) for value in values]
