"""Telemetry: records of the device's own ticks, lost ones seen by it; logs whole at any moment; heartbeats."""

import csv
import io
import itertools
from pathlib import Path

import numpy as np
import pytest
from faulty_link import FaultyLink, LinkFault
from hardware_bench import host_core, push, with_gains
from host_device import HostCore, HostLink
from hypothesis import given, settings
from hypothesis import strategies as st

from avc_casadi import InputError, load_problem
from avc_casadi.identification.read import read_columns
from avc_hardware import Connection, DeviceFault, DeviceStatus, TelemetryLog, TelemetrySample, clear_faults, monitor
from avc_hardware.link import messages as m
from avc_hardware.link.faults import Refusal
from avc_hardware.link.frames import Frame
from avc_hardware.link.messages import Kind, parse
from avc_hardware.link.telemetry import Telemetry

WALL = with_gains(load_problem("damped"), 50.0, 2e4, 20.0)


def tap(tick: int) -> int:
    return round(300 * np.sin(2 * np.pi * 5e-3 * tick)) - 100


def pushed() -> tuple[HostCore, list[tuple[int, float]]]:
    """A device that taps its wall, and what each of its ticks put out."""
    core = host_core()
    push(WALL, HostLink(core))
    return core, []


@settings(max_examples=15, deadline=None)
@given(every=st.integers(1, 60), start=st.integers(0, 200))
def test_every_record_is_the_tick_that_it_names_and_watching_changes_nothing(every: int, start: int) -> None:
    watched, alone = pushed()[0], pushed()[0]
    forces: dict[int, tuple[float, int]] = {}
    link = HostLink(watched, position=lambda tick: tap(tick + start))
    link._on_force = lambda force: forces.__setitem__(watched.state().ticks, (force, watched.state().encoder_count))
    samples = list(monitor(link, rate_hz=1000 / every, seconds=0.3))
    assert {b.ticks - a.ticks for a, b in itertools.pairwise(samples)} <= {every}
    assert len(samples) == 300 // every + 1
    assert not any(sample.lost for sample in samples)
    for sample in samples:
        assert (np.float32(sample.force_n), sample.encoder_count) == forces[sample.ticks]
        assert sample.time_s == pytest.approx(sample.ticks * 1e-3)
        assert sample.position_m == pytest.approx(sample.encoder_count * 2e-6)
        assert (sample.coupling_id, sample.mode) == (WALL.id, "table")
    unseen, _ = alone.tick(np.array([tap(tick + start) for tick in range(len(forces))], dtype=np.int32))
    assert unseen.tolist() == [force for force, _ in forces.values()]


@settings(max_examples=15, deadline=None)
@given(
    st.lists(
        st.builds(
            LinkFault, st.just(False), st.integers(300, 4000), st.sampled_from(["flip", "drop"]), st.integers(1, 60)
        ),
        max_size=6,
    )
)
def test_a_lost_message_is_seen_by_its_ticks(faults: list[LinkFault]) -> None:
    link = FaultyLink(HostLink(pushed()[0], position=tap), faults)
    samples = list(monitor(link, rate_hz=250, seconds=0.5))
    for before, after in itertools.pairwise(samples):
        assert after.ticks - before.ticks == 4 * (1 + after.lost)
    assert sum(1 + sample.lost for sample in samples[1:]) >= 125


def test_a_subscription_that_nobody_renews_ends() -> None:
    link = HostLink(pushed()[0])
    connection = Connection(link)
    connection.run(connection.session.ask(Kind.SUBSCRIBE, m.words(7, 70), m.Acknowledged))
    found = [connection.telemetry(0.1) for _ in range(12)]
    assert [message is not None for message in found] == [True] * 10 + [False] * 2
    answer = connection.run(connection.session.request(Kind.SUBSCRIBE, m.words(7, 5001)))
    assert isinstance(answer, Refusal)
    assert "at most 5000 ticks" in str(answer)


@given(st.binary(max_size=300))
def test_any_payload_is_telemetry_or_dropped(payload: bytes) -> None:
    message = parse(Frame(Kind.TELEMETRY, 0, payload))
    assert message is None or (isinstance(message, Telemetry) and len(payload) == 12 + 44 * len(message.records))


def test_the_heartbeat_of_a_watching_host_ends_with_the_ramp() -> None:
    core, _ = pushed()
    way = np.rint(np.linspace(-100, 300, 60)).astype(np.int32)
    forces: list[float] = []
    link = HostLink(core, position=lambda tick: int(way[min(tick, 59)]), on_force=forces.append)
    ends: list[DeviceStatus] = []
    samples = list(monitor(link, rate_hz=50, seconds=1.5, heartbeat_s=0.05, on_end=ends.append))
    assert {sample.mode for sample in samples} == {"table"}
    assert samples[-1].force_n > 5.0
    assert [(end.mode, end.force_n) for end in ends] == [("safe", 0.0)]
    falling = np.array(forces[-110:])
    assert np.abs(np.diff(falling)).max() < 1.5 * samples[-1].force_n / 100
    assert {sample.mode for sample in monitor(link, rate_hz=50, seconds=0.2, heartbeat_s=0.05)} == {"safe"}
    core.tick(np.full(30, -100, dtype=np.int32))
    link._position = lambda _: -100
    assert [*monitor(link, rate_hz=50, seconds=0.1, heartbeat_s=0.05)][-1].mode == "table"
    assert {sample.mode for sample in monitor(link, rate_hz=50, seconds=2.0)} == {"safe"}  # nobody asked for its end
    cleared = clear_faults(link)
    assert (cleared.were, cleared.left, cleared.status.mode) == (DeviceFault.HEARTBEAT, DeviceFault(0), "table")
    link._position = lambda _: 300
    assert [*monitor(link, rate_hz=50, seconds=6.0)][-1].force_n > 5.0
    for wrong in (0.0, 5.1, float("nan")):
        with pytest.raises(InputError, match="at most 5"):
            next(monitor(link, heartbeat_s=wrong))


@pytest.fixture(scope="module")
def seen() -> list[TelemetrySample]:
    return list(monitor(HostLink(pushed()[0], position=tap), rate_hz=1000, seconds=0.4))


def test_a_csv_log_is_whole_after_every_record_and_is_read_as_any_other(
    tmp_path: Path, seen: list[TelemetrySample]
) -> None:
    path = tmp_path / "log.csv"
    with TelemetryLog(path) as log:
        for count, sample in enumerate(seen, start=1):
            log.write(sample)
            if count in {1, 7, len(seen)}:  # as a program that is killed would leave it
                lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
                rows = list(csv.DictReader(io.StringIO("\n".join(lines))))
                assert [int(row["tick"]) for row in rows] == [one.ticks for one in seen[:count]]
    assert float(rows[-1]["force_N"]) == pytest.approx(-seen[-1].force_n)
    columns = read_columns(path)
    assert columns.position_m == pytest.approx([sample.position_m for sample in seen], abs=1e-12)
    assert columns.force_n == pytest.approx([-sample.force_n for sample in seen])
