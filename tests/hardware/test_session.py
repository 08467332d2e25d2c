"""What a session refuses and why: other hosts, other releases, streams without a table, answers that do not fit."""

import dataclasses
import struct
import zlib
from typing import Any

import numpy as np
import pytest
from hardware_bench import coupling, host_core, image, push, refused
from host_device import HostLink

from avc_casadi import LinkError
from avc_hardware import Connection, TableImage
from avc_hardware.link import messages as m
from avc_hardware.link.device import DeviceStatus
from avc_hardware.link.faults import INTERFACE_VERSION, Refusal, RefusalReason
from avc_hardware.link.frames import Decoder, Frame, encode
from avc_hardware.link.messages import Kind
from avc_hardware.link.session import RefusedError, Session


def image_of_session(*arguments: Any, **options: Any) -> TableImage:
    return TableImage.of(coupling(*arguments, **options))


def test_second_host_is_refused_while_the_first_is_sending() -> None:
    core = host_core()
    first, second = Connection(HostLink(core), session=1), Connection(HostLink(core), session=2)
    table = image_of_session(50, seed=1)
    begin = m.begin(1, table.table_id, table.crc32, len(table.rows))
    first.run(first.session.ask(Kind.BEGIN, begin, m.Acknowledged))
    first.run(first.session.ask(Kind.CHUNK, m.words(1, table.table_id, 0) + table.image[:512], m.Acknowledged))
    other = image_of_session(30, seed=2)
    with pytest.raises(RefusedError, match="another host is sending"):
        second.run(second.session.ask(Kind.BEGIN, m.begin(2, other.table_id, other.crc32, 30), m.Acknowledged))
    with pytest.raises(RefusedError, match="another host is sending"):
        second.run(second.session.ask(Kind.CHUNK, m.words(2, other.table_id, 0) + other.image[:64], m.Acknowledged))
    first.run(first.session.push(table, first.device))
    assert core.image() == table.image
    second.run(second.session.push(other, second.device))
    assert core.image() == other.image


def test_a_transfer_that_was_left_is_taken_over_after_two_seconds() -> None:
    core = host_core()
    first, second = Connection(HostLink(core), session=1), Connection(HostLink(core), session=2)
    table = image_of_session(50, seed=1)
    first.run(first.session.ask(Kind.BEGIN, m.begin(1, table.table_id, table.crc32, 50), m.Acknowledged))
    core.tick(np.zeros(2001, dtype=np.int32))
    second.run(second.session.push(table, second.device))
    assert core.image() == table.image


def test_stream_needs_a_table_to_fall_back_to() -> None:
    connection = Connection(HostLink(host_core()))
    with pytest.raises(RefusedError, match="no table"):
        connection.run(connection.session.ask(Kind.SET_GAINS, m.set_gains(1, 0, 60, 1.0, 1.0, 0.0), m.GainsTaken))


@pytest.mark.parametrize(
    ("b", "reason"), [(np.nan, RefusalReason.NOT_FINITE), (-1.0, RefusalReason.LIMIT), (1e9, RefusalReason.LIMIT)]
)
def test_streamed_gains_are_checked(b: float, reason: RefusalReason) -> None:
    core = host_core()
    push(coupling(5), HostLink(core))
    connection = Connection(HostLink(core))
    payload = m.set_gains(int(coupling(5).id, 16), 0, 60, b, 1.0, 0.0)
    with pytest.raises(RefusedError) as caught:
        connection.run(connection.session.ask(Kind.SET_GAINS, payload, m.GainsTaken))
    assert caught.value.refusal.reason is reason


def test_host_of_another_interface_is_refused_by_the_device() -> None:
    core = host_core()
    core.read()
    core.write(encode(Frame(Kind.HELLO, 5, m.words(1, INTERFACE_VERSION + 1))))
    (answer,) = Decoder().feed(core.read())
    refusal = m.parse(answer)
    assert refusal == Refusal(RefusalReason.INTERFACE, INTERFACE_VERSION)
    assert "one release" in str(refusal)


