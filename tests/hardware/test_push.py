"""Push, stream and monitor against the real firmware image on the emulated board."""

import hashlib
import json
import math
import sys

import numpy as np
import pytest
from faulty_link import FaultKind, FaultyLink, LinkFault
from hardware_bench import believer, bench_problem, coupling, push, require, stream, with_gains

import avc_hardware
from avc_casadi import InputError, LinkError, MissingExtraError, UnsupportedError
from avc_casadi.model.runtime import Runtime
from avc_hardware import EMULATOR_IS_FRESH, Connection, DeviceStatus, EmulatedBoard, RuntimeFigures, TableImage, monitor
from avc_hardware.codegen.boards import IMAGE, image_sha256
from avc_hardware.emulator.board import emulated_board
from avc_hardware.in_the_loop import tried_in_the_loop
from avc_hardware.link import messages as m
from avc_hardware.link.messages import Kind
from avc_hardware.link.table import lookup


@pytest.fixture(autouse=True)
def _emulator() -> None:
    require("unicorn")


@pytest.mark.thorough
def test_pushed_table_is_read_back_as_single_precision() -> None:
    made = coupling(200, seed=3)
    result = push(made, "emulator")
    document = json.loads(json.dumps(result.document(), allow_nan=False))
    assert document["rows"] == 200
    assert document["readback_equal"] is True
    assert document["attempts"] == 1
    assert document["crc32"] == TableImage.of(made).crc32
    assert document["coupling_id"] == made.id
    assert 0 < document["rounding_max"] <= 2**-24
    assert document["seconds"] < 2.0  # virtual time
    assert document["sample_time_s"] == 1e-3


@pytest.mark.thorough
def test_the_same_run_twice_is_the_same_to_the_last_cycle() -> None:
    def run() -> tuple[float, str]:
        board = EmulatedBoard()
        with Connection(board, session=1) as connection:
            connection.run(connection.session.push(TableImage.of(coupling(30)), connection.device))
        board.machine.run_until(board.machine.cycle + 168_000 * 500)
        return board.now_s(), hashlib.sha256(board.machine.memory("device")).hexdigest()

    assert run() == run()


@pytest.mark.thorough
def test_preemption_at_any_instruction_changes_no_byte() -> None:
    """The main loop is interrupted after every few instructions, also inside conditional blocks."""
    images = []
    for slice_cycles in (3, 5, 11, 168_000):
        board = EmulatedBoard(slice_cycles=slice_cycles, motion_m=lambda _: 0.0)
        with Connection(board) as connection:
            upload = connection.run(connection.session.push(TableImage.of(coupling(20)), connection.device))
            images.append(upload.image)
            assert upload.attempts == 1
    assert set(images) == {TableImage.of(coupling(20)).image}


@pytest.mark.thorough
def test_gains_in_force_follow_the_table_at_the_estimated_frequency() -> None:
    """A steady tap: after the slew, the gains are those of the row, rounded once for each step of the way."""
    made = coupling(60, seed=5)
    board = EmulatedBoard(motion_m=lambda time: 4e-4 * math.sin(2 * math.pi * 6.0 * time))
    push(made, board)
    rows = made.table.single()
    *_, status = monitor(board, seconds=3.0, rate_hz=20)
    assert status.frequency_hz == pytest.approx(6.0, rel=0.02)
    near = lookup(rows, np.float32(status.frequency_hz) * np.array([0.97, 1.03], dtype=np.float32))
    for index, value in enumerate((status.damping_ns_per_m, status.stiffness_n_per_m)):
        assert near[:, index].min() * 0.97 <= value <= near[:, index].max() * 1.03


@pytest.mark.thorough
def test_at_rest_the_frequency_is_undefined_and_the_lowest_row_runs() -> None:
    made = coupling(10)
    board = EmulatedBoard(motion_m=lambda time: 1e-4 if time > 0.2 else -1e-4)
    push(made, board)
    *_, last = monitor(board, seconds=3.0, rate_hz=10)
    assert math.isnan(last.frequency_hz)
    assert last.stiffness_n_per_m == pytest.approx(made.table.at_rest.stiffness_n_per_m, rel=1e-4)
    assert last.contact


