"""Telemetry: records of a device at its own ticks, and the host's log of them."""

from __future__ import annotations

import importlib
import json
import math
import struct
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, Self, TextIO

from avc_casadi import InputError, MissingExtraError
from avc_casadi._util.units import MotionKind, units_for
from avc_hardware.link.device import MODES
from avc_hardware.link.faults import DeviceFault

_HEAD = struct.Struct("<5I")
_RECORD = struct.Struct("<Ii7fI4B")


@dataclass(frozen=True)
class Record:
    """The state of a device at the end of a tick, as sent."""

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


@dataclass(frozen=True)
class Telemetry:
    """A telemetry message."""

    number: int
    dropped: int
    every: int
    boot_id: int
    coupling_id: str
    records: tuple[Record, ...]

    @classmethod
    def read(cls, payload: bytes) -> Telemetry:
        """Read the payload of TELEMETRY."""
        number, dropped, every, boot_id, coupling_id = _HEAD.unpack_from(payload)
        records = []
        for *numbers, mode, streaming, contact, has_table in _RECORD.iter_unpack(payload[_HEAD.size :]):
            flags = (MODES[mode], *map(bool, (streaming, contact, has_table)))
            records.append(Record(*numbers, *flags))
        coupling = f"{coupling_id:08x}" if coupling_id else ""
        return cls(number, dropped, every, boot_id, coupling, tuple(records))


@dataclass(frozen=True)
class TelemetrySample(Record):
    """A record with the host's derived values."""

    time_s: float
    position_m: float
    coupling_id: str
    boot_id: int
    lost: int


