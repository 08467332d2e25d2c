"""The figures of hardware/README.md: what a push takes, what a tick costs, and what a board has to hold.

PYTHONPATH=tests:hardware python tests/benchmarks/hardware_figures.py

Needs the emulator, the cross compiler and its binutils. Overwrites results/hardware.json beside this file. Times on the
wire are virtual: they depend on no computer.
"""

from __future__ import annotations

import json
import math
import statistics
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from hardware_bench import coupling, dense_believer, push, run, stream
from script_arguments import script_arguments
from studied import about
from tick_profile import TickCount, tick_instructions

from avc_casadi.model.gains import GainTable
from avc_casadi.model.runtime import Runtime
from avc_hardware import Connection, DeviceStatus, EmulatedBoard, TableImage
from avc_hardware.codegen.boards import IMAGE
from avc_hardware.codegen.build import build_image
from avc_hardware.link.connection import DEFAULT_BAUD
from avc_hardware.link.messages import Kind

RESULTS = Path(__file__).parent / "results" / "hardware.json"
COMMAND = "PYTHONPATH=tests:hardware python tests/benchmarks/hardware_figures.py"
LARGEST = (300.0, 1e5, 50.0)
GUARD = "passivity-controller"
ESTIMATOR = "avc_estimate_step"
OBSERVER = "avc_feedback_step"
STATES = (3, 4, 6, 8)
# With a guard, in whole ticks; the guard brakes the observer of 6 made-up states into a fault.
TOGETHER = (3, 8)
# The same rows at other frequencies: evenly in Hz, and dozens of them within some per cent of 1 Hz.
SPACED = {
    "the same, spaced evenly in Hz": np.linspace(1.0, 450.0, 200),
    "the same, crowded at 1 Hz": 450.0 ** np.linspace(0.0, 1.0, 200) ** 3,
}


def out_of_wall(_: float) -> float:
    """Where a table takes over at once."""
    return -1e-3


def motion(tick: int) -> int:
    """A tap of 0.4 mm from 3 to 21 Hz, in counts."""
    time = tick * 1e-3
    return round(200 * math.sin(2 * math.pi * (3 + 6 * time) * time))


def wire(folder: Path, baud: int) -> dict[str, Any]:
    """Push, round trip and stream at one rate of the virtual wire."""
    made = coupling(200, largest=LARGEST)
    image = IMAGE if baud == DEFAULT_BAUD else build_image(out=folder, baud=baud)
    board = EmulatedBoard(image, motion_m=out_of_wall)
    result = push(made, board, baud=baud)
    trips = []
    with Connection(board, baud=baud) as connection:
        for _ in range(50):
            start = board.now_s()
            connection.run(connection.session.ask(Kind.STATUS, b"", DeviceStatus))
            trips.append(board.now_s() - start)
    streamed = stream(made, EmulatedBoard(image, motion_m=out_of_wall), baud=baud, rate_hz=100, seconds=5)
    return {
        "push_s": result.seconds,
        "status_s": statistics.median(trips),
        "set_gains_s": streamed.round_trip_s,
        "taken": streamed.taken,
        "sent": streamed.sent,
    }


def ticks() -> dict[str, Any]:
    """Instructions of whole ticks on the Cortex-M4F, without the estimator where there is one."""
    kinds: dict[str, tuple[int, Runtime]] = {
        "constant gains": (1, Runtime()),
        "constant gains, guard": (1, Runtime(guard=GUARD)),
        **{
            f"the same behind an observer of {states} states": (
                1,
                Runtime(guard=GUARD, state_feedback=dense_believer(states)),
            )
            for states in TOGETHER
        },
        "200 rows": (200, Runtime()),
        "200 rows, guard": (200, Runtime(guard=GUARD)),
    }
    found: dict[str, Any] = {}
    for title, (rows, runtime) in kinds.items():
        largest = LARGEST if runtime.state_feedback is None else (0.0, 1e5, 0.0)
        made = coupling(rows, largest=largest, runtime=runtime)
        counted = tick_instructions(made, counts=motion, ticks=800 if rows > 1 else 300)
        if runtime.state_feedback is not None and OBSERVER not in counted[-1].functions:
            raise ValueError(f"{title}: ended in a fault")
        found[title] = told(without_estimator(counted))
    for title, frequency_hz in SPACED.items():
        spaced = GainTable(np.column_stack([frequency_hz, made.table.rows[:, 1:]]))
        other = tick_instructions(replace(made, table=spaced), counts=motion, ticks=800)
        found[title] = told(without_estimator(other))
    found["estimator fused, beside that"] = told([tick.functions[ESTIMATOR] for tick in counted])
    return {"ticks": found}


def without_estimator(counted: Sequence[TickCount]) -> list[int]:
    """Instructions of each tick but those of the estimator."""
    return [tick.total - tick.functions.get(ESTIMATOR, 0) for tick in counted]


def told(totals: Sequence[int]) -> dict[str, float]:
    """Typical once the motion goes on, and at most."""
    return {"typical": statistics.median(totals[len(totals) // 3 :]), "most": max(totals)}


def observers() -> dict[str, Any]:
    """Size of a table with state feedback, time of its push, and instructions of the observer alone."""
    found = {}
    for states in STATES:
        made = coupling(1, largest=(0.0, 1e5, 0.0), runtime=Runtime(state_feedback=dense_believer(states)))
        pushed = push(made, EmulatedBoard(motion_m=out_of_wall))
        own = [tick.functions[OBSERVER] for tick in tick_instructions(made, counts=motion, ticks=100)]
        found[str(states)] = {"bytes": len(TableImage.of(made).image), "push_s": pushed.seconds, **told(own)}
    return found


def sizes() -> dict[str, Any]:
    """Flash and memory of the packaged image."""
    report = run("arm-none-eabi-size", str(IMAGE)).decode()
    text, data, bss = (int(part) for part in report.splitlines()[1].split()[:3])
    return {"boards": {IMAGE.stem: {"flash": text + data, "memory": data + bss}}}


def main() -> None:
    script_arguments(__doc__)
    commit = subprocess.run(
        ["git", "log", "-1", "--format=%h", "--", "avc_casadi", "hardware/avc_hardware"],  # noqa: S607
        cwd=RESULTS.parents[3],
        capture_output=True,
        text=True,
        check=True,
    ).stdout.strip()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        found = {
            "about": about(COMMAND, 0) | {"commit": commit},
            "wire": {str(baud): wire(folder, baud) for baud in (DEFAULT_BAUD, 921600)},
            **ticks(),
            "observers": observers(),
            **sizes(),
        }
    RESULTS.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
