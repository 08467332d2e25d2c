"""State feedback on the wire: its bytes as documented, and what of it is refused, by the host and by the device."""

import struct
import zlib
from collections.abc import Generator
from typing import Any

import numpy as np
import pytest
from hardware_bench import believer, bench_problem, coupling, dense_believer, host_core, push
from host_device import HostLink

from avc_casadi import UnsupportedError
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import Gains
from avc_casadi.model.runtime import Runtime, StateFeedback
from avc_hardware import Connection, TableImage, check_runs_on
from avc_hardware.codegen.firmware_fit import FEEDBACK_STATES
from avc_hardware.link import messages as m
from avc_hardware.link.faults import Reason, Refusal
from avc_hardware.link.messages import Kind
from avc_hardware.link.session import Exchange, RefusedError

AT_HEADER, AT_FEEDBACK = 0xFFFF, 0xFFFE
# Of the image of `made`: flags, measures, positions, dead zone, face, first number of A, last number of R.
FLAGS, MEASURES, POSITIONS, DEAD_ZONE, FACE, FIRST, LAST = 2, 48, 50, 52, 56, 60, 60 + 4 * (9 + 9) - 4


def made(feedback: StateFeedback | None) -> Coupling:
    return Coupling.constant(bench_problem(), Gains(3.0, 4e4, 5.0), "by hand", Runtime(state_feedback=feedback))


def refused(image: bytes, rows: int, states: int) -> Refusal:
    """Send bytes with a right checksum past the host's own checks; return the device's refusal."""
    core = host_core()
    connection = Connection(HostLink(core), session=1)
    crc32 = zlib.crc32(image)

    def push_as_it_is() -> Generator[Exchange, Any, None]:
        ask = connection.session.ask
        yield from ask(Kind.BEGIN, m.begin(1, 5, crc32, rows, states), m.Acknowledged)
        yield from ask(Kind.CHUNK, m.chunk(1, 5, 0, image), m.Acknowledged)
        yield from ask(Kind.COMMIT, m.commit(1, 5, crc32), m.Committed)

    with pytest.raises(RefusedError) as caught:
        connection.run(push_as_it_is())
    assert core.image() is None
    return caught.value.refusal


def test_bytes_of_a_table_are_those_of_the_document() -> None:
    feedback = dense_believer(4)
    table = TableImage.of(made(feedback))
    plain = TableImage.of(made(None))
    header = struct.pack("<6fI", 1e-3, 10.0, 1e5, 0.0, 0.0, table.max_force_n, table.coupling_id)
    assert table.image[:32] == struct.pack("<HH", 1, 4 << 8 | 8 | 1) + header
    assert plain.image[:4] == struct.pack("<HH", 1, 8 | 1)
    gated = made(None).problem.changed(coupling={"contact": "gated"})
    assert TableImage.of(made(None).on(gated)).image[:4] == struct.pack("<HH", 1, 1)
    assert table.image[36:48] == struct.pack("<3f", 3.0, 4e4, 5.0)
    positions = sum(1 << place for place in feedback.positions)
    follows = struct.pack("<HH2f", feedback.measures, positions, feedback.dead_zone_m, feedback.face_m)
    for numbers in (*feedback.state, feedback.force_m_per_n, feedback.innovation, feedback.feedback):
        follows += struct.pack("<4f", *numbers)
    assert table.image[48:] == follows
    assert len(plain.image) == 48
    assert plain.image[32:48] == table.image[32:48]
    assert plain.states == 0


@pytest.mark.parametrize(
    ("refuse", "named"),
    [
        (
            made(dense_believer(9)),
            r"it holds 8 states of an observer, the coupling has 9 .* design it with a simpler .*avc export",
        ),
        (coupling(5, runtime=Runtime(state_feedback=believer(1))), "beside constant gains alone .*avc export"),
        (coupling(5, runtime=Runtime(state_feedback=dense_believer(16))), "the coupling has 16 .*constant gains alone"),
    ],
    ids=["too many", "varying", "both"],
)
def test_what_does_not_fit_is_refused_by_name_before_a_port_is_opened(refuse: Coupling, named: str) -> None:
    for attempt in (check_runs_on, lambda found: push(found, "/dev/does-not-exist")):
        with pytest.raises(UnsupportedError, match=named):
            attempt(refuse)


@pytest.mark.parametrize(("rows", "states"), [(1, 9), (2, 1), (256, 8), (1, 65535)])
def test_device_refuses_more_states_than_it_holds_and_states_beside_rows(rows: int, states: int) -> None:
    refusal = refused(bytes(600), rows, states)
    assert refusal == Refusal(Reason.STATES, FEEDBACK_STATES)
    assert "at most 8" in str(refusal)


@pytest.mark.parametrize(
    ("place", "change", "reason"),
    [
        (FIRST, struct.pack("<f", np.nan), Refusal(Reason.NOT_FINITE, AT_FEEDBACK)),
        (LAST, struct.pack("<f", np.inf), Refusal(Reason.NOT_FINITE, AT_FEEDBACK)),
        (DEAD_ZONE, struct.pack("<f", np.nan), Refusal(Reason.NOT_FINITE, AT_FEEDBACK)),
        (DEAD_ZONE, struct.pack("<f", -1e-6), Refusal(Reason.LIMIT, AT_FEEDBACK)),
        (FACE, struct.pack("<f", -1e-6), Refusal(Reason.LIMIT, AT_FEEDBACK)),
        (FACE, struct.pack("<f", -np.inf), Refusal(Reason.NOT_FINITE, AT_FEEDBACK)),
        (MEASURES, struct.pack("<H", 1), Refusal(Reason.LIMIT, AT_FEEDBACK)),
        (MEASURES, struct.pack("<H", 3), Refusal(Reason.LIMIT, AT_FEEDBACK)),
        (MEASURES, struct.pack("<H", 65535), Refusal(Reason.LIMIT, AT_FEEDBACK)),
        (POSITIONS, struct.pack("<H", 0), Refusal(Reason.LIMIT, AT_FEEDBACK)),
        (POSITIONS, struct.pack("<H", 9), Refusal(Reason.LIMIT, AT_FEEDBACK)),
        (FLAGS, struct.pack("<H", 3 << 8 | 2), Refusal(Reason.LIMIT, AT_HEADER)),
    ],
)
def test_device_refuses_what_its_tick_could_not_run(place: int, change: bytes, reason: Any) -> None:
    image = bytearray(TableImage.of(made(believer(2))).image)
    assert len(image) == LAST + 4
    image[place : place + len(change)] = change
    refusal = refused(bytes(image), 1, 3)
    assert refusal == reason
    assert ("state feedback" in str(refusal)) == (refusal.detail == AT_FEEDBACK)
