"""The figures of hardware/README.md, measured: ``PYTHONPATH=tests python tests/benchmarks/hardware_figures.py``.

Needs the emulator, the cross compiler and its binutils. Overwrites no file. Times
on the wire are virtual: they depend on no computer.
"""

from __future__ import annotations

import math
import statistics
import tempfile
from collections import Counter
from pathlib import Path

from hardware_bench import coupling, dense_believer, push, run, stream
from script_arguments import script_arguments

from avc_casadi.coupling import Runtime
from avc_hardware import Connection, DeviceStatus, EmulatedBoard, TableImage
from avc_hardware._messages import Kind
from avc_hardware._profile import tick_instructions
from avc_hardware.firmware_build import TARGETS, build_image

MADE = coupling(200, largest=(300.0, 1e5, 50.0))
GUARDED = coupling(200, largest=(300.0, 1e5, 50.0), runtime=Runtime(guard="passivity-controller"))


def out_of_wall(_: float) -> float:
    """Where a table takes over at once."""
    return -1e-3


def motion(tick: int) -> int:
    """A tap of 0.4 mm from 3 to 21 Hz, in counts."""
    time = tick * 1e-3
    return round(200 * math.sin(2 * math.pi * (3 + 6 * time) * time))


def wire(folder: Path, baud: int) -> None:
    """Push, round trip and stream at one rate of the virtual wire."""
    image = build_image("netduinoplus2", folder, baud=baud)
    board = EmulatedBoard(image, motion_m=out_of_wall)
    result = push(MADE, board, baud=baud)
    trips = []
    with Connection(board, baud=baud) as connection:
        for _ in range(50):
            start = board.now_s()
            connection.run(connection.session.ask(Kind.STATUS, b"", DeviceStatus))
            trips.append(board.now_s() - start)
    print(f"{baud} baud: 200 rows pushed, verified and read back in {result.seconds:.3f} s ({result.attempts} attempt)")
    print(f"  STATUS round trip {1e3 * statistics.median(trips):.2f} ms (median of {len(trips)})")
    for rate in (50, 100):
        streamed = stream(MADE, EmulatedBoard(image, motion_m=out_of_wall), baud=baud, rate_hz=rate, seconds=5)
        print(
            f"  SET_GAINS at {rate} Hz: {streamed.taken} of {streamed.sent} taken, {streamed.lost} lost, "
            f"round trip {1e3 * streamed.round_trip_s:.2f} ms, largest {1e3 * streamed.round_trip_max_s:.2f} ms"
        )


def instructions() -> None:
    """Instructions of a tick on the Cortex-M4F."""
    ticks = tick_instructions(MADE, counts=motion, ticks=1500)
    guarded = tick_instructions(GUARDED, counts=motion, ticks=300)
    most: Counter[str] = Counter()
    for tick in (*ticks, *guarded):
        for name, count in tick.functions.items():
            most[name] = max(most[name], count)
    print("instructions of a tick, Cortex-M4F, 1500 ticks of a tap of 3 to 21 Hz:")
    for name, count in most.most_common():
        typical = statistics.median(tick.functions.get(name, 0) for tick in (*ticks[500:], *guarded[-1:]))
        print(f"  {name:20} {typical:6.0f} typical {count:6} at most")
    constant = {"constant gains": None, "the same with a guard": "passivity-controller"}
    for title, guard in constant.items():
        made = coupling(1, largest=(300.0, 1e5, 50.0), runtime=Runtime(guard=guard))
        tell(title, [tick.total for tick in tick_instructions(made, counts=motion, ticks=300)])
    for title, counted in (("a table", ticks), ("the same with a guard", guarded)):
        tell(title, [tick.total for tick in counted])
        tell("  without the estimator", [tick.total - tick.functions["avc_estimate_step"] for tick in counted])


def tell(title: str, totals: list[int]) -> None:
    """Print the instructions of whole ticks."""
    print(f"  {title:30} {statistics.median(totals[len(totals) // 3 :]):6.0f} typical {max(totals):6} at most")


def state_feedback() -> None:
    """Size of the table, time of its push, and instructions of the observer."""
    for states in (3, 4, 6, 8):
        made = coupling(1, largest=(0.0, 1e5, 0.0), runtime=Runtime(state_feedback=dense_believer(states)))
        pushed = push(made, EmulatedBoard(motion_m=out_of_wall))
        ticks = tick_instructions(made, counts=motion, ticks=300)
        own = [tick.functions["avc_feedback_step"] for tick in ticks]
        print(
            f"state feedback with {states} states: {len(TableImage.of(made).image)} bytes, pushed in "
            f"{pushed.seconds:.3f} s, {statistics.median(own):.0f} instructions typical, {max(own)} at most"
        )


def sizes(folder: Path) -> None:
    """Flash and memory of every board."""
    for target in TARGETS:
        image = build_image(target, folder)
        report = run("arm-none-eabi-size", str(image)).decode()
        text, data, bss = report.splitlines()[1].split()[:3]
        print(f"{target:14} {int(text) + int(data):6} bytes of flash, {int(data) + int(bss):6} bytes of memory")
    report = run("arm-none-eabi-nm", "--size-sort", "-S", str(build_image("netduinoplus2", folder))).decode()
    for line in reversed(report.splitlines()):
        _, size, kind, name = line.split()
        if int(size, 16) >= 64:
            print(f"  {name:24} {int(size, 16):6} bytes {'of flash' if kind in 'tTrR' else 'of memory'}")


if __name__ == "__main__":
    script_arguments(__doc__)
    with tempfile.TemporaryDirectory() as name:
        for rate in (115200, 921600):
            wire(Path(name), rate)
        instructions()
        state_feedback()
        sizes(Path(name))
