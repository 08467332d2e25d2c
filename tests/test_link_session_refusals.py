"""What is refused and why: tables and hosts that must not pass, by the device itself and by the host before it."""

import dataclasses
import struct
import zlib
from collections.abc import Generator
from typing import Any

import numpy as np
import pytest
from hardware_bench import host_core, host_library, schedule

from avc_casadi import InputError, LinkError
from avc_hardware import Connection, GainTable, TableSettings, Wall, gain_table, push
from avc_hardware import _messages as m
from avc_hardware._frames import Decoder, Frame, cobs_decode, encode
from avc_hardware._host import BoardLimits, HostCore, HostLink
from avc_hardware._messages import Kind, Reason, Refusal
from avc_hardware._session import Exchange, RefusedError, Session


def refused(table: GainTable) -> Refusal:
    """Send a table past the host's own checks; return the device's refusal."""
    core = host_core()
    connection = Connection(HostLink(core))
    with pytest.raises(RefusedError) as caught:
        connection.run(connection.session.push(table, connection.device))
    assert core.image() is None
    return caught.value.refusal


def with_cell(row: int, column: int, value: float) -> GainTable:
    table = gain_table(schedule(8))
    rows = table.rows.copy()
    rows[row, column] = value
    return dataclasses.replace(table, rows=rows)


@pytest.mark.parametrize(
    ("row", "column", "value", "reason"),
    [
        (3, 1, np.nan, Reason.NOT_FINITE),
        (0, 2, np.inf, Reason.NOT_FINITE),
        (7, 0, -np.inf, Reason.NOT_FINITE),
        (5, 1, -1.0, Reason.LIMIT),
        (2, 2, 2e8, Reason.LIMIT),
        (2, 3, 2e4, Reason.LIMIT),
        (0, 0, 0.0, Reason.LIMIT),
        (0, 0, 1e-40, Reason.LIMIT),
        (4, 0, 1.0, Reason.NOT_MONOTONIC),
    ],
)
def test_device_names_the_bad_row(row: int, column: int, value: float, reason: Reason) -> None:
    refusal = refused(with_cell(row, column, value))
    assert refusal == Refusal(reason, row)
    assert f"row {row}" in str(refusal)


def test_repeated_frequency_is_refused_on_both_sides() -> None:
    table = gain_table(schedule(8))
    rows = table.rows.copy()
    rows[4, 0] = rows[3, 0]
    assert refused(dataclasses.replace(table, rows=rows)) == Refusal(Reason.NOT_MONOTONIC, 4)
    gains = schedule(8)
    frequency = gains.frequency_hz.copy()
    frequency[4] = frequency[3] * (1 + 1e-9)
    with pytest.raises(InputError, match="two rows have the frequency"):
        gain_table(dataclasses.replace(gains, frequency_hz=frequency))


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        (TableSettings(wall=Wall(-1.0, 1e4)), Reason.LIMIT),
        (TableSettings(wall=Wall(1.0, np.nan)), Reason.NOT_FINITE),
        (TableSettings(safe_stiffness_n_per_m=1e9), Reason.LIMIT),
        (TableSettings(safe_damping_ns_per_m=np.inf), Reason.NOT_FINITE),
        (TableSettings(wall=Wall(0.0, 0.0)), Reason.LIMIT),
    ],
)
def test_device_refuses_a_bad_header(settings: TableSettings, reason: Reason) -> None:
    refusal = refused(gain_table(schedule(3), settings=settings))
    assert refusal == Refusal(reason, 0xFFFF)
    assert "header" in str(refusal)


def test_table_larger_than_the_device_is_refused_by_it() -> None:
    table = gain_table(schedule(300))
    assert len(table.rows) == 300
    assert refused(table) == Refusal(Reason.ROWS, 256)


