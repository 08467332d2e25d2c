"""What is refused and why: tables and hosts that must not pass, by the device itself and by the host before it."""

import dataclasses
import struct
import zlib
from collections.abc import Generator
from typing import Any

import numpy as np
import pytest
from hardware_bench import coupling, host_core, host_library, push

import avc_hardware
from avc_casadi import InputError, LinkError, NotDeployableError, UnsupportedError
from avc_casadi.coupling import GainTable, Runtime
from avc_hardware import BoardLimits, Connection, RuntimeFigures, TableImage, check_runs_on
from avc_hardware import _messages as m
from avc_hardware._frames import Decoder, Frame, cobs_decode, encode
from avc_hardware._host import HostCore, HostLink
from avc_hardware._messages import Kind, Reason, Refusal
from avc_hardware._push import push_over
from avc_hardware._session import Exchange, RefusedError, Session


def image(*arguments: Any, **options: Any) -> TableImage:
    return TableImage.of(coupling(*arguments, **options))


def refused(table: TableImage) -> Refusal:
    """Send a table past the host's own checks; return the device's refusal."""
    core = host_core()
    connection = Connection(HostLink(core))
    with pytest.raises(RefusedError) as caught:
        connection.run(connection.session.push(table, connection.device))
    assert core.image() is None
    return caught.value.refusal


def with_cell(row: int, column: int, value: float) -> TableImage:
    table = image(8)
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
    table = image(8)
    rows = table.rows.copy()
    rows[4, 0] = rows[3, 0]
    assert refused(dataclasses.replace(table, rows=rows)) == Refusal(Reason.NOT_MONOTONIC, 4)
    made = coupling(8)
    wide = made.table.rows.copy()
    wide[4, 0] = wide[3, 0] * (1 + 1e-9)
    with pytest.raises(InputError, match="two rows have the frequency"):
        TableImage.of(dataclasses.replace(made, table=GainTable(wide)))


@pytest.mark.parametrize(
    ("header", "reason"),
    [
        ({"wall_damping_ns_per_m": -1.0}, Reason.LIMIT),
        ({"wall_stiffness_n_per_m": np.nan}, Reason.NOT_FINITE),
        ({"safe_stiffness_n_per_m": 1e9}, Reason.LIMIT),
        ({"safe_damping_ns_per_m": np.inf}, Reason.NOT_FINITE),
        ({"wall_damping_ns_per_m": 0.0, "wall_stiffness_n_per_m": 0.0}, Reason.LIMIT),
        ({"max_force_n": -1.0}, Reason.LIMIT),
        ({"max_force_n": np.nan}, Reason.NOT_FINITE),
    ],
)
def test_device_refuses_a_bad_header(header: dict[str, float], reason: Reason) -> None:
    refusal = refused(dataclasses.replace(image(3), **header))
    assert refusal == Refusal(reason, 0xFFFF)
    assert "header" in str(refusal)


def test_table_larger_than_the_device_is_refused_by_it() -> None:
    table = image(300)
    assert len(table.rows) == 300
    assert refused(table) == Refusal(Reason.ROWS, 256)
    with pytest.raises(LinkError, match="300 rows, the device holds 256; make a coupling for this capacity"):
        push(coupling(300), HostLink(host_core()))


def test_header_that_names_other_rows_is_refused() -> None:
    core = host_core()
    connection = Connection(HostLink(core), session=1)
    table = image(8)
    spoilt = struct.pack("<H", 7) + table.image[2:]
    crc32 = zlib.crc32(spoilt)
    ask = connection.session.ask
    connection.run(ask(Kind.BEGIN, m.begin(1, 5, crc32, 8), m.Acknowledged))
    connection.run(ask(Kind.CHUNK, m.chunk(1, 5, 0, spoilt), m.Acknowledged))
    with pytest.raises(RefusedError, match="wrong size"):
        connection.run(ask(Kind.COMMIT, m.commit(1, 5, crc32), m.Committed))
    assert core.image() is None


