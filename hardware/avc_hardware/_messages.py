"""Messages: what a frame's payload means. Little-endian; floats are IEEE 754 single precision."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from avc_hardware._figures import ESTIMATOR_NUMBERS, RuntimeFigures
from avc_hardware._frames import PROTOCOL_VERSION, Frame

INTERFACE_VERSION = 4
REPLY = 0x80
UNITS_SI = 1  # Hz, N.s/m, N/m, N.s/m


class Kind(IntEnum):
    """Type of a message; the answer to each carries the same with bit 7 set."""

    HELLO = 0x01
    BEGIN = 0x02
    CHUNK = 0x03
    COMMIT = 0x04
    READBACK = 0x05
    STATUS = 0x06
    HEARTBEAT = 0x07
    SET_GAINS = 0x08
    ABORT = 0x09
    LOG = 0xFE
    REFUSED = 0xFF


class Reason(IntEnum):
    """Why the device refuses."""

    VERSION = 1
    MESSAGE = 2
    SIZE = 3
    BUSY = 4
    NO_TRANSFER = 5
    OFFSET = 6
    CRC = 7
    ROWS = 8
    NOT_FINITE = 9
    NOT_MONOTONIC = 10
    LIMIT = 11
    SAMPLE_TIME = 12
    STALE = 13
    NO_TABLE = 14
    INTERFACE = 15
    STATES = 16


_SENTENCES = {
    Reason.VERSION: "the firmware speaks protocol {detail}, this program {own}; bring both to the same release",
    Reason.MESSAGE: "the firmware does not know message or unit {detail}; update the firmware",
    Reason.SIZE: "a message or the table has a wrong size (the device counts {detail})",
    Reason.BUSY: "another host is sending a table (session {detail:#010x}); wait until it has ended",
    Reason.NO_TRANSFER: "the device knows of no transfer; it may have been reset",
    Reason.OFFSET: "a part of the table was lost before byte {detail}",
    Reason.CRC: "the checksum of the table is wrong",
    Reason.ROWS: "the table has too many rows or none; allowed: 1 to {detail}",
    Reason.NOT_FINITE: "{row} holds a number that is not finite",
    Reason.NOT_MONOTONIC: "{row} does not rise in frequency; sort the table and drop repeated frequencies",
    Reason.LIMIT: "{row} is outside the device's limits",
    Reason.SAMPLE_TIME: "the table was designed for another sample time than the device's",
    Reason.STALE: "gains with a number not above {detail} came late",
    Reason.INTERFACE: "the firmware has interface version {detail}, this program {interface}; use one release for both",
    Reason.NO_TABLE: "the device holds no table yet; push one first",
    Reason.STATES: "the table feeds back too many states; allowed: at most {detail}, beside a single row of gains",
}
_PLACES = {0xFFFF: "the table's header", 0xFFFE: "the state feedback"}


@dataclass(frozen=True)
class Refusal:
    """A REFUSED answer."""

    reason: Reason | int
    detail: int

    def __str__(self) -> str:
        if not isinstance(self.reason, Reason):
            return f"for a reason unknown to this program (code {self.reason}, {self.detail}); update avc-casadi"
        return _SENTENCES[self.reason].format(
            detail=self.detail,
            row=_PLACES.get(self.detail, f"row {self.detail}"),
            own=PROTOCOL_VERSION,
            interface=INTERFACE_VERSION,
        )


@dataclass(frozen=True)
class Device:
    """What HELLO answers.

    Attributes:
        interface_version: of the messages' meaning; must equal this program's.
        capacity_rows: rows that a table may have.
        window_bytes: bytes that may be on the way unanswered.
        chunk_bytes: largest part of a table in one message.
        build: name of the firmware's sources.
        serial: number of the device, 0 where it has none.
        boot_id: changes when the device starts anew.
        sample_time_s: of the control loop.
        metres_per_count: of the encoder.
        max_force_n: limit of the output.
        max_damping_ns_per_m: limit of b.
        max_stiffness_n_per_m: limit of k.
        max_contact_damping_ns_per_m: limit of b_p.
        table_id: of the running table, 0 without one.
        table_crc32: of the running table.
        table_rows: of the running table.
        transfer_open: whether some host is sending a table.
        figures: what its control tick was generated for.
        capacity_states: states that a table may feed back.
        table_states: that the running table feeds back.
    """

    interface_version: int
    capacity_rows: int
    window_bytes: int
    chunk_bytes: int
    build: str
    serial: int
    boot_id: int
    sample_time_s: float
    metres_per_count: float
    max_force_n: float
    max_damping_ns_per_m: float
    max_stiffness_n_per_m: float
    max_contact_damping_ns_per_m: float
    table_id: int
    table_crc32: int
    table_rows: int
    transfer_open: bool
    figures: RuntimeFigures
    capacity_states: int
    table_states: int


@dataclass(frozen=True)
class DeviceStatus:
    """One STATUS sample; ``frequency_hz`` is not a number at rest.

    Attributes:
        ticks: control ticks since the start.
        overruns: ticks that came due before the one before had ended.
        frequency_hz: estimate of the interaction frequency.
        lookup_hz: where the table is read: the estimate, held a while when it is lost, then falling to the lowest row.
        damping_ns_per_m: b in force.
        stiffness_n_per_m: k in force.
        contact_damping_ns_per_m: b_p in force.
        force_n: last output, positive out of the wall.
        position_m: positive into the wall.
        velocity_m_per_s: backward difference.
        energy_j: that the hand has given (positive) since the start: sum of the held force times the next displacement.
        encoder_count: raw position.
        table_id: of the running table.
        table_crc32: of the running table.
        coupling_id: of the running coupling, 8 hexadecimal digits; empty without one.
        frames_good: received.
        frames_bad: received with an error and dropped.
        bytes_lost: by the receiver.
        saturated: ticks at the force limit.
        not_finite: ticks whose force was not a number and was set to 0.
        heartbeats_missed: times that the host fell silent.
        swaps: tables taken over.
        stream_number: of the last SET_GAINS taken.
        stream_stale: SET_GAINS refused because a newer one was there.
        stream_missing: numbers that never came.
        stream_expired: times that the device went back to its table.
        mode: table | ramp | safe.
        streaming: whether streamed gains are in force.
        contact: whether the wall is touched.
        has_table: whether there is a table.
    """

    ticks: int
    overruns: int
    frequency_hz: float
    lookup_hz: float
    damping_ns_per_m: float
    stiffness_n_per_m: float
    contact_damping_ns_per_m: float
    force_n: float
    position_m: float
    velocity_m_per_s: float
    energy_j: float
    encoder_count: int
    table_id: int
    table_crc32: int
    coupling_id: str
    frames_good: int
    frames_bad: int
    bytes_lost: int
    saturated: int
    not_finite: int
    heartbeats_missed: int
    swaps: int
    stream_number: int
    stream_stale: int
    stream_missing: int
    stream_expired: int
    mode: str
    streaming: bool
    contact: bool
    has_table: bool


MODES = ("table", "ramp", "safe")
_COUPLING_ID = 14  # place in STATUS
_HELLO = struct.Struct("<HHHH8sII6fIIHH3fHHHH")
_STATUS = struct.Struct("<II9fi14I4B")
_GREETING = struct.Struct("<IHH")
_BEGIN = struct.Struct("<IIIHHHH")
_CHUNK = struct.Struct("<III")
_COMMIT = struct.Struct("<III")
_READBACK = struct.Struct("<II")
_SET_GAINS = struct.Struct("<II3f")
_GAINS_TAKEN = struct.Struct("<II3f")
_REFUSED = struct.Struct("<HHI")
_TWO = struct.Struct("<II")
_ONE = struct.Struct("<I")


@dataclass(frozen=True)
class Acknowledged:
    """BEGIN, CHUNK or ABORT taken: bytes of the table received in order so far."""

    table_id: int
    received: int


@dataclass(frozen=True)
class Committed:
    """The table runs since tick ``ticks`` or earlier."""

    table_id: int
    ticks: int


@dataclass(frozen=True)
class Readback:
    """A part of the running table."""

    table_id: int
    offset: int
    data: bytes


@dataclass(frozen=True)
class HeartbeatSeen:
    """The device saw the heartbeat at tick ``ticks``."""

    ticks: int
    mode: str


@dataclass(frozen=True)
class GainsTaken:
    """SET_GAINS ``number`` is in force; with the device's estimate at that tick (not a number at rest)."""

    number: int
    ticks: int
    frequency_hz: float
    lookup_hz: float
    force_n: float


