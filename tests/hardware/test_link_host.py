"""What does not fit the device is refused by the host before a byte of the table travels, and named."""

import struct
import zlib
from collections.abc import Generator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hardware_bench import (
    believer,
    bench_problem,
    coupling,
    dense_believer,
    host_core,
    host_library,
    image,
    push,
    refused,
    unwatched,
)
from host_device import HostCore, HostLink
from quick import first

import avc_hardware
from avc_casadi import InputError, LinkError, NotDeployableError, load_problem
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import Gains
from avc_casadi.model.runtime import Runtime, StateFeedback
from avc_hardware import Connection, TableImage
from avc_hardware.codegen.figures import Config
from avc_hardware.codegen.tick_program import packed_config
from avc_hardware.link import messages as m
from avc_hardware.link.faults import Refusal, RefusalReason
from avc_hardware.link.messages import Kind
from avc_hardware.link.push import push_over
from avc_hardware.link.session import Exchange, RefusedError


def test_wrong_sample_time_is_refused_on_both_sides() -> None:
    slow = coupling(3, sample_time_s=2e-3)
    assert refused(TableImage.of(slow)).reason is RefusalReason.SAMPLE_TIME
    with pytest.raises(LinkError, match="not sent: the coupling is for a sample time"):
        push(slow, HostLink(host_core()))


def test_safe_gains_are_judged_as_those_of_the_coupling_are() -> None:
    """Before a byte travels: with every hand of [hands] and released, on the loop of the coupling's problem."""
    made = Coupling.constant(load_problem("reference-r1"), Gains(0.0, 500.0, 4.0), "by hand")
    core = HostCore(host_library(), unwatched(max_force_n=8.0))
    with pytest.raises(NotDeployableError):
        avc_hardware.push(made, HostLink(core), safe=Gains(0.0, 3e3))
    with pytest.raises(InputError, match=r"safe\.contact_damping_ns_per_m: is 4"):
        avc_hardware.push(made, HostLink(core), safe=Gains(0.0, 100.0, 4.0))
    assert core.image() is None
    avc_hardware.push(made, HostLink(core), safe=Gains(0.0, 100.0))
    assert core.image() is not None


@pytest.mark.parametrize(
    ("limit", "column", "words"),
    first(
        [
            ("max_damping_ns_per_m", 1, "damping b is"),
            ("max_stiffness_n_per_m", 2, "stiffness k is"),
            ("max_contact_damping_ns_per_m", 3, "contact damping b_p is"),
        ]
    ),
)
def test_host_sends_nothing_above_any_one_limit(limit: str, column: int, words: str) -> None:
    """The largest gain of the table passes; the limit a little lower is named before a byte of the table travels."""
    made = coupling(9, largest=(80.0, 5e3, 60.0), wall=(1.0, 1e3))
    largest = float(np.float32(made.table.rows[:, column].max()))
    core = HostCore(host_library(), unwatched(**{limit: largest}))
    assert push(made, HostLink(core)).rows == 9
    core = HostCore(host_library(), unwatched(**{limit: 0.999 * largest}))
    with pytest.raises(LinkError, match=f"not sent: {words}") as caught:
        push(made, HostLink(core))
    assert str(caught.value).count("narrow") == 1
    assert core.image() is None
    # Of many rows above it the worst is named.
    core = HostCore(host_library(), unwatched(**{limit: 0.3 * largest}))
    with pytest.raises(LinkError, match=f"{words} {largest:.6g} "):
        push(made, HostLink(core))


def test_what_no_hand_could_hold_is_refused_before_a_port_is_opened() -> None:
    for verb in (avc_hardware.push, avc_hardware.stream):
        with pytest.raises(NotDeployableError):
            verb(coupling(5), "/dev/does-not-exist")
    with pytest.raises(NotDeployableError):
        avc_hardware.export_c(coupling(5))