def test_spoilt_table_with_right_frames_is_refused_by_its_checksum() -> None:
    core = host_core()
    connection = Connection(HostLink(core), session=1)
    table = image(8)
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
    connection.run(connection.session.push(image(8), connection.device))
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
    slow = coupling(3, sample_time_s=2e-3)
    assert refused(TableImage.of(slow)).reason is Reason.SAMPLE_TIME
    with pytest.raises(LinkError, match=r"sample time of 0\.002 s, the device runs at 0\.001 s"):
        push(slow, HostLink(host_core()))


def test_host_names_every_limit_that_is_passed() -> None:
    core = HostCore(host_library(), BoardLimits(max_damping_ns_per_m=100.0, max_stiffness_n_per_m=1e4))
    with pytest.raises(LinkError) as caught:
        push(coupling(9, sample_time_s=1e-4, wall=(0.0, 2e4)), HostLink(core))
    text = str(caught.value)
    assert "damping b" in text
    assert "stiffness k" in text
    assert "sample time" in text
    assert "wall's stiffness is 20000 N/m" in text
    assert "contact damping" not in text
    assert core.image() is None


@pytest.mark.parametrize(
    ("limit", "column", "words"),
    [
        ("max_damping_ns_per_m", 1, "damping b is"),
        ("max_stiffness_n_per_m", 2, "stiffness k is"),
        ("max_contact_damping_ns_per_m", 3, "contact damping b_p is"),
    ],
)
def test_host_sends_nothing_above_any_one_limit(limit: str, column: int, words: str) -> None:
    """The largest gain of the table passes; the limit a little lower is named before a byte of the table travels."""
    made = coupling(9, largest=(80.0, 5e3, 60.0), wall=(1.0, 1e3))
    largest = float(np.float32(made.table.rows[:, column].max()))
    core = HostCore(host_library(), BoardLimits(**{limit: largest}))
    assert push(made, HostLink(core)).rows == 9
    core = HostCore(host_library(), BoardLimits(**{limit: 0.999 * largest}))
    with pytest.raises(LinkError, match=f"not sent: {words}") as caught:
        push(made, HostLink(core))
    assert str(caught.value).count("narrow") == 1
    assert core.image() is None
    # Of many rows above it the worst is named.
    core = HostCore(host_library(), BoardLimits(**{limit: 0.3 * largest}))
    with pytest.raises(LinkError, match=f"{words} {largest:.6g} "):
        push(made, HostLink(core))


def test_what_a_board_says_in_single_precision_is_taken_as_it_was_meant() -> None:
    device = Connection(HostLink(host_core())).device
    assert (device.sample_time_s, device.metres_per_count) == (0.001, 2e-6)


def test_what_no_hand_could_hold_is_refused_before_a_port_is_opened() -> None:
    for verb in (avc_hardware.push, avc_hardware.stream):
        with pytest.raises(NotDeployableError, match=r"hands \(L5\): linearly unstable"):
            verb(coupling(5), "/dev/does-not-exist")
    with pytest.raises(NotDeployableError, match=r"hands \(L5\): linearly unstable"):
        avc_hardware.export_c(coupling(5))


@pytest.mark.parametrize(
    ("runtime", "named"),
    [
        (Runtime(observer_mass_kg=0.2), "observer"),
        (Runtime(guard="energy-tank"), "energy-tank"),
        (Runtime(observer_mass_kg=0.2, guard="energy-tank"), "observer.*energy-tank"),
    ],
)
def test_what_the_firmware_has_not_is_refused_before_a_port_is_opened(runtime: Runtime, named: str) -> None:
    for refuse in (check_runs_on, lambda found: push(found, "/dev/does-not-exist")):
        with pytest.raises(UnsupportedError, match=f"{named}.*avc export"):
            refuse(coupling(5, runtime=runtime))


@pytest.mark.parametrize(
    ("runtime", "named"),
    [
        (Runtime(estimator="zero-crossing"), "estimator is fused, the coupling's zero-crossing"),
        (Runtime(hold_s=0.3), r"hold_s is 0\.2, the coupling's 0\.3"),
        (Runtime(slew_per_s=None), r"slew_per_s is 20\.0, the coupling's None"),
        (Runtime(passive=False), "passive is True, the coupling's False"),
    ],
)
def test_settings_of_another_firmware_are_refused_by_name_where_they_matter(runtime: Runtime, named: str) -> None:
    core = host_core()
    with pytest.raises(UnsupportedError, match=named):
        push(coupling(5, runtime=runtime), HostLink(core))
    assert core.image() is None
    constant = coupling(1, runtime=runtime)
    assert push(constant, HostLink(core)).readback_equal