def test_header_that_names_other_rows_is_refused() -> None:
    core = host_core()
    connection = Connection(HostLink(core), session=1)
    table = gain_table(schedule(8))
    image = struct.pack("<H", 7) + table.image[2:]
    crc32 = zlib.crc32(image)
    ask = connection.session.ask
    connection.run(ask(Kind.BEGIN, m.begin(1, 5, crc32, 8), m.Acknowledged))
    connection.run(ask(Kind.CHUNK, m.chunk(1, 5, 0, image), m.Acknowledged))
    with pytest.raises(RefusedError, match="wrong size"):
        connection.run(ask(Kind.COMMIT, m.commit(1, 5, crc32), m.Committed))
    assert core.image() is None


def test_spoilt_table_with_right_frames_is_refused_by_its_checksum() -> None:
    core = host_core()
    connection = Connection(HostLink(core), session=1)
    table = gain_table(schedule(8))
    ask = connection.session.ask
    connection.run(ask(Kind.BEGIN, m.begin(1, 5, table.crc32, 8), m.Acknowledged))
    connection.run(ask(Kind.CHUNK, m.chunk(1, 5, 0, bytes(len(table.image))), m.Acknowledged))
    with pytest.raises(RefusedError, match="wrong size"):
        connection.run(ask(Kind.COMMIT, m.commit(1, 5, table.crc32), m.Committed))
    spoilt = bytearray(table.image)
    spoilt[40] ^= 1
    connection.run(ask(Kind.BEGIN, m.begin(1, 6, table.crc32, 8), m.Acknowledged))
    connection.run(ask(Kind.CHUNK, m.chunk(1, 6, 0, bytes(spoilt)), m.Acknowledged))
    with pytest.raises(RefusedError, match="checksum of the table"):
        connection.run(ask(Kind.COMMIT, m.commit(1, 6, table.crc32), m.Committed))
    assert core.image() is None


def test_heartbeat_reports_the_mode() -> None:
    core = host_core()
    connection = Connection(HostLink(core))
    connection.run(connection.session.push(gain_table(schedule(8)), connection.device))
    assert connection.heartbeat(0.05) == "table"
    core.tick(np.zeros(40, dtype=np.int32))
    assert connection.heartbeat(0.05) == "table"
    core.tick(np.zeros(60, dtype=np.int32))
    assert connection.heartbeat(0.05) != "table"
    core.tick(np.zeros(101, dtype=np.int32))
    assert connection.heartbeat(0.0) == "safe"
    core.tick(np.zeros(2, dtype=np.int32))
    assert connection.heartbeat(0.0) == "table"


def test_wrong_sample_time_is_refused_on_both_sides() -> None:
    gains = schedule(3, sample_time_s=2e-3)
    assert refused(gain_table(gains)).reason is Reason.SAMPLE_TIME
    with pytest.raises(LinkError, match=r"sample time of 0\.002 s, the device runs at 0\.001 s"):
        push(gains, HostLink(host_core()))


def test_host_names_every_limit_that_is_passed() -> None:
    core = HostCore(host_library(), BoardLimits(max_damping_ns_per_m=100.0, max_stiffness_n_per_m=1e4))
    with pytest.raises(LinkError) as caught:
        push(schedule(9, sample_time_s=1e-4), HostLink(core))
    text = str(caught.value)
    assert "damping b" in text
    assert "stiffness k" in text
    assert "sample time" in text
    assert "contact damping" not in text
    assert core.image() is None


@pytest.mark.parametrize(
    ("limit", "words"),
    [
        ("max_damping_ns_per_m", "damping b is"),
        ("max_stiffness_n_per_m", "stiffness k is"),
        ("max_contact_damping_ns_per_m", "contact damping b_p is"),
    ],
)
def test_host_sends_nothing_above_any_one_limit(limit: str, words: str) -> None:
    """The largest gain of the table passes; the limit a little lower is named before a byte of the table travels."""
    gains = schedule(9, largest=(80.0, 5e3, 60.0))
    largest = float(np.float32(getattr(gains, limit.removeprefix("max_")).max()))
    core = HostCore(host_library(), BoardLimits(**{limit: largest}))
    assert push(gains, HostLink(core)).rows == 9
    core = HostCore(host_library(), BoardLimits(**{limit: 0.999 * largest}))
    with pytest.raises(LinkError, match=f"not sent: {words}") as caught:
        push(gains, HostLink(core))
    assert str(caught.value).count(";") == 1
    assert core.image() is None


