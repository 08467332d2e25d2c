"""Messages: the meaning of a frame's payload. Little-endian; floats are IEEE 754 single precision."""

from __future__ import annotations

import itertools
import struct
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

from avc_hardware.link.device import MODES, Device, DeviceStatus
from avc_hardware.link.faults import INTERFACE_VERSION, Reason, Refusal
from avc_hardware.link.frames import PROTOCOL_VERSION, Frame
from avc_hardware.link.telemetry import Telemetry

REPLY = 0x80
UNITS_SI = 1  # Hz, N.s/m, N/m, N.s/m


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
    LOG = 0xFE
    REFUSED = 0xFF


_GREETING = struct.Struct("<IHH")
_BEGIN = struct.Struct("<IIIHHHH")
_CHUNK = struct.Struct("<III")
_COMMIT = struct.Struct("<III")
_READBACK = struct.Struct("<II")
_SET_GAINS = struct.Struct("<II3fI")
_GAINS_TAKEN = struct.Struct("<II3f")
_RECORDS = struct.Struct("<5Ii")
_TWO = struct.Struct("<II")
_THREE = struct.Struct("<III")
_ONE = struct.Struct("<I")
_LIMITS = struct.Struct("<3f")


@dataclass(frozen=True)
class Acknowledged:
    """BEGIN, CHUNK or ABORT accepted: bytes of the table received in order so far."""

    table_id: int
    received: int


@dataclass(frozen=True)
class Committed:
    """The table runs since tick ``ticks``; it had waited for ``waited`` ticks until the device was out of contact."""

    table_id: int
    ticks: int
    waited: int


@dataclass(frozen=True)
class Readback:
    """A part of the running table."""

    table_id: int
    offset: int
    data: bytes


@dataclass(frozen=True)
class ConfigRead:
    """The configuration in force, its checksum first."""

    data: bytes


@dataclass(frozen=True)
class HeartbeatSeen:
    """The device saw the heartbeat at tick ``ticks``."""

    ticks: int
    mode: str


@dataclass(frozen=True)
class ClearAsked:
    """CLEAR accepted, for the next tick: the faults before it, and the mode."""

    faults: int
    mode: str


@dataclass(frozen=True)
class GainsTaken:
    """SET_GAINS ``number`` is active; with the device's estimate at that tick (NaN at rest)."""

    number: int
    ticks: int
    frequency_hz: float
    lookup_hz: float
    force_n: float


@dataclass(frozen=True)
class Excited:
    """EXCITE or STOP accepted: number and state of the excitation."""

    number: int
    state: int


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


@dataclass(frozen=True)
class LimitsTaken:
    """LIMITS accepted: they hold from the next tick on, a higher force from the next one out of contact."""

    force_n: float
    speed_m_per_s: float
    energy_j: float


@dataclass(frozen=True)
class Subscribed:
    """SUBSCRIBE accepted at tick ``ticks``: a record every so many ticks (0: none)."""

    every: int
    ticks: int


@dataclass(frozen=True)
class Log:
    """A line of text from the firmware."""

    text: str


Message = (
    Refusal
    | Device
    | DeviceStatus
    | Acknowledged
    | Committed
    | Readback
    | ConfigRead
    | HeartbeatSeen
    | ClearAsked
    | GainsTaken
    | Excited
    | Records
    | LimitsTaken
    | Subscribed
    | Telemetry
    | Log
)


def hello(session: int, interface_version: int = INTERFACE_VERSION) -> bytes:
    """Payload of HELLO."""
    return _GREETING.pack(session, interface_version, 0)


def abort(session: int) -> bytes:
    """Payload of ABORT."""
    return _ONE.pack(session)


def begin(session: int, table_id: int, crc32: int, rows: int, states: int = 0) -> bytes:
    """Payload of BEGIN."""
    return _BEGIN.pack(session, table_id, crc32, rows, UNITS_SI, states, 0)


def chunk(session: int, table_id: int, offset: int, data: bytes) -> bytes:
    """Payload of CHUNK."""
    return _CHUNK.pack(session, table_id, offset) + data


def config(session: int, table_id: int, data: bytes) -> bytes:
    """Payload of CONFIG: the configuration that a table brings; an empty one asks for that in force."""
    return _TWO.pack(session, table_id) + data


def commit(session: int, table_id: int, crc32: int) -> bytes:
    """Payload of COMMIT."""
    return _COMMIT.pack(session, table_id, crc32)


