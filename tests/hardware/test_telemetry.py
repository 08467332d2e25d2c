"""Telemetry: records of the device's own ticks, lost ones seen by it; logs whole at any moment; heartbeats."""

import ast
import csv
import inspect
import io
import itertools
import json
import os
import signal
import sys
import textwrap
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from avc_process import strict_json
from faulty_link import FaultyLink, LinkFault
from hardware_bench import coupling, host_core, push, require, with_gains
from host_device import HostCore, HostLink
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader

import avc_hardware
from avc_casadi import InputError, MissingExtraError, UnsupportedError, load_problem
from avc_casadi.cli import main, operate
from avc_casadi.identification.read import read_columns
from avc_hardware import Connection, DeviceStatus, EmulatedBoard, LivePlot, TelemetrySample, monitor, open_log
from avc_hardware.link import messages as m
from avc_hardware.link.faults import Refusal
from avc_hardware.link.frames import Frame, encode
from avc_hardware.link.messages import Kind, parse
from avc_hardware.link.telemetry import Samples, Telemetry

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


@pytest.mark.thorough
def test_a_line_that_is_too_slow_drops_records_and_still_answers() -> None:
    require("unicorn")
    board = EmulatedBoard()
    samples = list(monitor(board, rate_hz=1000, seconds=0.5))
    lost = sum(sample.lost for sample in samples)
    assert 100 < len(samples) < 150
    assert samples[-1].ticks - samples[0].ticks == len(samples) - 1 + lost
    connection = Connection(board)
    connection.run(connection.session.ask(Kind.SUBSCRIBE, m.subscribe(1, 2000), m.Subscribed))
    for _ in range(20):
        before = board.now_s()
        connection.run(connection.session.ask(Kind.STATUS, b"", DeviceStatus))
        assert board.now_s() - before < 0.1


def test_a_subscription_that_nobody_renews_ends() -> None:
    link = HostLink(pushed()[0])
    connection = Connection(link)
    connection.run(connection.session.ask(Kind.SUBSCRIBE, m.subscribe(7, 70), m.Subscribed))
    found = [connection.telemetry(0.1) for _ in range(12)]
    assert [message is not None for message in found] == [True] * 10 + [False] * 2
    assert [message.number for message in found if message] == list(range(10))
    answer = connection.run(connection.session.request(Kind.SUBSCRIBE, m.subscribe(7, 5001)))
    assert isinstance(answer, Refusal)
    assert "at most 5000 ticks" in str(answer)


@given(st.binary(max_size=300))
def test_any_payload_is_telemetry_or_dropped(payload: bytes) -> None:
    message = parse(Frame(Kind.TELEMETRY, 0, payload))
    assert message is None or (isinstance(message, Telemetry) and len(payload) == 20 + 44 * len(message.records))


def test_the_heartbeat_of_a_watching_host_ends_with_the_ramp() -> None:
    core, _ = pushed()
    way = np.rint(np.linspace(-100, 300, 60)).astype(np.int32)
    forces: list[float] = []
    link = HostLink(core, position=lambda tick: int(way[min(tick, 59)]), on_force=forces.append)
    ends: list[DeviceStatus] = []
    samples = list(monitor(link, rate_hz=50, seconds=1.5, heartbeat_s=0.05, on_end=ends.append))
    assert {sample.mode for sample in samples} == {"table"}
    assert samples[-1].force_n > 5.0
    assert [(end.mode, end.force_n, end.heartbeats_missed) for end in ends] == [("safe", 0.0, 1)]
    falling = np.array(forces[-110:])
    assert np.abs(np.diff(falling)).max() < 1.5 * samples[-1].force_n / 100
    assert {sample.mode for sample in monitor(link, rate_hz=50, seconds=0.2, heartbeat_s=0.05)} == {"safe"}
    core.tick(np.full(30, -100, dtype=np.int32))
    link._position = lambda _: -100
    assert [*monitor(link, rate_hz=50, seconds=0.1, heartbeat_s=0.05)][-1].mode == "table"
    for wrong in (0.0, 5.1, float("nan")):
        with pytest.raises(InputError, match="at most 5"):
            next(monitor(link, heartbeat_s=wrong))