@dataclass(frozen=True)
class Log:
    """A line of text from the firmware."""

    text: str


Message = Refusal | Device | DeviceStatus | Acknowledged | Committed | Readback | HeartbeatSeen | GainsTaken | Log


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


def commit(session: int, table_id: int, crc32: int) -> bytes:
    """Payload of COMMIT."""
    return _COMMIT.pack(session, table_id, crc32)


def readback(offset: int, count: int) -> bytes:
    """Payload of READBACK."""
    return _READBACK.pack(offset, count)


def heartbeat(ticks: int) -> bytes:
    """Payload of HEARTBEAT: the next one follows within ``ticks`` (0: no supervision)."""
    return _ONE.pack(ticks)


def set_gains(number: int, ticks: int, b: float, k: float, b_p: float) -> bytes:
    """Payload of SET_GAINS: they hold for ``ticks``."""
    return _SET_GAINS.pack(number, ticks, b, k, b_p)


def _reason(code: int) -> Reason | int:
    try:
        return Reason(code)
    except ValueError:
        return code


def _device(payload: bytes) -> Device:
    values = _HELLO.unpack(payload)
    build = values[4].rstrip(b"\0").decode("ascii", "replace")
    meant = [_meant(value) for value in values[7:13]]
    hold_s, slew_per_s, guard = map(_meant, values[17:20])
    figures = RuntimeFigures(
        sample_time_s=meant[0],
        metres_per_count=meant[1],
        estimator=ESTIMATOR_NUMBERS[values[20]],
        hold_s=hold_s,
        slew_per_s=slew_per_s or None,
        passive=bool(values[21]),
        guard_damping_ns_per_m=guard,
    )
    running = (*values[13:16], bool(values[16]))
    return Device(*[*values[:4], build, *values[5:7], *meant, *running, figures, *values[22:24]])