def test_settings_of_the_coupling_come_with_it_and_those_of_the_device_stay() -> None:
    """Hold, slew and the guard's limit are sent and read back; a bound device keeps its limits for ever."""
    core = host_core()
    runtime = Runtime(hold_s=0.3, slew_per_s=None, guard="passivity-controller")
    found = push(coupling(5, runtime=runtime, damping_ns_per_m=1.5), HostLink(core)).device
    assert (found.figures.hold_s, found.figures.slew_per_s, found.figures.guard_damping_ns_per_m) == (0.3, None, 1.5)
    assert (found.bound, found.limits) == (True, unwatched())
    other = Config(unwatched(max_force_n=8.0), found.figures)
    connection = Connection(HostLink(core))
    for config, told in (
        (packed_config(other), "of another device"),
        (packed_config(other)[:-1] + b"?", "the checksum"),
    ):
        with pytest.raises(LinkError, match=told):
            connection.run(connection.session.push(replace(image(5), config=config), connection.device))
        assert Connection(HostLink(core)).device.config_crc32 == found.config_crc32
    assert push(coupling(5), HostLink(core)).device.figures.hold_s == 0.2


# What was pushed is what runs and what the device tells of itself: wall, force limit, names, mode.


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


def test_device_names_the_coupling_and_takes_the_lower_force_limit() -> None:
    """The wall of a second coupling is its own; nothing of the first is left."""
    core = HostCore(host_library(), unwatched(max_force_n=20.0))
    connection = Connection(HostLink(core))
    assert connection.device.coupling_id == ""
    for limit, told in ((5.0, 5.0), (20.0, 20.0), (None, 20.0), (50.0, 20.0)):
        made = coupling(1, largest=(10.0, 1e5, 0.0), wall=(0.0, 1e5 + (limit or 0.0)), max_force_n=limit)
        if limit == 50.0:
            with pytest.raises(LinkError, match="a force limit of 50, the device gives 20"):
                push_over(connection, made)
        result = push_over(connection, made, unsafe=True)
        assert result.max_force_n == told
        assert ("its certificate does not know" in " ".join(result.notes)) == (limit == 50.0)
        force, _ = core.tick(np.full(50, 5000, dtype=np.int32))
        assert force[-1] == np.float32(told)
        device = connection.run(connection.session.hello())
        assert (device.coupling_id, device.max_force_n) == (made.id, 20.0)
        assert result.coupling_id == made.id


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


# State feedback on the wire: its bytes as documented, and what of it is refused, by the host and by the device.

AT_HEADER, AT_FEEDBACK = 0xFFFF, 0xFFFE
# Of the image of `made`: flags, measures, positions, dead zone, face, share kept, smoothing; first of A, last of R.
FLAGS, MEASURES, POSITIONS, DEAD_ZONE, FACE, KEPT, SMOOTHING = 2, 48, 50, 52, 56, 72, 76
FIRST, LAST = 80, 80 + 4 * (9 + 9) - 4


def made(feedback: StateFeedback | None) -> Coupling:
    return Coupling.constant(bench_problem(), Gains(3.0, 4e4, 5.0), "by hand", Runtime(state_feedback=feedback))


def link_state_feedback_refused(image: bytes, rows: int, states: int) -> Refusal:
    """Send bytes with a right checksum past the host's own checks; return the device's refusal."""
    core = host_core()
    connection = Connection(HostLink(core), session=1)
    crc32 = zlib.crc32(image)

    def push_as_it_is() -> Generator[Exchange, Any, None]:
        ask = connection.session.ask
        yield from ask(Kind.BEGIN, m.begin(1, 5, crc32, rows, states), m.Acknowledged)
        yield from ask(Kind.CHUNK, m.words(1, 5, 0) + image, m.Acknowledged)
        yield from ask(Kind.COMMIT, m.words(1, 5, crc32), m.Committed)

    with pytest.raises(RefusedError) as caught:
        connection.run(push_as_it_is())
    assert core.image() is None
    return caught.value.refusal