@pytest.mark.thorough
def test_the_emulated_board_is_made_for_the_coupling() -> None:
    """Its sample time, encoder, force limit, guard and settings, all at once."""
    runtime = Runtime(guard="passivity-controller", hold_s=0.31, slew_per_s=7.0)
    device = {"sample_time_s": 2.5e-4, "encoder_resolution_m": 5.5e-5, "max_force_n": 3.5, "damping_ns_per_m": 1.25}
    made = coupling(9, runtime=runtime, **device)
    result = push(made, "emulator")
    assert result.readback_equal
    assert result.notes == ()
    found = result.device
    assert (found.sample_time_s, found.metres_per_count, found.max_force_n) == (2.5e-4, 5.5e-5, 3.5)
    assert found.figures == RuntimeFigures(2.5e-4, 5.5e-5, "fused", 0.31, 7.0, True, 1.25)
    streamed = stream(made, "emulator", rate_hz=50, seconds=0.3)
    assert streamed.push.device.figures == found.figures
    ticks = streamed.status.ticks * 2.5e-4
    assert 0.3 < ticks < streamed.seconds + streamed.push.seconds + 1.0


@pytest.mark.thorough
def test_the_emulated_board_knows_how_far_a_handle_is_that_turns() -> None:
    """On it the estimator follows a knob that is turned by up to 40 rad/s, eight times what 5 m/s would be."""
    turns = {"motion": "rotary", "handle_radius_m": 0.02, "encoder_resolution_m": 1e-4}
    made = coupling(60, seed=5, largest=(4.0, 4e3, 0.4), wall=(0.004, 40.0), **turns)
    board = emulated_board(made, motion_m=lambda time: 40 / (2 * math.pi * 6) * math.sin(2 * math.pi * 6.0 * time) - 2)
    assert push(made, board).device.figures.hand_m_per_unit == pytest.approx(0.02)
    *_, status = monitor(board, seconds=2.0, rate_hz=20)
    assert status.frequency_hz == pytest.approx(6.0, rel=0.02)


@pytest.mark.parametrize("counts", [4_194_304, 2**26])
def test_a_wheel_of_many_counts_is_nowhere_near_its_wall(counts: int) -> None:
    """The counter has 16 bits: a device that starts far outside is not taken for one inside."""
    device = {"motion": "rotary", "handle_radius_m": 0.15, "encoder_resolution_m": 2 * math.pi / counts}
    made = with_gains(
        bench_problem((0.0, 100.0), mass_kg=0.03, damping_ns_per_m=0.02, max_force_n=15.0, **device), 0, 2e6
    )
    assert push(made, "emulator").readback_equal
    assert tried_in_the_loop(made, seconds=0.2).push.readback_equal


def test_a_problem_without_encoder_or_force_limit_gets_those_of_the_board() -> None:
    result = push(coupling(3, encoder_resolution_m=0.0, max_force_n=None), "emulator")
    assert (result.device.metres_per_count, result.device.max_force_n, result.max_force_n) == (2e-6, 50.0, 50.0)


@pytest.mark.parametrize(
    ("device", "runtime", "named"),
    [
        ({"sample_time_s": 4e-3}, Runtime(), "allowed: 5e-05 to 0.00333333 s"),
        ({"sample_time_s": 1e-5}, Runtime(), "sample time of 1e-05 s"),
        ({}, Runtime(estimator="spectral-peak"), "its estimator is fused"),
        ({}, Runtime(passive=False), "its passive is True"),
    ],
)
def test_what_the_packaged_program_has_not_is_refused(device: dict[str, float], runtime: Runtime, named: str) -> None:
    with pytest.raises(UnsupportedError, match=named):
        push(coupling(3, runtime=runtime, **device), "emulator")


@pytest.mark.thorough
def test_every_emulated_board_is_fresh() -> None:
    push(coupling(3), "emulator")
    first, *_ = monitor("emulator", seconds=0.1)
    assert not first.has_table
    assert first.coupling_id == ""
    assert "carries over" in EMULATOR_IS_FRESH


