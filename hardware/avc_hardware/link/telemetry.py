"""Telemetry: records of a device at its own ticks, and the host's log of them."""

from __future__ import annotations

import csv
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from avc_casadi import InputError
from avc_casadi._util.units import MotionKind, units_for
from avc_hardware.link.device import MODES
from avc_hardware.link.faults import DeviceFault

_HEAD = struct.Struct("<3I")


@dataclass(frozen=True)
class Telemetry:
    """A telemetry message."""

    ticks_between: int  # from one record to the next
    boot_id: int
    coupling_id: str
    records: tuple[tuple[Any, ...], ...]  # values of a `TelemetrySample` down to `has_table`

    @classmethod
    def read(cls, payload: bytes) -> Telemetry:
        """Read the payload of TELEMETRY."""
        ticks_between, boot_id, coupling_id = _HEAD.unpack_from(payload)
        unpacked = struct.iter_unpack("<Ii7fI4B", payload[_HEAD.size :])
        records = tuple((*values[:-4], MODES[values[-4]], *map(bool, values[-3:])) for values in unpacked)
        return cls(ticks_between, boot_id, f"{coupling_id:08x}" if coupling_id else "", records)


@dataclass(frozen=True)
class TelemetrySample:
    """The state of a device at the end of a tick, as sent, with the host's derived values."""

    ticks: int
    encoder_count: int
    velocity_m_per_s: float
    force_n: float
    frequency_hz: float
    damping_ns_per_m: float
    stiffness_n_per_m: float
    contact_damping_ns_per_m: float
    energy_j: float
    faults: int
    mode: str
    streaming: bool
    contact: bool
    has_table: bool
    time_s: float
    position_m: float
    coupling_id: str
    boot_id: int
    lost: int


_COLUMNS: tuple[str, ...] = (
    *("tick", "time_ms", "position_um", "force_N", "velocity_m_per_s", "frequency_hz", "damping_ns_per_m"),
    *("stiffness_n_per_m", "contact_damping_ns_per_m", "energy_j", "mode", "faults", "coupling", "boot", "lost"),
)


@contextmanager
def _written(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError.of(f"cannot be written ({error.strerror}); choose another place", file=str(path)) from error


class TelemetryLog:
    """A CSV file of samples; use as a context manager. A sample is in the file when `write` returns."""

    def __init__(self, path: Path, motion: MotionKind = "linear") -> None:
        """Begin the file, with the columns of a kind of motion."""
        units, columns = units_for(motion), _COLUMNS
        if not units.linear:
            turning = {"position_um": "angle_urad", "force_N": "torque_Nm"}
            columns = tuple(turning.get(name) or units.key(name) for name in _COLUMNS)
        along = columns[2].partition("_")[0]
        self._path = path
        with _written(path):
            self._file = path.open("w", encoding="utf-8", newline="")
            remark = f"a record every few ticks; {columns[3]} positive along +{along}; a lost record is a gap in time"
            self._file.write(f"# avc monitor: {remark}\n{','.join(columns)}\n")

    def write(self, sample: TelemetrySample) -> None:
        """Add a sample."""
        values = (
            *(sample.ticks, 1e3 * sample.time_s, 1e6 * sample.position_m, 0.0 - sample.force_n),
            *(sample.velocity_m_per_s, sample.frequency_hz, sample.damping_ns_per_m, sample.stiffness_n_per_m),
            *(sample.contact_damping_ns_per_m, sample.energy_j, sample.mode, DeviceFault(sample.faults).word),
            *(sample.coupling_id, sample.boot_id, sample.lost),
        )
        with _written(self._path):
            writer = csv.writer(self._file, lineterminator="\n")
            writer.writerow(f"{value:.9g}" if isinstance(value, float) else value for value in values)
            self._file.flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with _written(self._path):
            self._file.close()