def test_session_waits_and_sends_nothing_by_itself() -> None:
    """The state machine by hand: a question, silence, the same question again, a stale answer, the answer."""
    session = Session(1, timeout_s=0.5)
    dialogue = session.request(Kind.STATUS, b"")
    first = next(dialogue)
    second = dialogue.send(None)
    assert first.data == second.data
    assert second.data.startswith(b"\0")
    sequence = Decoder().feed(first.data)[0].sequence
    assert dialogue.send((sequence - 1, m.Committed(1, 2, 0))).data == b""
    with pytest.raises(StopIteration) as stop:
        dialogue.send((sequence, m.Committed(3, 4, 0)))
    assert stop.value.value == m.Committed(3, 4, 0)


class ReadsOtherwise(HostLink):
    """A link over which the last byte of what is read back is another one."""

    def read(self, timeout_s: float) -> bytes:
        frames = Decoder().feed(super().read(timeout_s))
        for place, one in enumerate(frames):
            if one.type == Kind.READBACK | m.REPLY:
                frames[place] = dataclasses.replace(one, payload=one.payload[:-1] + b"?")
        return b"".join(map(encode, frames))


def test_a_table_that_is_read_back_otherwise_is_no_success() -> None:
    with pytest.raises(LinkError, match="differs from the one sent"):
        push(coupling(5), ReadsOtherwise(host_core()))


# A table that must not run is refused by the device itself, with the row and the reason.


def with_cell(row: int, column: int, value: float) -> TableImage:
    table = image(8)
    rows = table.rows.copy()
    rows[row, column] = value
    return dataclasses.replace(table, rows=rows)


@pytest.mark.parametrize(
    ("row", "column", "value", "reason"),
    [
        (3, 1, np.nan, RefusalReason.NOT_FINITE),
        (0, 2, np.inf, RefusalReason.NOT_FINITE),
        (7, 0, -np.inf, RefusalReason.NOT_FINITE),
        (5, 1, -1.0, RefusalReason.LIMIT),
        (2, 2, 2e8, RefusalReason.LIMIT),
        (2, 3, 2e4, RefusalReason.LIMIT),
        (0, 0, 0.0, RefusalReason.LIMIT),
        (0, 0, 1e-40, RefusalReason.LIMIT),
        (4, 0, 1.0, RefusalReason.NOT_MONOTONIC),
    ],
)
def test_device_names_the_bad_row(row: int, column: int, value: float, reason: RefusalReason) -> None:
    refusal = refused(with_cell(row, column, value))
    assert refusal == Refusal(reason, row)
    assert f"row {row}" in str(refusal)


@pytest.mark.parametrize(
    ("header", "reason"),
    [
        ({"safe_stiffness_n_per_m": 1e9}, RefusalReason.LIMIT),
        ({"safe_damping_ns_per_m": np.inf}, RefusalReason.NOT_FINITE),
        ({"wall_damping_ns_per_m": -1.0}, RefusalReason.WALL),
        ({"wall_stiffness_n_per_m": np.nan}, RefusalReason.WALL),
        ({"wall_stiffness_n_per_m": 1.1e8}, RefusalReason.WALL),
        ({"wall_damping_ns_per_m": 0.0, "wall_stiffness_n_per_m": 0.0}, RefusalReason.WALL),
        ({"max_force_n": -1.0}, RefusalReason.FORCE),
        ({"max_force_n": 50.01}, RefusalReason.FORCE),
        ({"max_force_n": np.nan}, RefusalReason.FORCE),
        ({"coupling_id": 0}, RefusalReason.COUPLING),
        ({"sample_time_s": 1.001e-3}, RefusalReason.SAMPLE_TIME),
        ({"sample_time_s": np.nan}, RefusalReason.SAMPLE_TIME),
    ],
)
def test_a_header_for_another_loop_is_refused_by_a_reason_of_its_own(
    header: dict[str, float], reason: RefusalReason
) -> None:
    assert refused(dataclasses.replace(image(3), **header)).reason is reason