@pytest.mark.parametrize(("rate_hz", "least"), [(5.0, 0.028), (150.0, 0.04), (220.0, 0.109)])
def test_a_heartbeat_that_the_line_cannot_keep_is_refused_and_the_least_one_holds(rate_hz: float, least: float) -> None:
    core, _ = pushed()
    link = HostLink(core, position=lambda _: -100)
    with pytest.raises(InputError, match=f"allowed: {least:g} to 5 s: 3 heartbeats") as caught:
        next(monitor(link, rate_hz=rate_hz, heartbeat_s=least - 1e-3))
    assert caught.value.faults[0].key == "heartbeat_s"
    samples = monitor(link, rate_hz=rate_hz, seconds=3.0, heartbeat_s=least)
    assert {sample.mode for sample in samples} == {"table"}


def test_a_heartbeat_below_a_tick_is_named_as_it_was_typed(capsys: pytest.CaptureFixture[str]) -> None:
    require("unicorn")
    assert main(["monitor", "--port", "emulator", "--heartbeat", "1e-4", "--seconds", "1"]) == 2
    assert "--heartbeat: 0.0001 s; allowed: 0.028 to 5 s" in capsys.readouterr().err


def test_interrupt_ends_the_heartbeat_and_keeps_log_and_samples(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    require("unicorn")
    before = signal.getsignal(signal.SIGINT)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    take, messages = Samples.take, itertools.count(1)

    def interrupted_at_the_tenth(self: Samples, message: Telemetry) -> list[TelemetrySample]:
        if next(messages) == 10:
            os.kill(os.getpid(), signal.SIGINT)
        return take(self, message)

    monkeypatch.setattr(Samples, "take", interrupted_at_the_tenth)
    log = tmp_path / "log.csv"
    arguments = ["monitor", "--port", "emulator", "--rate-hz", "100", "--heartbeat", "--out", str(log)]
    try:
        assert main([*arguments, "--seconds", "1000", "--json"]) == 130
    finally:
        signal.signal(signal.SIGINT, before)
    document: dict[str, Any] = strict_json(capsys.readouterr().out.encode())
    assert document["errors"][0]["message"] == "interrupted"
    assert document["ended"]["mode"] == "safe"
    assert "carries over" in document["note"]
    assert document["records"] == len(document["samples"]) == len(log.read_text().splitlines()) - 2 > 5


def lines_of_the_loop(function: Callable[..., Any]) -> list[int]:
    """The lines of every statement within the first loop of a function."""
    source, first = inspect.getsourcelines(function)
    (loop, *_) = (node for node in ast.walk(ast.parse(textwrap.dedent("".join(source)))) if isinstance(node, ast.For))
    return sorted(
        {first - 1 + node.lineno for step in loop.body for node in ast.walk(step) if isinstance(node, ast.stmt)}
    )


@contextmanager
def killed_at(code: CodeType, line: int, *, after: int) -> Iterator[list[int]]:
    """Send this process SIGINT when it comes to a line of a function for the so-manieth time; list where it did."""
    left = after
    sent: list[int] = []

    def watch(frame: FrameType, event: str, _: object) -> Any:
        nonlocal left
        if frame.f_code is code and event == "line" and frame.f_lineno == line:
            left -= 1
            if left == 0:
                sent.append(line)
                os.kill(os.getpid(), signal.SIGINT)
        return watch if frame.f_code is code else None

    before = sys.gettrace()
    sys.settrace(watch)
    try:
        yield sent
    finally:
        sys.settrace(before)


def test_an_interrupt_at_any_line_leaves_no_record_half_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    core, _ = pushed()
    link = HostLink(core, position=lambda _: -100)
    taken = list(monitor(link, rate_hz=100, seconds=0.1))

    def played(*_: object, on_device: Callable[[Any], None], **__: object) -> Generator[TelemetrySample, None, None]:
        on_device(Connection(link).device)
        yield from taken

    monkeypatch.setattr("avc_hardware.monitor", played)
    body = [line for line in lines_of_the_loop(operate.run_monitor) for _ in range(2)]
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    kept = []
    try:
        for turn, line in enumerate(body):
            log = tmp_path / f"{turn}.csv"
            with killed_at(operate.run_monitor.__code__, line, after=3 + turn % 2) as sent:
                code = main(["monitor", "--port", "emulator", "--out", str(log), "--json"])
            assert code == (130 if sent else 0)  # no plot, no break
            document = strict_json(capsys.readouterr().out.encode())
            assert document["records"] == len(document["samples"]) == len(log.read_text().splitlines()) - 2
            kept += [document["records"]] if sent else []
    finally:
        signal.signal(signal.SIGINT, before)
    assert len(kept) > len(body) / 2
    assert min(kept) < max(kept) < len(taken)


@pytest.fixture(scope="module")
def seen() -> list[TelemetrySample]:
    return list(monitor(HostLink(pushed()[0], position=tap), rate_hz=1000, seconds=0.4))


def test_a_csv_log_is_whole_after_every_record_and_is_read_as_any_other(
    tmp_path: Path, seen: list[TelemetrySample]
) -> None:
    path = tmp_path / "log.csv"
    with open_log(path) as log:
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


def test_an_mcap_log_can_be_read_though_it_was_never_ended(tmp_path: Path, seen: list[TelemetrySample]) -> None:
    path = tmp_path / "log.mcap"
    log = open_log(path)
    for sample in seen:
        log.write(sample)
    with path.open("rb") as file:
        reader = StreamReader(file).records
        found = [next(reader) for _ in range(3 + len(seen))][3:]
    assert [json.loads(record.data)["tick"] for record in found] == [sample.ticks for sample in seen]
    log.close()
    with path.open("rb") as file:
        whole = [json.loads(message.data) for _, _, message in make_reader(file).iter_messages()]
    assert [row["position_um"] for row in whole] == pytest.approx([1e6 * sample.position_m for sample in seen])


def test_a_log_that_cannot_be_written_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match=r"\.csv or \.mcap"):
        open_log(tmp_path / "log.txt")
    with pytest.raises(InputError, match="cannot be written"):
        open_log(tmp_path / "nowhere" / "log.csv")
    monkeypatch.setitem(__import__("sys").modules, "mcap.writer", None)
    with pytest.raises(MissingExtraError, match=r"avc-casadi\[mcap\]"):
        open_log(tmp_path / "log.mcap")