def readback(offset: int, count: int) -> bytes:
    """Payload of READBACK."""
    return _READBACK.pack(offset, count)


def heartbeat(ticks: int) -> bytes:
    """Payload of HEARTBEAT: the next one follows within ``ticks`` (0: no supervision)."""
    return _ONE.pack(ticks)


def clear(faults: int) -> bytes:
    """Payload of CLEAR: codes of the faults to clear."""
    return _ONE.pack(faults)


def limits(force_n: float, speed_m_per_s: float, energy_j: float) -> bytes:
    """Payload of LIMITS; 0 stands for the board's own."""
    return _LIMITS.pack(force_n, speed_m_per_s, energy_j)


def subscribe(every: int, ticks: int) -> bytes:
    """Payload of SUBSCRIBE: a record every so many ticks (0: none), for so many ticks unless it is renewed."""
    return _TWO.pack(every, ticks)


def set_gains(coupling_id: int, number: int, ticks: int, b: float, k: float, b_p: float) -> bytes:
    """Payload of SET_GAINS: gains of a coupling whose table the device runs; they hold for ``ticks``."""
    return _SET_GAINS.pack(number, ticks, b, k, b_p, coupling_id)


def records(number: int, first: int) -> bytes:
    """Payload of RECORDS: those of an excitation from an index on."""
    return _TWO.pack(number, first)


def stop(number: int) -> bytes:
    """Payload of STOP."""
    return _ONE.pack(number)


def _records(payload: bytes) -> Records:
    number, state, start_tick, made, first, count = _RECORDS.unpack_from(payload)
    pairs = list(struct.iter_unpack("<hh", payload[_RECORDS.size :]))
    counts = itertools.accumulate((step for step, _ in pairs), initial=count)
    return Records(number, state, start_tick, made, first, tuple(counts)[1:], tuple(unit for _, unit in pairs))


def _readback(payload: bytes) -> Readback:
    table_id, offset = _TWO.unpack_from(payload)
    return Readback(table_id, offset, payload[_TWO.size :])


def _heartbeat(payload: bytes) -> HeartbeatSeen:
    ticks, mode = _TWO.unpack(payload)
    return HeartbeatSeen(ticks, MODES[mode])


def _clear(payload: bytes) -> ClearAsked:
    faults, mode = _TWO.unpack(payload)
    return ClearAsked(faults, MODES[mode])


def _config(payload: bytes) -> ConfigRead | Acknowledged:
    return _acknowledged(payload) if len(payload) == _TWO.size else ConfigRead(payload)


def _acknowledged(payload: bytes) -> Acknowledged:
    return Acknowledged(*_TWO.unpack(payload))


_PARSERS: dict[int, Callable[[bytes], Message]] = {
    Kind.HELLO | REPLY: Device.read,
    Kind.BEGIN | REPLY: _acknowledged,
    Kind.CHUNK | REPLY: _acknowledged,
    Kind.ABORT | REPLY: _acknowledged,
    Kind.COMMIT | REPLY: lambda payload: Committed(*_THREE.unpack(payload)),
    Kind.READBACK | REPLY: _readback,
    Kind.CONFIG | REPLY: _config,
    Kind.STATUS | REPLY: DeviceStatus.read,
    Kind.HEARTBEAT | REPLY: _heartbeat,
    Kind.CLEAR | REPLY: _clear,
    Kind.SET_GAINS | REPLY: lambda payload: GainsTaken(*_GAINS_TAKEN.unpack(payload)),
    Kind.EXCITE | REPLY: lambda payload: Excited(*_TWO.unpack(payload)),
    Kind.STOP | REPLY: lambda payload: Excited(*_TWO.unpack(payload)),
    Kind.RECORDS | REPLY: _records,
    Kind.LIMITS | REPLY: lambda payload: LimitsTaken(*_LIMITS.unpack(payload)),
    Kind.SUBSCRIBE | REPLY: lambda payload: Subscribed(*_TWO.unpack(payload)),
    Kind.TELEMETRY: Telemetry.read,
    Kind.LOG: lambda payload: Log(payload.decode("utf-8", "replace")),
    Kind.REFUSED: Refusal.read,
}


def parse(frame: Frame) -> Message | None:
    """Return the message of a device's frame; None for an unknown one."""
    if frame.version != PROTOCOL_VERSION and frame.type != Kind.REFUSED:
        return Refusal(Reason.VERSION, frame.version)
    try:
        return _PARSERS[frame.type](frame.payload)
    except (KeyError, struct.error, IndexError):
        return None
