"""What a session refuses and why: other hosts, other releases, streams without a table, answers that do not fit."""

import dataclasses
import math
import struct
from collections.abc import Generator
from typing import Any

import numpy as np
import pytest
from hardware_bench import coupling, host_core, push
from host_device import HostLink

from avc_casadi import LinkError
from avc_hardware import Connection, TableImage
from avc_hardware.link import messages as m
from avc_hardware.link.faults import INTERFACE_VERSION, Reason, Refusal
from avc_hardware.link.frames import Decoder, Frame, cobs_decode, encode
from avc_hardware.link.messages import Kind
from avc_hardware.link.session import Exchange, RefusedError, Session


def image(*arguments: Any, **options: Any) -> TableImage:
    return TableImage.of(coupling(*arguments, **options))


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
        connection.run(connection.session.ask(Kind.SET_GAINS, m.set_gains(1, 0, 60, 1.0, 1.0, 0.0), m.GainsTaken))


@pytest.mark.parametrize(("b", "reason"), [(np.nan, Reason.NOT_FINITE), (-1.0, Reason.LIMIT), (1e9, Reason.LIMIT)])
def test_streamed_gains_are_checked(b: float, reason: Reason) -> None:
    core = host_core()
    push(coupling(5), HostLink(core))
    connection = Connection(HostLink(core))
    payload = m.set_gains(int(coupling(5).id, 16), 0, 60, b, 1.0, 0.0)
    with pytest.raises(RefusedError) as caught:
        connection.run(connection.session.ask(Kind.SET_GAINS, payload, m.GainsTaken))
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


@pytest.mark.parametrize(("interface", "who"), [(5, "the firmware"), (INTERFACE_VERSION + 1, "avc-casadi")])
def test_firmware_of_another_interface_is_refused_with_advice(interface: int, who: str) -> None:
    core = host_core()
    device = dataclasses.replace(Connection(HostLink(core)).device, interface_version=interface)
    with pytest.raises(LinkError, match=f"update {who}"):
        answer(Session(1, timeout_s=0.1).hello(), device)


@pytest.mark.parametrize("time_s", [0.0, 1e-30, -1e-3, 3.0, math.inf, math.nan])
def test_a_sample_time_that_no_control_loop_has_is_refused(time_s: float) -> None:
    device = dataclasses.replace(Connection(HostLink(host_core())).device, sample_time_s=time_s)
    with pytest.raises(LinkError, match=r"sample time of .* allowed: 1e-06 to 1 s"):
        answer(Session(1, timeout_s=0.1).hello(), device)


def test_other_protocol_version_is_refused_both_ways() -> None:
    assert m.parse(Frame(Kind.HELLO | m.REPLY, 1, b"anything", version=2)) == Refusal(Reason.VERSION, 2)
    core = host_core()
    core.read()
    core.write(encode(Frame(Kind.HELLO, 5, m.hello(1), version=2)))
    assert core.read()


def test_host_of_another_interface_is_refused_by_the_device() -> None:
    core = host_core()
    core.read()
    core.write(encode(Frame(Kind.HELLO, 5, m.hello(1, interface_version=INTERFACE_VERSION + 1))))
    (answer,) = Decoder().feed(core.read())
    refusal = m.parse(answer)
    assert refusal == Refusal(Reason.INTERFACE, INTERFACE_VERSION)
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
    assert dialogue.send((sequence - 1, m.Committed(1, 2, 0))).data == b""
    with pytest.raises(StopIteration) as stop:
        dialogue.send((sequence, m.Committed(3, 4, 0)))
    assert stop.value.value == m.Committed(3, 4, 0)


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


@pytest.mark.parametrize("reason", [Reason.FLAGS, Reason.STATES, 4711])
def test_what_no_second_attempt_gets_over_is_refused_at_once(reason: int) -> None:
    core = host_core()
    connection = Connection(HostLink(core), session=1)
    pushed = connection.session.push(image(3), connection.device)
    exchange = pushed.send(None)
    sequence = Decoder().feed(exchange.data)[0].sequence
    with pytest.raises(RefusedError):
        pushed.send((sequence, Refusal(reason, 0)))
