"""GainTable: a gain schedule as the device holds it, single precision, with what that did to the numbers."""

from __future__ import annotations

import hashlib
import struct
import zlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from avc_casadi import InputError
from avc_casadi.coupling import (
    GainSchedule,
)
from avc_casadi.support import Float32Array, FloatArray

FLAG_DAMPED = 1
FLAG_WALL = 2
FLAG_GUARD = 4
HEADER = struct.Struct("<HH5fII")
ROW_BYTES = 16
_COLUMNS = ("frequency_hz", "damping_ns_per_m", "stiffness_n_per_m", "contact_damping_ns_per_m")


@dataclass(frozen=True)
class Wall:
    """The one-sided wall at position 0 that the device renders behind the coupling."""

    damping_ns_per_m: float
    stiffness_n_per_m: float


@dataclass(frozen=True)
class TableSettings:
    """What travels with the rows.

    Attributes:
        wall: None leaves the wall that the device has.
        safe_damping_ns_per_m: b after a lost heartbeat.
        safe_stiffness_n_per_m: k after a lost heartbeat; 0 means no force.
        guard: whether the firmware's passivity controller watches the energy.
    """

    wall: Wall | None = None
    safe_damping_ns_per_m: float = 0.0
    safe_stiffness_n_per_m: float = 0.0
    guard: bool = False


@dataclass(frozen=True)
class GainTable:
    """A table ready to be sent.

    Attributes:
        rows: single precision, shape (n, 4): frequency_hz, b, k, b_p; rising in frequency.
        sample_time_s: that the gains were designed for.
        settings: wall, safe gains, guard.
        damped: whether b_p is in use.
        left_out: rows of the schedule without usable gains.
        reduced_from: usable rows before the table was cut to the device's capacity.
        reduction_error: largest relative error of b, k or b_p that the cut adds, at the dropped rows; 0 without a cut.
        rounding_max: largest relative change of a gain by rounding to single precision.
    """

    rows: Float32Array
    sample_time_s: float
    settings: TableSettings
    damped: bool
    left_out: int
    reduced_from: int
    reduction_error: float
    rounding_max: float

    @property
    def image(self) -> bytes:
        """The bytes that travel, that are checked, and that are read back."""
        settings = self.settings
        wall = settings.wall or Wall(0.0, 0.0)
        flags = FLAG_DAMPED * self.damped | FLAG_WALL * (settings.wall is not None) | FLAG_GUARD * settings.guard
        header = HEADER.pack(
            len(self.rows),
            flags,
            self.sample_time_s,
            wall.damping_ns_per_m,
            wall.stiffness_n_per_m,
            settings.safe_damping_ns_per_m,
            settings.safe_stiffness_n_per_m,
            0,
            0,
        )
        return header + self.rows.astype("<f4").tobytes()

    @property
    def crc32(self) -> int:
        """Checksum of the image, as `zlib.crc32`."""
        return zlib.crc32(self.image)

    @property
    def table_id(self) -> int:
        """Name of the table, from its content: the same table has the same name."""
        return int.from_bytes(hashlib.sha256(self.image).digest()[:4], "little") or 1


def gain_table(
    gains: GainSchedule,
    *,
    settings: TableSettings | None = None,
    capacity_rows: int | None = None,
    sample_time_s: float | None = None,
) -> GainTable:
    """Turn a schedule into the table that travels: usable rows, sorted, in single precision, cut to the capacity.

    Args:
        gains: rows without gains are left out and counted.
        settings: wall, safe gains and guard; default `TableSettings`.
        capacity_rows: of the device.
        sample_time_s: for schedules that do not know theirs (bare CSV files).

    Raises:
        InputError: no usable row, a repeated frequency, or a number that single precision cannot hold.
    """
    usable = gains.usable
    if not usable.any():
        counts = ", ".join(f"{n} {status}" for status, n in gains.counts().items())
        advice = "" if gains.method == "direct" else "solve with --method direct, "
        raise InputError.of(
            f"none of the {gains.rows} rows of {gains.problem} has gains that can be used "
            f"({counts}); {advice}widen the gain box or add device damping",
            key="status",
        )
    columns = [np.asarray(getattr(gains, name), dtype=np.float64)[usable] for name in _COLUMNS]
    wide = np.stack(columns, axis=1)
    wide = wide[np.argsort(wide[:, 0], kind="stable")]
    with np.errstate(over="ignore", under="ignore"):
        rows = wide.astype(np.float32)
    if not np.isfinite(rows).all():
        raise InputError.of("holds a gain that single precision cannot carry; allowed: below 3.4e38", key="gains")
    repeated = np.flatnonzero(np.diff(rows[:, 0]) <= 0)
    if len(repeated):
        raise InputError.of(
            f"two rows have the frequency {rows[repeated[0], 0]:.7g} Hz (single precision); allowed: each once",
            key="frequency_hz",
        )
    keep = _most_telling_rows(wide, capacity_rows or len(wide))
    time = gains.sample_time_s if np.isfinite(gains.sample_time_s) else sample_time_s
    if time is None:
        raise InputError.of("the schedule knows no sample time; give sample_time_s", key="sample_time_s")
    return GainTable(
        rows=rows[keep],
        sample_time_s=time,
        settings=settings or TableSettings(),
        damped=gains.structure == "damped",
        left_out=int(np.count_nonzero(~usable)),
        reduced_from=len(wide),
        reduction_error=float(_interpolation_error(wide, keep).max(initial=0.0)),
        rounding_max=_rounding(wide[:, 1:], rows[:, 1:]),
    )


def _rounding(wide: FloatArray, narrow: Float32Array) -> float:
    scale = np.where(wide == 0, 1.0, np.abs(wide))
    return float((np.abs(narrow.astype(np.float64) - wide) / scale).max())


def _interpolation_error(wide: FloatArray, keep: NDArray[np.intp]) -> FloatArray:
    """Relative error of each row when only the kept rows are interpolated in ln(frequency), shape (n,)."""
    ln_frequency = np.log(wide[:, 0])
    worst = np.zeros(len(wide))
    for column in wide[:, 1:].T:
        guess = np.interp(ln_frequency, ln_frequency[keep], column[keep])
        worst = np.maximum(
            worst, np.abs(guess - column) / np.where(column == 0, max(column.max(), 1.0), np.abs(column))
        )
    return worst


def _most_telling_rows(wide: FloatArray, capacity: int) -> NDArray[np.intp]:
    """Choose rows: the ends, then always the one that the table so far misses most."""
    if capacity >= len(wide):
        return np.arange(len(wide))
    chosen = [0, len(wide) - 1][: max(capacity, 1)]
    while len(chosen) < capacity:
        error = _interpolation_error(wide, np.array(sorted(chosen)))
        error[chosen] = -1.0
        chosen.append(int(error.argmax()))
    return np.array(sorted(chosen))