class Samples:
    """Converts messages to samples; missing records are detected by the ticks around them."""

    def __init__(self, sample_time_s: float, metres_per_count: float) -> None:
        self._sample_time_s = sample_time_s
        self._metres_per_count = metres_per_count
        self._last: tuple[int, int] | None = None

    def take(self, message: Telemetry) -> list[TelemetrySample]:
        """Return the samples of a message."""
        return [self._sample(message, record) for record in message.records]

    def _sample(self, message: Telemetry, record: Record) -> TelemetrySample:
        ticks, lost = record.ticks, 0
        if self._last is not None and self._last[0] == message.boot_id:
            # Counted in 32 bits; the first record after an expired subscription may come sooner.
            lost = max(((ticks - self._last[1]) & 0xFFFFFFFF) // max(message.every, 1) - 1, 0)
        self._last = (message.boot_id, ticks)
        return TelemetrySample(
            **vars(record),
            time_s=ticks * self._sample_time_s,
            position_m=record.encoder_count * self._metres_per_count,
            coupling_id=message.coupling_id,
            boot_id=message.boot_id,
            lost=lost,
        )


LOG_ENDINGS = (".csv", ".mcap")
"""File endings of logs."""
_COLUMNS = {
    "tick": "integer",
    "time_ms": "number",
    "position_um": "number",
    "force_N": "number",
    "velocity_m_per_s": "number",
    "frequency_hz": "number",
    "damping_ns_per_m": "number",
    "stiffness_n_per_m": "number",
    "contact_damping_ns_per_m": "number",
    "energy_j": "number",
    "mode": "string",
    "faults": "string",
    "coupling": "string",
    "boot": "integer",
    "lost": "integer",
}
# As in `avc excite` for a rotary device.
_ROTARY = {"position_um": "angle_urad", "force_N": "torque_Nm"}


class TelemetryLog(Protocol):
    """A file of samples; use as a context manager."""

    def write(self, sample: TelemetrySample) -> None:
        """Add a sample; it is in the file when this returns, or `InputError` tells that it cannot be written."""
        ...

    def close(self) -> None:
        """End the file; harmless when repeated."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(self, *_: object) -> None: ...


def open_log(path: Path, motion: MotionKind = "linear") -> TelemetryLog:
    """Open a log: ``.csv``, or ``.mcap`` for Foxglove, PlotJuggler and the like (JSON messages on topic ``/avc``)."""
    if path.suffix not in LOG_ENDINGS:
        raise InputError.of(f"allowed: a name that ends in {' or '.join(LOG_ENDINGS)}", file=str(path))
    columns, new = _columns(motion), not path.exists()
    try:
        with _written(path):
            return _Csv(path, columns) if path.suffix == ".csv" else _Mcap(path, columns)
    except InputError:
        if new:  # it would hold nothing
            with suppress(OSError):
                path.unlink()
        raise


@contextmanager
def _written(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError.of(f"cannot be written ({error.strerror}); choose another place", file=str(path)) from error


def _columns(motion: MotionKind) -> dict[str, str]:
    """Return the columns of a kind of motion, each with its kind of value."""
    if motion == "linear":
        return _COLUMNS
    units = units_for(motion)
    return {_ROTARY.get(name) or units.key(name): kind for name, kind in _COLUMNS.items()}


def _row(sample: TelemetrySample, columns: Iterable[str]) -> dict[str, Any]:
    values = (
        sample.ticks,
        1e3 * sample.time_s,
        1e6 * sample.position_m,
        0.0 - sample.force_n,
        sample.velocity_m_per_s,
        sample.frequency_hz,
        sample.damping_ns_per_m,
        sample.stiffness_n_per_m,
        sample.contact_damping_ns_per_m,
        sample.energy_j,
        sample.mode,
        DeviceFault(sample.faults).word,
        sample.coupling_id,
        sample.boot_id,
        sample.lost,
    )
    return dict(zip(columns, values, strict=True))


class _Csv:
    def __init__(self, path: Path, columns: Mapping[str, str]) -> None:
        self._path, self._columns = path, tuple(columns)
        position, force = self._columns[2:4]
        path.write_text(
            f"# avc monitor: at the device's own ticks; {force} along +{position.partition('_')[0]}; a lost record is "
            f"a gap in time\n{','.join(self._columns)}\n",
            encoding="utf-8",
            newline="",
        )
        self._file: TextIO = path.open("a", encoding="utf-8", newline="")

    def write(self, sample: TelemetrySample) -> None:
        with _written(self._path):
            self._file.write(",".join(map(_cell, _row(sample, self._columns).values())) + "\n")
            self._file.flush()

    def close(self) -> None:
        with _written(self._path):
            self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.9g}"
    return f'"{value}"' if "," in str(value) else str(value)


class _Mcap:
    def __init__(self, path: Path, columns: Mapping[str, str]) -> None:
        self._path, self._columns = path, tuple(columns)
        try:
            writer: Any = importlib.import_module("mcap.writer")
        except ImportError as error:
            raise MissingExtraError(
                "a log in MCAP needs the extra 'mcap': pip install 'avc-casadi[mcap]'; or log to .csv"
            ) from error
        self._file = path.open("wb")
        # Without chunks every message is in the file at once; readers then scan a file that was cut off.
        self._writer: Any = writer.Writer(self._file, use_chunking=False)
        self._writer.start(profile="", library="avc-casadi")
        properties = {name: {"type": [kind, "null"]} for name, kind in columns.items()}
        schema = json.dumps({"type": "object", "properties": properties})
        number = self._writer.register_schema("avc.Telemetry", "jsonschema", schema.encode())
        self._channel = self._writer.register_channel("/avc", "json", number)
        self._file.flush()

    def write(self, sample: TelemetrySample) -> None:
        row = {
            name: None if isinstance(value, float) and not math.isfinite(value) else value
            for name, value in _row(sample, self._columns).items()
        }
        time_ns = round(1e9 * sample.time_s)
        data = json.dumps(row).encode()
        with _written(self._path):
            self._writer.add_message(self._channel, time_ns, data, time_ns, sample.ticks & 0xFFFFFFFF)
            self._file.flush()

    def close(self) -> None:
        if not self._file.closed:
            with _written(self._path):
                self._writer.finish()
                self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