def test_schedule_without_gains_is_refused_before_a_port_is_opened() -> None:
    with pytest.raises(InputError, match="none of the 5 rows"):
        push(schedule(5, unusable=5), "/dev/does-not-exist")


def test_unusable_rows_are_left_out_and_counted() -> None:
    core = host_core()
    result = push(schedule(9, unusable=4), HostLink(core))
    assert (result.rows, result.left_out) == (5, 4)


def test_the_same_table_twice_changes_nothing() -> None:
    core = host_core()
    first = push(schedule(9), HostLink(core))
    swaps = core.state().swaps
    again = push(schedule(9), HostLink(core))
    assert (again.table_id, again.crc32) == (first.table_id, first.crc32)
    assert again.readback_equal
    assert core.state().swaps == swaps


def test_table_id_comes_from_the_content() -> None:
    a, b = gain_table(schedule(9, seed=1)), gain_table(schedule(9, seed=2))
    assert a.table_id == gain_table(schedule(9, seed=1)).table_id
    assert a.table_id != b.table_id
    assert a.crc32 == zlib.crc32(a.image)


def test_second_host_is_refused_while_the_first_is_sending() -> None:
    core = host_core()
    first, second = Connection(HostLink(core), session=1), Connection(HostLink(core), session=2)
    table = gain_table(schedule(50, seed=1))
    begin = m.begin(1, table.table_id, table.crc32, len(table.rows))
    first.run(first.session.ask(Kind.BEGIN, begin, m.Acknowledged))
    first.run(first.session.ask(Kind.CHUNK, m.chunk(1, table.table_id, 0, table.image[:512]), m.Acknowledged))
    other = gain_table(schedule(30, seed=2))
    with pytest.raises(RefusedError, match="another host is sending"):
        second.run(second.session.ask(Kind.BEGIN, m.begin(2, other.table_id, other.crc32, 30), m.Acknowledged))
    with pytest.raises(RefusedError, match="another host is sending"):
        second.run(second.session.ask(Kind.CHUNK, m.chunk(2, other.table_id, 0, other.image[:64]), m.Acknowledged))
    first.run(first.session.push(table, first.device))
    assert core.image() == table.image
    second.run(second.session.push(other, second.device))
    assert core.image() == other.image


def test_a_transfer_that_was_left_is_taken_over_after_two_seconds() -> None:
    core = host_core()
    first, second = Connection(HostLink(core), session=1), Connection(HostLink(core), session=2)
    table = gain_table(schedule(50, seed=1))
    first.run(first.session.ask(Kind.BEGIN, m.begin(1, table.table_id, table.crc32, 50), m.Acknowledged))
    core.tick(np.zeros(2001, dtype=np.int32))
    second.run(second.session.push(table, second.device))
    assert core.image() == table.image


def test_abort_frees_the_device_at_once_and_only_for_the_host_that_was_sending() -> None:
    core = host_core()
    first, second = Connection(HostLink(core), session=1), Connection(HostLink(core), session=2)
    table, other = gain_table(schedule(50, seed=1)), gain_table(schedule(30, seed=2))
    begin = m.begin(2, other.table_id, other.crc32, 30)
    first.run(first.session.ask(Kind.BEGIN, m.begin(1, table.table_id, table.crc32, 50), m.Acknowledged))

    second.run(second.session.ask(Kind.ABORT, m.abort(2), m.Acknowledged))
    with pytest.raises(RefusedError, match="another host is sending"):
        second.run(second.session.ask(Kind.BEGIN, begin, m.Acknowledged))

    first.run(first.session.ask(Kind.ABORT, m.abort(1), m.Acknowledged))
    with pytest.raises(RefusedError, match="no transfer"):
        first.run(first.session.ask(Kind.CHUNK, m.chunk(1, table.table_id, 0, table.image[:64]), m.Acknowledged))
    second.run(second.session.push(other, second.device))
    assert core.image() == other.image