def test_guard_limit_must_be_that_of_the_device_where_there_is_a_guard() -> None:
    guard = Runtime(guard="passivity-controller")
    assert push(coupling(5, runtime=guard, damping_ns_per_m=2.0), HostLink(host_core())).readback_equal
    with pytest.raises(UnsupportedError, match=r"guard_damping_ns_per_m is 2\.0, the coupling's 1\.5"):
        push(coupling(5, runtime=guard, damping_ns_per_m=1.5), HostLink(host_core()))
    assert push(coupling(5, damping_ns_per_m=1.5), HostLink(host_core())).notes == ()


def test_device_tells_what_it_was_generated_for() -> None:
    assert Connection(HostLink(host_core())).device.figures == RuntimeFigures()


def test_unusable_rows_are_left_out_and_counted() -> None:
    core = host_core()
    result = push(coupling(9, unusable=4), HostLink(core))
    assert (result.rows, result.left_out) == (5, 4)


def test_the_same_table_twice_changes_nothing() -> None:
    core = host_core()
    first = push(coupling(9), HostLink(core))
    swaps = core.state().swaps
    again = push(coupling(9), HostLink(core))
    assert (again.table_id, again.crc32) == (first.table_id, first.crc32)
    assert again.readback_equal
    assert core.state().swaps == swaps


def test_status_names_the_coupling_and_the_device_takes_the_lower_force_limit() -> None:
    """The wall of a second coupling is its own; nothing of the first is left."""
    core = HostCore(host_library(), BoardLimits(max_force_n=20.0))
    connection = Connection(HostLink(core))
    ask = connection.session.ask
    assert connection.run(ask(Kind.STATUS, b"", m.DeviceStatus)).coupling_id == ""
    for limit, told in ((5.0, 5.0), (20.0, 20.0), (None, 20.0), (50.0, 20.0)):
        made = coupling(1, largest=(10.0, 1e5, 0.0), wall=(0.0, 1e5 + (limit or 0.0)), max_force_n=limit)
        result = push_over(connection, made)
        assert result.max_force_n == told
        assert ("its certificate does not know" in " ".join(result.notes)) == (limit == 50.0)
        force, _ = core.tick(np.full(50, 5000, dtype=np.int32))
        assert force[-1] == np.float32(told)
        assert connection.run(ask(Kind.STATUS, b"", m.DeviceStatus)).coupling_id == made.id == result.coupling_id


def test_the_wall_is_that_of_the_coupling() -> None:
    core = host_core()
    for stiffness in (2e3, 5e3):
        push(coupling(1, largest=(0.0, 1e6, 0.0), seed=4, wall=(0.0, stiffness)), HostLink(core))
        force, _ = core.tick(np.full(400, 500, dtype=np.int32))
        k = TableImage.of(coupling(1, largest=(0.0, 1e6, 0.0), seed=4)).rows[0, 2]
        assert force[-1] == pytest.approx(1e-3 * k * stiffness / (k + stiffness), rel=1e-4)


@pytest.mark.parametrize("damping", [0.0, 40.0, 100.0])
def test_the_damper_of_the_wall_is_that_of_the_coupling(damping: float) -> None:
    """Pressed at speed v through a spring k, the wall answers with k k_e/(k + k_e) x + b_e v (k/(k + k_e))^2."""
    core, stiffness, speed = host_core(), 2e3, 0.01
    made = coupling(1, largest=(0.0, 1e4, 0.0), seed=4, wall=(damping, stiffness))
    push(made, HostLink(core))
    # 5 counts of 2 um in each tick of 1 ms, from the surface on.
    force, _ = core.tick(np.arange(400, dtype=np.int32) * 5)
    (k,), depth = made.table.gains[1], 399 * speed * 1e-3
    share = k / (k + stiffness)
    assert force[-1] == pytest.approx(share * stiffness * depth + damping * speed * share**2, rel=1e-4)