@pytest.mark.thorough
def test_stream_follows_the_frequency_and_ends_on_the_table() -> None:
    made = coupling(50, seed=7)
    result = stream(made, "emulator", rate_hz=100, seconds=2.0)
    assert (result.sent, result.taken, result.lost, result.late, result.fell_back) == (200, 200, 0, 0, 0)
    rows = made.table.single()
    for before, after in zip(result.samples, result.samples[1:], strict=False):
        assert after.stiffness_n_per_m == lookup(rows, np.float32(before.lookup_hz))[1]
    assert len({sample.stiffness_n_per_m for sample in result.samples}) > 5
    assert not result.status.streaming
    assert result.status.stream_number == 199
    assert result.status.stream_missing == 0
    assert result.status.stream_expired == 1


@pytest.mark.thorough
def test_lost_gains_are_counted_and_the_table_takes_over() -> None:
    board = EmulatedBoard()
    made = coupling(20)
    pushed = push(made, board)
    # half a second of silence in mid-stream: five times as long as streamed gains hold
    link = FaultyLink(board, [LinkFault(True, 2500, FaultKind.STALL, 50)])
    result = stream(made, link, rate_hz=50, seconds=3.0)
    assert link.happened
    assert result.push.table_id == pushed.table_id
    assert result.lost >= 20
    assert result.fell_back == 1
    assert result.status.stream_missing == result.lost
    assert result.taken == result.sent - result.lost


@pytest.mark.thorough
def test_late_gains_are_refused_by_number() -> None:
    board = EmulatedBoard()
    made = coupling(5)
    push(made, board)
    connection = Connection(board)
    for number, taken in ((0, True), (5, True), (4, False), (5, False), (6, True), (2**31 + 10, False)):
        payload = m.set_gains(int(made.id, 16), number, 1000, 1.0, 100.0 + number % 10, 0.0)
        answer = connection.run(connection.session.request(Kind.SET_GAINS, payload))
        assert isinstance(answer, m.GainsTaken) is taken, number
    *_, sample = monitor(board, seconds=0.9)
    assert sample.streaming
    assert sample.stiffness_n_per_m == pytest.approx(106.0)
    status = Connection(board).run(connection.session.ask(Kind.STATUS, b"", DeviceStatus))
    assert (status.stream_number, status.stream_stale, status.stream_missing) == (6, 3, 4)


def test_stream_refuses_rates_that_the_wire_cannot_carry() -> None:
    for rate in (0.0, 101.0, math.nan):
        with pytest.raises(InputError, match="allowed"):
            stream(coupling(5), "emulator", rate_hz=rate)
    with pytest.raises(InputError, match="allowed"):
        stream(coupling(5), "emulator", seconds=math.inf)


def test_missing_emulator_names_the_command_that_installs_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "unicorn", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'avc-casadi\[emulator\]'"):
        push(coupling(5), "emulator")


def test_missing_port_says_what_to_do() -> None:
    with pytest.raises(LinkError, match="avc doctor --ports"):
        push(coupling(5), "/dev/does-not-exist")


def test_diagnosis_knows_the_image() -> None:
    facts = avc_hardware.diagnose()
    assert facts.image_sha256 == image_sha256() == hashlib.sha256(IMAGE.read_bytes()).hexdigest()
    assert facts.emulator


@pytest.mark.thorough
def test_state_feedback_is_pushed_read_back_and_kept_while_gains_are_streamed() -> None:
    made = coupling(1, largest=(5.0, 5e4, 5.0), runtime=Runtime(state_feedback=believer(3)))
    result = stream(made, "emulator", rate_hz=50, seconds=0.5)
    assert result.push.readback_equal
    assert result.push.crc32 == result.status.table_crc32 == TableImage.of(made).crc32
    assert (result.taken, result.fell_back, result.status.not_finite) == (25, 0, 0)
    assert result.status.coupling_id == made.id
