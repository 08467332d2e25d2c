"""One truth: the control tick of the firmware is the scene's, and gives the same bits on every machine."""

import ctypes
import dataclasses
import functools
import math
from pathlib import Path

import mpmath
import numpy as np
import pytest
from hardware_bench import believer, coupling, dense_believer, host_library, require, scratch, unwatched
from host_device import HostCore, State, build_host, queue
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from reference_device import ReferenceDevice, runtime_programs
from run_step import run_step

from avc_casadi._util.arrays import Float32Array
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import single_ln as ln
from avc_casadi.model.runtime import Runtime
from avc_casadi.simulation.runtime.estimators import EstimatorSettings, estimator_step
from avc_hardware import BoardLimits, Connection, EmulatedBoard, RuntimeFigures, TableImage
from avc_hardware.codegen.figures import Config
from avc_hardware.codegen.tick_program import packed_config
from avc_hardware.emulator.machine import CLOCK_HZ
from avc_hardware.link.table import lookup

Counts = NDArray[np.int32]

TICKS = 1500
SWAPS = (1, 400, 700, 950, 1200)
# Every so many ticks, and for so many, the hand lets go: a table takes over out of contact.
LET_GO, AWAY = 50, 12
# The usual board; a fast one with coarse encoder; a slow one with other settings.
BOARDS = {
    "1 ms": (RuntimeFigures(), 45.0),
    "0.25 ms": (RuntimeFigures(0.25e-3, 2e-5), 8.0),
    "2 ms": (RuntimeFigures(2e-3, 5e-6, hold_s=0.1, slew_per_s=5.0, guard_damping_ns_per_m=0.7), 12.0),
    "a knob": (RuntimeFigures(1e-3, 1e-4, hand_m_per_unit=0.02), 50.0),
}


def limits(board: str) -> BoardLimits:
    figures, force = BOARDS[board]
    return unwatched(figures.sample_time_s, figures.metres_per_count, force)


def couplings(board: str) -> tuple[Coupling, ...]:
    """Tables for their walls, of both contact laws, with a guard, with state feedback, with a lower force limit."""
    figures, force = BOARDS[board]
    device: dict[str, float] = {
        "sample_time_s": figures.sample_time_s,
        "encoder_resolution_m": figures.metres_per_count,
        "damping_ns_per_m": figures.guard_damping_ns_per_m,
        "max_force_n": force,
    }
    runtime = Runtime(hold_s=figures.hold_s, slew_per_s=figures.slew_per_s)
    guarded = runtime.model_copy(update={"guard": "passivity-controller"})
    sparse, dense = (Runtime(state_feedback=found) for found in (believer(5), dense_believer(8)))
    dense, limited = dense.model_copy(update={"guard": "passivity-controller"}), device | {"max_force_n": 6.0}
    return (
        coupling(200, seed=1, largest=(300.0, 1e5, 50.0), runtime=runtime, **device),
        coupling(1, seed=4, largest=(50.0, 5e4, 30.0), wall=(0.0, 3e4), runtime=sparse, contact="clip-last", **device),
        coupling(1, seed=5, largest=(0.0, 1e5, 5.0), wall=(3.0, 5e4), runtime=dense, **device),
        coupling(30, seed=2, largest=(3e3, 1e6, 9.0), wall=(2.0, 3e4), runtime=guarded, contact="clip-last", **device),
        coupling(1, seed=3, largest=(200.0, 5e4, 20.0), wall=(2.0, 8e4), contact="clip-last", **limited),
    )


@functools.cache
def tables(board: str = "1 ms") -> tuple[TableImage, ...]:
    return tuple(TableImage.of(made) for made in couplings(board))


def motions(board: str = "1 ms") -> Counts:
    """Taps and strokes, slow and fast, drift, rest, a jump, noise, a press; shape (motions, ticks)."""
    figures, _ = BOARDS[board]
    time = np.arange(TICKS) * figures.sample_time_s
    step = figures.metres_per_count
    rng = np.random.default_rng(5)
    metres = [
        4e-4 * np.sin(2 * math.pi * (1 + 9 * time) * time),
        1e-3 * np.sin(2 * math.pi * 3 * time) + 3e-4 * np.sin(2 * math.pi * 9 * time),
        5e-3 * np.sin(2 * math.pi * 0.3 * time) + 2e-4 * np.sin(2 * math.pi * 12 * time),
        np.full(TICKS, 2e-4),
        np.where(time < 0.5, -1e-3, 3e-3),
        step * rng.integers(-2, 3, TICKS),
        3e-4 + 2e-4 * np.sin(2 * math.pi * 40 * time),
        np.minimum(0.07 * time - 0.01, 1e-2),
    ]
    counts = np.rint(np.array(metres) / step).astype(np.int32)
    counts[:, np.arange(TICKS) % LET_GO < AWAY] = round(-5e-4 / step)
    return counts


