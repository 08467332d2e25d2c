"""One truth: the control tick of the firmware is the scene's, and gives the same bits on every machine.

The C is generated from the expressions that scenes run. Here it is held against the same expressions in numpy single
precision, tick by tick over whole motions: compiled for this computer, on the emulated Cortex-M4F of the packaged
image, and in QEMU on a Cortex-M4F and on a Cortex-M3 whose floats are software.
"""

import ctypes
import functools
import math
from collections.abc import Generator
from typing import Any

import numpy as np
import pytest
from hardware_bench import host_library, require, schedule, scratch
from numpy.typing import NDArray

from avc_casadi import LinkError
from avc_hardware import Connection, EmulatedBoard, GainTable, TableSettings, Wall, gain_table
from avc_hardware._frames import Decoder, Frame
from avc_hardware._host import BoardLimits, HostCore, State
from avc_hardware._machine import CLOCK_HZ
from avc_hardware._messages import parse
from avc_hardware._monitor import pause
from avc_hardware._qemu import LockStepBoard
from avc_hardware._reference_device import ReferenceDevice
from avc_hardware._runtime_program import RuntimeFigures
from avc_hardware._session import Answer, Exchange, Session
from avc_hardware.firmware_build import TARGETS, build_host, build_image, generated

Counts = NDArray[np.int32]

TICKS = 1500
SWAP_AT = 700
TABLES = (
    gain_table(schedule(200, seed=1, largest=(300.0, 1e5, 50.0)), settings=TableSettings(wall=Wall(10.0, 1e5))),
    gain_table(schedule(30, seed=2, largest=(3e3, 1e6, 0.0)), settings=TableSettings(wall=Wall(0.0, 3e4), guard=True)),
)


def motions() -> Counts:
    """Taps and strokes, slow and fast, drift, rest, a jump, noise, a press; shape (motions, ticks)."""
    time = np.arange(TICKS) * 1e-3
    rng = np.random.default_rng(5)
    metres = [
        4e-4 * np.sin(2 * math.pi * (1 + 9 * time) * time),
        1e-3 * np.sin(2 * math.pi * 3 * time) + 3e-4 * np.sin(2 * math.pi * 9 * time),
        5e-3 * np.sin(2 * math.pi * 0.3 * time) + 2e-4 * np.sin(2 * math.pi * 12 * time),
        np.full(TICKS, 2e-4),
        np.where(time < 0.5, -1e-3, 3e-3),
        2e-6 * rng.integers(-2, 3, TICKS),
        3e-4 + 2e-4 * np.sin(2 * math.pi * 40 * time),
        np.minimum(0.07 * time - 0.01, 1e-2),
    ]
    return np.rint(np.array(metres) / 2e-6).astype(np.int32)


