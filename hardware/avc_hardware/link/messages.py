"""Messages: the meaning of a frame's payload. Little-endian; floats are IEEE 754 single precision."""

from __future__ import annotations

import itertools
import struct
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

from avc_hardware.link.device import Device, DeviceStatus
from avc_hardware.link.faults import Refusal, RefusalReason
from avc_hardware.link.frames import PROTOCOL_VERSION, Frame
from avc_hardware.link.telemetry import Telemetry

REPLY = 0x80


class Kind(IntEnum):
    """Type of a message; its answer carries the same with bit 7 set."""

    HELLO = 0x01
    BEGIN = 0x02
    CHUNK = 0x03
    COMMIT = 0x04
    READBACK = 0x05
    STATUS = 0x06
    HEARTBEAT = 0x07
    SET_GAINS = 0x08
    ABORT = 0x09
    EXCITE = 0x0A
    RECORDS = 0x0B
    STOP = 0x0C
    CLEAR = 0x0D
    SUBSCRIBE = 0x0E
    LIMITS = 0x11
    CONFIG = 0x12
    TELEMETRY = 0xFD
    REFUSED = 0xFF


_RECORDS = struct.Struct("<5Ii")
_WORDS = 8  # bytes of two


@dataclass(frozen=True)
class Acknowledged:
    """Accepted, with two numbers: of a transfer its table and the bytes received in order so far."""

    number: int
    value: int


@dataclass(frozen=True)
class Committed:
    """The table runs since tick ``ticks``; it had waited for ``waited`` ticks until the device was out of contact."""

    table_id: int
    ticks: int
    waited: int


@dataclass(frozen=True)
class Readback:
    """A part of the running table."""

    data: bytes


@dataclass(frozen=True)
class ConfigRead:
    """The configuration in force, its checksum first."""

    data: bytes


@dataclass(frozen=True)
class GainsTaken:
    """SET_GAINS ``number`` is active; with the device's estimate at that tick (NaN at rest)."""

    number: int
    ticks: int
    frequency_hz: float
    lookup_hz: float
    force_n: float


@dataclass(frozen=True)
class Records:
    """A part of the records of an excitation."""

    number: int
    state: int
    start_tick: int
    made: int
    first: int
    counts: tuple[int, ...]
    units: tuple[int, ...]

    @classmethod
    def read(cls, payload: bytes) -> Records:
        """Read the payload of the answer to RECORDS."""
        number, state, start_tick, made, first, count = _RECORDS.unpack_from(payload)
        pairs = list(struct.iter_unpack("<hh", payload[_RECORDS.size :]))
        counts = tuple(itertools.accumulate((step for step, _ in pairs), initial=count))
        return cls(number, state, start_tick, made, first, counts[1:], tuple(unit for _, unit in pairs))


Message = (
    Refusal
    | Device
    | DeviceStatus
    | Acknowledged
    | Committed
    | Readback
    | ConfigRead
    | GainsTaken
    | Records
    | Telemetry
)


def words(*values: int) -> bytes:
    """Return the payload of whole numbers, in 32 bits each."""
    return struct.pack(f"<{len(values)}I", *values)


def begin(session: int, table_id: int, crc32: int, rows: int, states: int = 0) -> bytes:
    """Payload of BEGIN."""
    return struct.pack("<IIIHH", session, table_id, crc32, rows, states)


def set_gains(coupling_id: int, number: int, ticks: int, b: float, k: float, b_p: float) -> bytes:
    """Payload of SET_GAINS: gains of a coupling whose table the device runs; they hold for ``ticks``."""
    return struct.pack("<II3fI", number, ticks, b, k, b_p, coupling_id)


def _acknowledged(payload: bytes) -> Acknowledged:
    return Acknowledged(*struct.unpack("<II", payload))


_PLAIN = (Kind.BEGIN, Kind.CHUNK, Kind.ABORT, Kind.HEARTBEAT, Kind.CLEAR, Kind.EXCITE, Kind.STOP, Kind.LIMITS)
_PARSERS: dict[int, Callable[[bytes], Message]] = {
    **{kind | REPLY: _acknowledged for kind in (*_PLAIN, Kind.SUBSCRIBE)},
    Kind.HELLO | REPLY: Device.read,
    Kind.COMMIT | REPLY: lambda payload: Committed(*struct.unpack("<III", payload)),
    Kind.READBACK | REPLY: lambda payload: Readback(payload[_WORDS:]),
    Kind.CONFIG | REPLY: lambda payload: _acknowledged(payload) if len(payload) == _WORDS else ConfigRead(payload),
    Kind.STATUS | REPLY: DeviceStatus.read,
    Kind.SET_GAINS | REPLY: lambda payload: GainsTaken(*struct.unpack("<II3f", payload)),
    Kind.RECORDS | REPLY: Records.read,
    Kind.TELEMETRY: Telemetry.read,
    Kind.REFUSED: Refusal.read,
}


def parse(frame: Frame) -> Message | None:
    """Return the message of a device's frame; None for an unknown one."""
    if frame.version != PROTOCOL_VERSION and frame.type != Kind.REFUSED:
        return Refusal(RefusalReason.VERSION, frame.version)
    try:
        return _PARSERS[frame.type](frame.payload)
    except (KeyError, struct.error, IndexError):
        return None