@functools.cache
def reference(estimator: str, board: str = "1 ms") -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Forces and estimates, each of shape (motions, ticks); a table is given at each tick of SWAPS."""
    counts = motions(board)
    figures = dataclasses.replace(BOARDS[board][0], estimator=estimator)
    devices = ReferenceDevice(figures, limits(board), len(counts))
    force, frequency = np.empty((2, *counts.shape), dtype=np.float32)
    for tick in range(counts.shape[1]):
        if tick in SWAPS:
            devices.swap(tables(board)[SWAPS.index(tick)])
        result = devices.tick(counts[:, tick])
        force[:, tick], frequency[:, tick] = result.force_n, result.frequency_hz
    return force, frequency


def on_host(
    core: HostCore, counts: Counts, board: str = "1 ms", swaps: tuple[int, ...] = SWAPS
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """The same on a compiled core: the table is sent before, and a commit waits for the tick that swaps it in."""
    parts = [core.tick(counts[: swaps[0]])]
    for number, (table, start, end) in enumerate(zip(tables(board), swaps, (*swaps[1:], None), strict=True)):
        assert core.state().swaps == number
        queue(core, table)
        parts.append(core.tick(counts[start:end]))
    force, frequency = (np.concatenate([part[index] for part in parts]) for index in (0, 1))
    return force, frequency


def library(estimator: str = "fused", cc: str = "gcc") -> Path:
    return build_host(scratch() / f"{cc}-{estimator}", cc=cc, estimator=estimator)


def host(board: str, built: Path, estimator: str = "fused") -> HostCore:
    return HostCore(built, limits(board), dataclasses.replace(BOARDS[board][0], estimator=estimator))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("board", "estimator", "cc"),
    [
        ("0.25 ms", "fused", "clang"),
        ("2 ms", "zero-crossing", "gcc"),
        ("1 ms", "adaptive-notch", "clang"),
        ("1 ms", "spectral-peak", "gcc"),
    ],
)
def test_compiled_tick_gives_the_bits_of_the_expressions(board: str, estimator: str, cc: str) -> None:
    require(cc)
    built = library(estimator, cc)
    counts = motions(board)
    force, frequency = reference(estimator, board)
    for motion in range(len(counts)):
        got_force, got_frequency = on_host(host(board, built, estimator), counts[motion], board)
        assert got_force.tobytes() == force[motion].tobytes(), motion
        assert got_frequency.tobytes() == frequency[motion].tobytes(), motion
    assert np.isfinite(frequency).sum() > 100  # where gains vary; the notch is slow to find one
    assert (force > 0).sum() > TICKS
    assert force.max() == BOARDS[board][1]
    assert force[:, SWAPS[-1] :].max() == 6.0


def send_all(link: EmulatedBoard, board: str = "1 ms") -> tuple[int, ...]:
    """Push configuration and tables with time between; return the tick of the first and those before each swap."""
    with Connection(link, session=1) as connection:
        session = connection.session
        alone = TableImage.alone(packed_config(Config(limits(board), BOARDS[board][0])))
        swaps = [connection.run(session.push(alone, connection.device)).ticks]
        for table in tables(board):
            upload = connection.run(session.push(table, connection.device))
            swaps.append(upload.ticks - upload.waited)
            connection.wait(200 * table.sample_time_s)
    return tuple(swaps)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("board", "motion"),
    [*(("1 ms", motion) for motion in (1, 5)), ("0.25 ms", 0), ("2 ms", 1)],
)
def test_packaged_image_gives_the_same_bits(board: str, motion: int) -> None:
    """The image waits for a configuration; from the tick that takes it on it is that of its sample time and encoder."""
    require("unicorn", "gcc")
    built = library()
    c = ctypes.CDLL(str(built))
    counts: list[int] = []
    records: list[bytes] = []
    boards: list[EmulatedBoard] = []
    way = motions(board)[motion]

    def position(_: int) -> int:
        counts.append(int(way[len(counts) % TICKS]))
        return counts[-1]

    def applied(_: int) -> None:
        records.extend(board.machine.memory("device") for board in boards)

    figures, _ = BOARDS[board]
    emulated = EmulatedBoard(limits=limits(board), encoder=position, on_force_code=applied)
    boards.append(emulated)
    configured, *swaps = send_all(emulated, board)
    left = max(TICKS - len(counts), 100)
    emulated.machine.run_until(emulated.machine.cycle + round(left * figures.sample_time_s * CLOCK_HZ))
    assert len(records[0]) == c.avc_host_size()
    states = [State.from_buffer_copy(record, c.avc_host_state_offset()) for record in records]
    states = [state for state in states if state.ticks > configured]
    core = host(board, built)
    after = np.array(counts[configured:], dtype=np.int32)
    force, frequency = on_host(core, after, board, tuple(swap - configured for swap in swaps))
    assert len(states) > TICKS - configured - 5
    ticks = np.array([state.ticks for state in states]) - 1 - configured
    assert list(ticks) == list(range(ticks[0], ticks[0] + len(ticks)))
    got = np.array([(state.force_n, state.frequency_hz) for state in states], dtype=np.float32)
    assert got[:, 0].tobytes() == force[ticks].tobytes()
    assert got[:, 1].tobytes() == frequency[ticks].tobytes()


@pytest.mark.slow
@pytest.mark.parametrize("estimator", ["fused", "zero-crossing", "adaptive-notch", "spectral-peak"])
def test_numbers_are_those_of_the_scenes_own_estimator(estimator: str) -> None:
    """The estimator that is built at given figures, with its numbers as constants, is the program with those sent."""
    for time_s, step_m, reach in ((1 / 3000, 1e-7, 1.0), (1e-3, 5.5e-5, 0.02), (3e-3, 2e-4, 0.15)):
        figures = RuntimeFigures(time_s, step_m, estimator, hand_m_per_unit=reach)
        settings = EstimatorSettings.for_encoder(step_m, time_s, reach)
        way = 3e-3 / reach * np.sin(2 * math.pi * 5 * time_s * np.arange(600))
        scene = run_step(estimator_step(estimator, time_s, settings), np.diff(way, prepend=0.0)[None] / time_s)
        part = runtime_programs(figures)[0]
        states, found = part.start(np.zeros(1, dtype=np.float32)), []
        for x in way.astype(np.float32):
            inputs = {"position_m": np.array([x]), "rest_hz": np.array([1.0], dtype=np.float32)}
            states, outputs = part(states, inputs)
            found.append(float(outputs["estimate_hz"][0]))
        np.testing.assert_allclose(found, scene["frequency_hz"], rtol=2e-2, atol=0.05)


# The look-up on the board and in numpy: the same bits.

positive = st.floats(2.0**-20, 2.0**20, width=32)


class Gains(ctypes.Structure):
    _fields_ = [("b", ctypes.c_float), ("k", ctypes.c_float), ("b_p", ctypes.c_float)]


def device_ln(x: float) -> np.float32:
    library = ctypes.CDLL(str(host_library()))
    library.avc_host_ln.restype = ctypes.c_float
    library.avc_host_ln.argtypes = [ctypes.c_float]
    return np.float32(library.avc_host_ln(x))


def device_lookup(made: Coupling, frequency: Float32Array) -> Float32Array:
    """Look up in the compiled core; its table has room for 256 rows behind a header, and what it prepares."""
    library = ctypes.CDLL(str(host_library()))
    library.avc_host_lookup.restype = Gains
    library.avc_host_lookup.argtypes = [ctypes.c_void_p, ctypes.c_float]
    table = ctypes.create_string_buffer(32 + 256 * 16 + 256 * 4 + 513 * 2 + 256)
    image = TableImage.of(made).image
    ctypes.memmove(table, image, len(image))
    library.avc_table_prepare(table, packed_config(Config(BoardLimits(), RuntimeFigures())))
    found = [library.avc_host_lookup(table, float(f)) for f in frequency]
    return np.array([(g.b, g.k, g.b_p) for g in found], dtype=np.float32)


def frequencies(made: Coupling, count: int, seed: int) -> Float32Array:
    """Inside, outside, on every row, next to every row, and undefined."""
    rows = made.table.single()[:, 0]
    rng = np.random.default_rng(seed)
    special = [np.nan, 1e-6, 1e6, np.inf, 0.0, -1.0]
    near = [rows, np.nextafter(rows, np.float32(0)), np.nextafter(rows, np.float32(np.inf))]
    inside = np.exp(rng.uniform(np.log(0.5), np.log(600.0), count))
    return np.concatenate([*near, inside, special]).astype(np.float32)


@given(positive)
def test_logarithm_is_the_same_on_both_sides_and_accurate(x: float) -> None:
    got = device_ln(x)
    assert got == ln(np.float32(x))
    exact = float(mpmath.log(mpmath.mpf(x)))
    # three roundings of the sum near the largest exponent
    assert abs(float(got) - exact) <= 2.5e-7 * max(1.0, abs(exact))


@pytest.mark.parametrize(
    ("rows", "even"), [*((rows, True) for rows in (1, 2, 3, 77, 256)), *((rows, False) for rows in (3, 64, 65, 256))]
)
def test_lookup_is_the_same_bit_for_bit(rows: int, even: bool) -> None:
    made = coupling(rows, seed=rows, even=even)
    at = frequencies(made, 2000, rows)
    device, host = device_lookup(made, at), lookup(made.table.single(), at)
    assert device.tobytes() == host.tobytes()