def refused_spoilt(table: bytes, rows: int, crc32: int, told: str) -> None:
    """The device takes bytes of a table in right frames, and refuses them at the end."""
    core = host_core()
    connection = Connection(HostLink(core), session=1)
    ask = connection.session.ask
    connection.run(ask(Kind.BEGIN, m.begin(1, 5, crc32, rows), m.Acknowledged))
    connection.run(ask(Kind.CHUNK, m.words(1, 5, 0) + table, m.Acknowledged))
    with pytest.raises(RefusedError, match=told):
        connection.run(ask(Kind.COMMIT, m.words(1, 5, crc32), m.Committed))
    assert core.image() is None


@pytest.mark.parametrize("bit", [4, 5, 6, 7])
def test_a_table_that_asks_for_what_the_firmware_does_not_know_is_refused(bit: int) -> None:
    table = image(3).image
    asks = table[:2] + struct.pack("<H", struct.unpack_from("<H", table, 2)[0] | 1 << bit) + table[4:]
    refused_spoilt(asks, 3, zlib.crc32(asks), "header has a flag that the firmware does not know")


def test_spoilt_table_with_right_frames_is_refused_by_its_checksum() -> None:
    table = image(8)
    refused_spoilt(bytes(len(table.image)), 8, table.crc32, "wrong size")
    spoilt = bytearray(table.image)
    spoilt[40] ^= 1
    refused_spoilt(bytes(spoilt), 8, table.crc32, "checksum of the table")


class ThinkingTwice(HostLink):
    """A link whose device loses so many answers to messages of a kind, or answers them with a refusal."""

    def __init__(self, core: Any, kind: Kind, times: int, refusal: RefusalReason | None = None) -> None:
        super().__init__(core)
        self.kind, self.times, self.refusal = kind, times, refusal
        self.sent = 0
        self.refused = b""

    def read(self, timeout_s: float) -> bytes:
        answer, self.refused = self.refused, b""
        return answer or super().read(timeout_s)

    def write(self, data: bytes) -> None:
        frames = [frame for frame in Decoder().feed(data + b"\x00") if frame.type == self.kind]
        if not frames:
            super().write(data)
            return
        self.sent += 1
        if self.times == 0:
            super().write(data)
            return
        self.times -= 1
        if self.refusal is not None:
            answer = m.words(int(self.refusal), 0)
            self.refused = encode(Frame(Kind.REFUSED, frames[0].sequence, answer))


@pytest.mark.parametrize(("lost", "sent"), [(0, 1), (1, 2), (3, 4), (4, 4)])
def test_a_message_is_sent_four_times_until_it_is_answered(lost: int, sent: int) -> None:
    link = ThinkingTwice(host_core(), Kind.STATUS, lost)
    connection = Connection(link)
    asked = connection.session.ask(Kind.STATUS, b"", DeviceStatus)
    if lost < 4:
        assert isinstance(connection.run(asked), DeviceStatus)
    else:
        with pytest.raises(LinkError, match="no answer to STATUS after 4 requests; is the device still connected"):
            connection.run(asked)
        # Each wait is longer than that before, and no longer than it says.
        assert link.now_s() == pytest.approx((1 + 2 + 3 + 4) * connection.session.timeout_s, rel=0.02)
    assert link.sent == sent


@pytest.mark.parametrize(("refused_times", "attempts"), [(0, 1), (1, 2), (4, 5), (5, 5)])
def test_a_table_is_sent_five_times_until_it_is_taken(refused_times: int, attempts: int) -> None:
    core = host_core()
    link = ThinkingTwice(core, Kind.COMMIT, refused_times, RefusalReason.CRC)
    connection = Connection(link)
    table = image_of_session(20, seed=3)
    dialogue = connection.session.push(table, connection.device)
    if refused_times < 5:
        assert connection.run(dialogue).attempts == attempts
        assert core.image() == table.image
    else:
        with pytest.raises(LinkError, match="the table was not taken after 5 attempts: the device refused: "):
            connection.run(dialogue)
    assert link.sent == attempts