def _meant(value: float) -> float:
    """1e-3 travels as 0.0010000000475: say what was meant."""
    return float(str(np.float32(value)))


def _status(payload: bytes) -> DeviceStatus:
    values = _STATUS.unpack(payload)
    mode, streaming, contact, has_table = values[-4:]
    at = _COUPLING_ID
    coupling = f"{values[at]:08x}" if has_table else ""
    flags = (MODES[mode], bool(streaming), bool(contact), bool(has_table))
    return DeviceStatus(*[*values[:at], coupling, *values[at + 1 : -4], *flags])


def _readback(payload: bytes) -> Readback:
    table_id, offset = _TWO.unpack_from(payload)
    return Readback(table_id, offset, payload[_TWO.size :])


def _heartbeat(payload: bytes) -> HeartbeatSeen:
    ticks, mode = _TWO.unpack(payload)
    return HeartbeatSeen(ticks, MODES[mode])


def _refusal(payload: bytes) -> Refusal:
    code, _, detail = _REFUSED.unpack(payload)
    return Refusal(_reason(code), detail)


def _acknowledged(payload: bytes) -> Acknowledged:
    return Acknowledged(*_TWO.unpack(payload))


_PARSERS: dict[int, Callable[[bytes], Message]] = {
    Kind.HELLO | REPLY: _device,
    Kind.BEGIN | REPLY: _acknowledged,
    Kind.CHUNK | REPLY: _acknowledged,
    Kind.ABORT | REPLY: _acknowledged,
    Kind.COMMIT | REPLY: lambda payload: Committed(*_TWO.unpack(payload)),
    Kind.READBACK | REPLY: _readback,
    Kind.STATUS | REPLY: _status,
    Kind.HEARTBEAT | REPLY: _heartbeat,
    Kind.SET_GAINS | REPLY: lambda payload: GainsTaken(*_GAINS_TAKEN.unpack(payload)),
    Kind.LOG: lambda payload: Log(payload.decode("utf-8", "replace")),
    Kind.REFUSED: _refusal,
}


def parse(frame: Frame) -> Message | None:
    """Return the message of a device's frame; None where this program does not understand it."""
    if frame.version != PROTOCOL_VERSION and frame.type != Kind.REFUSED:
        return Refusal(Reason.VERSION, frame.version)
    try:
        return _PARSERS[frame.type](frame.payload)
    except (KeyError, struct.error, IndexError):
        return None