def test_stream_needs_a_table_to_fall_back_to() -> None:
    connection = Connection(HostLink(host_core()))
    with pytest.raises(RefusedError, match="push one first"):
        connection.run(connection.session.ask(Kind.SET_GAINS, m.set_gains(0, 60, 1.0, 1.0, 0.0), m.GainsTaken))


@pytest.mark.parametrize(("b", "reason"), [(np.nan, Reason.NOT_FINITE), (-1.0, Reason.LIMIT), (1e9, Reason.LIMIT)])
def test_streamed_gains_are_checked(b: float, reason: Reason) -> None:
    core = host_core()
    push(schedule(5), HostLink(core))
    connection = Connection(HostLink(core))
    with pytest.raises(RefusedError) as caught:
        connection.run(connection.session.ask(Kind.SET_GAINS, m.set_gains(0, 60, b, 1.0, 0.0), m.GainsTaken))
    assert caught.value.refusal.reason is reason


def answer(dialogue: Generator[Exchange, Any, Any], message: m.Message) -> None:
    """Give a dialogue in its first wait an answer to what it has just sent."""
    exchange = next(dialogue)
    (sequence,) = struct.unpack_from("<H", _content(exchange.data), 2)
    dialogue.send((sequence, message))


def _content(data: bytes) -> bytes:
    content = cobs_decode(data.strip(b"\0"))
    assert content is not None
    return content


@pytest.mark.parametrize(("interface", "who"), [(0, "the firmware"), (2, "avc-casadi")])
def test_firmware_of_another_interface_is_refused_with_advice(interface: int, who: str) -> None:
    core = host_core()
    device = dataclasses.replace(Connection(HostLink(core)).device, interface_version=interface)
    with pytest.raises(LinkError, match=f"update {who}"):
        answer(Session(1, timeout_s=0.1).hello(), device)


def test_other_protocol_version_is_refused_both_ways() -> None:
    assert m.parse(Frame(Kind.HELLO | m.REPLY, 1, b"anything", version=2)) == Refusal(Reason.VERSION, 2)
    core = host_core()
    core.read()
    core.write(encode(Frame(Kind.HELLO, 5, m.hello(1), version=2)))
    assert "speaks protocol 1" in str(Refusal(Reason.VERSION, 1))
    assert core.read()


def test_host_of_another_interface_is_refused_by_the_device() -> None:
    core = host_core()
    core.read()
    core.write(encode(Frame(Kind.HELLO, 5, m.hello(1, interface_version=9))))
    (answer,) = Decoder().feed(core.read())
    refusal = m.parse(answer)
    assert refusal == Refusal(Reason.INTERFACE, m.INTERFACE_VERSION)
    assert "one release" in str(refusal)


def test_every_reason_has_a_sentence() -> None:
    for reason in Reason:
        assert len(str(Refusal(reason, 3))) > 15
    assert "code 99" in str(Refusal(99, 0))


def test_session_waits_and_sends_nothing_by_itself() -> None:
    """The state machine by hand: a question, silence, the same question again, a stale answer, the answer."""
    session = Session(1, timeout_s=0.5)
    dialogue = session.request(Kind.STATUS, b"")
    first = next(dialogue)
    second = dialogue.send(None)
    assert first.data == second.data
    assert second.data.startswith(b"\0")
    (sequence,) = struct.unpack_from("<H", _content(first.data), 2)
    assert dialogue.send((sequence - 1, m.Committed(1, 2))).data == b""
    with pytest.raises(StopIteration) as stop:
        dialogue.send((sequence, m.Committed(3, 4)))
    assert stop.value.value == m.Committed(3, 4)