def test_a_log_of_before_outlives_a_port_that_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / "log.csv"
    log.write_text("precious\n")
    assert main(["monitor", "--port", "/dev/none", "--out", str(log)]) == 2
    assert log.read_text() == "precious\n"
    told = capsys.readouterr()
    assert told.out == ""
    assert "/dev/none: cannot be opened" in told.err


def test_the_plot_follows_the_samples(seen: list[TelemetrySample]) -> None:
    with LivePlot(span_s=0.2, figure=Figure()) as plot:
        for sample in seen:
            plot.take(sample)
        plot.draw()
    times, positions = plot.figure.axes[0].lines[0].get_data()
    shown = [sample for sample in seen if sample.time_s >= seen[-1].time_s - 0.2]
    assert list(times) == [sample.time_s for sample in shown]
    assert list(positions) == [1e3 * sample.position_m for sample in shown]


def test_without_a_display_the_plot_names_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(UnsupportedError, match=r"no display for --plot; write a log instead \(--out log.csv"):
        LivePlot()
    monkeypatch.setenv("DISPLAY", ":7")
    monkeypatch.setattr(mpl, "rcParams", mpl.rcParams | {"backend": "agg"})
    with pytest.raises(UnsupportedError, match="pip install PyQt6"):
        LivePlot()


def test_old_frames_of_a_restarted_device_are_not_taken_for_lost_records() -> None:
    core = host_core()
    push(coupling(3), HostLink(core))
    link = HostLink(core)
    samples = monitor(link, rate_hz=200, seconds=3.0)
    first = [next(samples) for _ in range(20)]
    core.reset()
    core.write(encode(Frame(99, 0, b"")))
    rest = [next(samples) for _ in range(20)]
    assert {sample.boot_id for sample in first} == {1}
    assert rest[-1].boot_id == 2
    assert not any(sample.lost for sample in first + rest)
    samples.close()  # type: ignore[attr-defined]
    assert avc_hardware.LOG_ENDINGS == (".csv", ".mcap")