def test_bytes_of_a_table_are_those_of_the_document() -> None:
    feedback = dense_believer(4)
    table = TableImage.of(made(feedback))
    plain = TableImage.of(made(None))
    header = struct.pack("<6fI", 1e-3, 10.0, 1e5, 0.0, 0.0, table.max_force_n, table.coupling_id)
    assert table.image[:32] == struct.pack("<HH", 1, 4 << 8 | 8) + header
    assert plain.image[:4] == struct.pack("<HH", 1, 8)
    gated = made(None).problem.changed(coupling={"contact": "gated"})
    assert TableImage.of(made(None).for_problem(gated)).image[:4] == struct.pack("<HH", 1, 0)
    assert table.image[36:48] == struct.pack("<3f", 3.0, 4e4, 5.0)
    positions = sum(1 << place for place in feedback.positions)
    opens_m, open_m = feedback.opens_m, feedback.open_m
    follows = struct.pack("<HH2f", feedback.measures, positions, feedback.dead_zone_m, feedback.face_m)
    follows += struct.pack("<5f", opens_m, open_m, 1 / (open_m - opens_m), feedback.kept, feedback.smoothing)
    for numbers in (*feedback.state, feedback.force_m_per_n, feedback.innovation, feedback.feedback):
        follows += struct.pack("<4f", *numbers)
    assert table.image[48:] == follows
    assert len(plain.image) == 48
    assert plain.image[32:48] == table.image[32:48]
    assert plain.states == 0


@pytest.mark.parametrize(("rows", "states"), [(1, 17), (2, 1), (256, 8), (1, 65535)])
def test_device_refuses_more_states_than_it_holds_and_states_beside_rows(rows: int, states: int) -> None:
    refusal = link_state_feedback_refused(bytes(600), rows, states)
    assert refusal == Refusal(RefusalReason.STATES, 16)
    assert "at most 16" in str(refusal)


@pytest.mark.parametrize(
    ("place", "change", "reason"),
    [
        (FIRST, struct.pack("<f", np.nan), Refusal(RefusalReason.NOT_FINITE, AT_FEEDBACK)),
        (LAST, struct.pack("<f", np.inf), Refusal(RefusalReason.NOT_FINITE, AT_FEEDBACK)),
        (DEAD_ZONE, struct.pack("<f", np.nan), Refusal(RefusalReason.NOT_FINITE, AT_FEEDBACK)),
        (DEAD_ZONE, struct.pack("<f", -1e-6), Refusal(RefusalReason.LIMIT, AT_FEEDBACK)),
        (FACE, struct.pack("<f", -1e-6), Refusal(RefusalReason.LIMIT, AT_FEEDBACK)),
        (FACE, struct.pack("<f", -np.inf), Refusal(RefusalReason.NOT_FINITE, AT_FEEDBACK)),
        (KEPT, struct.pack("<f", 1.001), Refusal(RefusalReason.LIMIT, AT_FEEDBACK)),
        (SMOOTHING, struct.pack("<f", 1.001), Refusal(RefusalReason.LIMIT, AT_FEEDBACK)),
        (SMOOTHING, struct.pack("<f", np.nan), Refusal(RefusalReason.NOT_FINITE, AT_FEEDBACK)),
        (MEASURES, struct.pack("<H", 1), Refusal(RefusalReason.LIMIT, AT_FEEDBACK)),
        (MEASURES, struct.pack("<H", 3), Refusal(RefusalReason.LIMIT, AT_FEEDBACK)),
        (MEASURES, struct.pack("<H", 65535), Refusal(RefusalReason.LIMIT, AT_FEEDBACK)),
        (POSITIONS, struct.pack("<H", 0), Refusal(RefusalReason.LIMIT, AT_FEEDBACK)),
        (POSITIONS, struct.pack("<H", 9), Refusal(RefusalReason.LIMIT, AT_FEEDBACK)),
        (FLAGS, struct.pack("<H", 3 << 8 | 2), Refusal(RefusalReason.LIMIT, AT_HEADER)),
    ],
)
def test_device_refuses_what_its_tick_could_not_run(place: int, change: bytes, reason: Any) -> None:
    image = bytearray(TableImage.of(made(believer(2))).image)
    assert len(image) == LAST + 4
    image[place : place + len(change)] = change
    refusal = link_state_feedback_refused(bytes(image), 1, 3)
    assert refusal == reason
    assert ("state feedback" in str(refusal)) == (refusal.detail == AT_FEEDBACK)