def test_table_id_comes_from_the_content() -> None:
    a, b = image(9, seed=1), image(9, seed=2)
    assert a.table_id == image(9, seed=1).table_id
    assert a.table_id != b.table_id
    assert a.crc32 == zlib.crc32(a.image)


def test_second_host_is_refused_while_the_first_is_sending() -> None:
    core = host_core()
    first, second = Connection(HostLink(core), session=1), Connection(HostLink(core), session=2)
    table = image(50, seed=1)
    begin = m.begin(1, table.table_id, table.crc32, len(table.rows))
    first.run(first.session.ask(Kind.BEGIN, begin, m.Acknowledged))
    first.run(first.session.ask(Kind.CHUNK, m.chunk(1, table.table_id, 0, table.image[:512]), m.Acknowledged))
    other = image(30, seed=2)
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
    table = image(50, seed=1)
    first.run(first.session.ask(Kind.BEGIN, m.begin(1, table.table_id, table.crc32, 50), m.Acknowledged))
    core.tick(np.zeros(2001, dtype=np.int32))
    second.run(second.session.push(table, second.device))
    assert core.image() == table.image


def test_abort_frees_the_device_at_once_and_only_for_the_host_that_was_sending() -> None:
    core = host_core()
    first, second = Connection(HostLink(core), session=1), Connection(HostLink(core), session=2)
    table, other = image(50, seed=1), image(30, seed=2)
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
    push(coupling(5), HostLink(core))
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


@pytest.mark.parametrize(("interface", "who"), [(1, "the firmware"), (3, "avc-casadi")])
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


def test_a_table_that_changes_while_it_is_read_back_is_said_to() -> None:
    dialogue = Session(1, timeout_s=0.1).read_table(40, 20)
    step = next(dialogue)
    for table_id, offset in ((7, 0), (8, 20)):
        (asked,) = [frame for frame in Decoder().feed(step.data) if frame.type == Kind.READBACK]
        if offset:
            with pytest.raises(LinkError, match="changed while it was read back"):
                dialogue.send((asked.sequence, m.Readback(table_id, offset, bytes(20))))
        else:
            step = dialogue.send((asked.sequence, m.Readback(table_id, offset, bytes(20))))


def test_a_table_read_back_is_compared_byte_by_byte() -> None:
    """The right name over one wrong byte, as often as it is tried, is no success."""
    table = TableImage.of(coupling(8))
    spoilt = table.image[:-1] + bytes([table.image[-1] ^ 1])

    class Spoiling(Session):
        def read_table(self, size: int, part: int) -> Generator[Exchange, Any, tuple[int, bytes]]:
            yield from super().read_table(size, part)
            return table.table_id, spoilt

    connection = Connection(HostLink(host_core()))
    with pytest.raises(LinkError, match="differs from the one sent"):
        connection.run(Spoiling(5, timeout_s=0.1).push(table, connection.device))


def test_no_more_than_the_window_is_sent_at_once() -> None:
    connection = Connection(HostLink(host_core()))
    narrow = dataclasses.replace(connection.device, window_bytes=600)
    sizes = []

    def watched() -> Generator[Exchange, Any, Any]:
        dialogue = connection.session.push(TableImage.of(coupling(120)), narrow)
        step = next(dialogue)
        while True:
            sizes.append(len(step.data))
            try:
                step = dialogue.send((yield step))
            except StopIteration as end:
                return end.value

    assert connection.run(watched()).attempts == 1
    assert 300 < max(sizes) <= 600


def test_a_busy_device_is_given_time() -> None:
    device = Connection(HostLink(host_core())).device
    dialogue = Session(1, timeout_s=0.1).push(TableImage.of(coupling(8)), device)
    (begin,) = Decoder().feed(next(dialogue).data)
    step = dialogue.send((begin.sequence, Refusal(Reason.BUSY, 2)))
    assert step.data == b""
    assert step.timeout_s > 0.5