@functools.cache
def reference(estimator: str) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Forces and estimates, each of shape (motions, ticks); the tables come into force at ticks 1 and SWAP_AT."""
    counts = motions()
    devices = ReferenceDevice(RuntimeFigures(estimator=estimator), BoardLimits(), len(counts))
    force, frequency = np.empty((2, *counts.shape), dtype=np.float32)
    for tick in range(counts.shape[1]):
        if tick in {1, SWAP_AT}:
            devices.swap(TABLES[0 if tick == 1 else 1])
        result = devices.tick(counts[:, tick])
        force[:, tick], frequency[:, tick] = result.force_n, result.frequency_hz
    return force, frequency


def on_host(
    core: HostCore, counts: Counts, swaps: tuple[int, int] = (1, SWAP_AT)
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """The same on a compiled core: the table is sent before, and a commit waits for the tick that swaps it in."""
    parts = [core.tick(counts[: swaps[0]])]
    for table, span in zip(TABLES, (slice(swaps[0], swaps[1]), slice(swaps[1], None)), strict=True):
        queue(core, table)
        parts.append(core.tick(counts[span]))
    force, frequency = (np.concatenate([part[index] for part in parts]) for index in (0, 1))
    return force, frequency


def queue(core: HostCore, table: GainTable) -> None:
    """Bring a device to the point where only the next tick is missing for the swap; no time passes."""
    core.read()
    session = Session(1, timeout_s=1.0)
    decoder = Decoder()
    waiting: list[Frame] = []

    def answered(dialogue: Generator[Exchange, Answer, Any]) -> Any:
        exchange = next(dialogue)
        while True:
            core.write(exchange.data)
            waiting.extend(decoder.feed(core.read()))
            if not waiting:
                return None  # only the commit waits for a tick
            frame = waiting.pop(0)
            message = parse(frame)
            assert message is not None
            try:
                exchange = dialogue.send((frame.sequence, message))
            except StopIteration as stop:
                return stop.value

    device = answered(session.hello())
    answered(session.push(table, device))


@pytest.mark.parametrize("estimator", ["fused", "zero-crossing", "adaptive-notch", "spectral-peak"])
@pytest.mark.parametrize("cc", ["gcc", "clang"])
def test_compiled_tick_gives_the_bits_of_the_expressions(estimator: str, cc: str) -> None:
    require(cc)
    library = build_host(scratch() / f"{cc}-{estimator}", cc=cc, estimator=estimator)
    counts = motions()
    force, frequency = reference(estimator)
    for motion in range(len(counts)):
        got_force, got_frequency = on_host(HostCore(library), counts[motion])
        assert got_force.tobytes() == force[motion].tobytes(), motion
        assert got_frequency.tobytes() == frequency[motion].tobytes(), motion
    assert np.isfinite(frequency).sum() > TICKS
    assert (force > 0).sum() > TICKS


def send_both(link: EmulatedBoard | LockStepBoard) -> tuple[int, int]:
    """Push one table, let some time pass, push the other; returns the ticks at which they came into force."""
    with Connection(link, session=1) as connection:
        session = connection.session
        swaps = []
        for table in TABLES:
            swaps.append(connection.run(session.push(table, connection.device)).ticks - 1)
            connection.run(pause(0.4))
    return swaps[0], swaps[1]


@pytest.mark.parametrize("motion", range(len(motions())))
def test_packaged_image_gives_the_same_bits(motion: int) -> None:
    require("unicorn", "gcc")
    library = ctypes.CDLL(str(host_library()))
    counts: list[int] = []
    records: list[bytes] = []
    boards: list[EmulatedBoard] = []
    way = motions()[motion]

    def position(_: float) -> float:
        counts.append(int(way[min(len(counts), TICKS - 1)]))
        return counts[-1] * 2e-6

    def applied(_: int) -> None:
        records.extend(board.machine.memory("device") for board in boards)

    board = EmulatedBoard(motion_m=position, on_force_code=applied)
    boards.append(board)
    swaps = send_both(board)
    board.machine.run_until(board.machine.cycle + (TICKS - len(counts)) * CLOCK_HZ // 1000)
    assert len(records[0]) == library.avc_host_size()
    states = [State.from_buffer_copy(record, library.avc_host_state_offset()) for record in records]
    force, frequency = on_host(HostCore(host_library()), np.array(counts, dtype=np.int32), swaps)
    assert len(states) >= TICKS - 5
    ticks = np.array([state.ticks for state in states]) - 1
    assert list(ticks) == list(range(ticks[0], ticks[0] + len(ticks)))
    got = np.array([(state.force_n, state.frequency_hz) for state in states], dtype=np.float32)
    assert got[:, 0].tobytes() == force[ticks].tobytes()
    assert got[:, 1].tobytes() == frequency[ticks].tobytes()


@pytest.mark.parametrize("target", ["bench-m4f", "bench-m3"])
def test_qemu_gives_the_same_bits(target: str) -> None:
    require("qemu-system-arm", "arm-none-eabi-gcc", "gcc")
    image = build_image(target, scratch())
    library = build_host(scratch() / target, estimator=TARGETS[target].estimator)
    for way in motions()[[0, 2, 4]]:
        forces: list[float] = []
        with LockStepBoard(image, target, position=lambda tick, way=way: int(way[min(tick, TICKS - 1)])) as board:
            board.on_force = forces.append
            swaps = send_both(board)
            while board.ticks < TICKS:
                board.tick()
        force, _ = on_host(HostCore(library), way, swaps)
        assert np.array(forces[:TICKS], dtype=np.float32).tobytes() == force.tobytes()
        assert force.max() > 0


def test_a_board_that_does_not_start_is_reported() -> None:
    require("qemu-system-arm")
    with pytest.raises(LinkError, match="QEMU ended"):
        LockStepBoard(scratch() / "absent.elf", "bench-m4f", position=lambda _: 0)


def test_generated_sources_are_those_of_the_scene() -> None:
    for path, text in generated().items():
        assert path.read_text(encoding="utf-8") == text, "run: python -m avc_hardware.firmware_build generate"
