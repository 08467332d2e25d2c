"""Firmware, long: ticks that are equal in every bit, faults on the line at every fourth byte, fuzzing under sanitizers.

nice -n 10 python tests/benchmarks/firmware_long.py [--only ticks] [--fuzz-minutes 30]

The ticks run on the core compiled for the host, on the emulated Cortex-M4F of the packaged image and in QEMU, at 1 and
4 kHz, with five couplings pushed one after the other. The faults are ten kinds, to the device and from it, at every
fourth byte of two pushes. The fuzzer is built with the largest tables and records that a manifest may ask for.
Overwrites results/firmware_long.json and RESULTS_firmware_long.md beside this file after every cell; what the former
holds already is not computed again.
"""

from __future__ import annotations

import argparse
import ctypes
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from studied import about, computed, made_by, rounded, table

sys.path.insert(0, str(Path(__file__).parent.parent))
import test_firmware_tick_equals_reference as ticked
from faulty_link import FaultKind, LinkFault
from hardware_bench import scratch
from host_device import HostCore, State
from lock_step_board import LockStepBoard
from test_firmware_survives_fuzzing import corpus_folder
from test_link_faults_leave_a_whole_table import PAIRS, image, push_through

from avc_hardware import EmulatedBoard
from avc_hardware.codegen.boards import RECORDS, ROWS
from avc_hardware.codegen.build import build_fuzzer, build_image, source_hash
from avc_hardware.codegen.tick_c import sources_for
from avc_hardware.emulator.machine import CLOCK_HZ
from avc_hardware.link.faults import INTERFACE_VERSION

HERE = Path(__file__).parent
RESULTS = HERE / "results" / "firmware_long.json"
PAGE = HERE / "RESULTS_firmware_long.md"
SEED = 7
TICKS = 300_000
RATES = {"1 kHz": "1 ms", "4 kHz": "0.25 ms"}
# Bytes of a push, and every which of them is hit.
PUSHES, STEP = {"rows": 1400, "matrices": 600}, 4


def way(board: str) -> np.ndarray:
    """Blocks of the test's motions in random order, each of another size; counts, shape (TICKS,)."""
    rng = np.random.default_rng(SEED)
    motions = ticked.motions(board)
    blocks = TICKS // motions.shape[1] + 1
    sizes = rng.uniform(0.3, 1.2, blocks)
    parts = [motions[rng.integers(len(motions))] * size for size in sizes]
    return np.rint(np.concatenate(parts)).astype(np.int32)


def on_unicorn(board: str, counts: np.ndarray) -> tuple[np.ndarray, np.ndarray, tuple[int, ...]]:
    """Ticks, their force and estimate, and where the tables were swapped."""
    figures, _ = ticked.BOARDS[board]
    offset = ctypes.CDLL(str(ticked.library(board))).avc_host_state_offset()
    ticks: list[int] = []
    found: list[tuple[float, float]] = []
    boards: list[EmulatedBoard] = []
    asked = iter(counts)

    def applied(_: int) -> None:
        for emulated in boards:
            state = State.from_buffer_copy(emulated.machine.memory("device"), offset)
            ticks.append(state.ticks - 1)
            found.append((state.force_n, state.frequency_hz))

    emulated = EmulatedBoard(
        limits=ticked.limits(board), figures=figures, encoder=lambda _: int(next(asked)), on_force_code=applied
    )
    boards.append(emulated)
    swaps = ticked.send_all(emulated, board)
    while ticks[-1] < TICKS - 1:
        left = TICKS - 1 - ticks[-1]
        emulated.machine.run_until(emulated.machine.cycle + round(left * figures.sample_time_s * CLOCK_HZ))
    within = np.array(ticks) < TICKS
    return np.array(ticks)[within], np.array(found, dtype=np.float32)[within], swaps


def on_qemu(board: str, counts: np.ndarray) -> tuple[np.ndarray, tuple[int, ...]]:
    """Force of each tick, and where the tables were swapped."""
    figures, _ = ticked.BOARDS[board]
    built = build_image("bench-m4f", scratch() / f"qemu {board}", generated=sources_for(ticked.limits(board), figures))
    forces: list[float] = []
    with LockStepBoard(built, "bench-m4f", position=lambda tick: int(counts[tick])) as link:
        link.on_force = forces.append
        swaps = ticked.send_all(link, board)
        while link.ticks < TICKS:
            link.tick()
    return np.array(forces[:TICKS], dtype=np.float32), swaps


def equal_ticks(rate: str) -> dict[str, Any]:
    board = RATES[rate]
    counts = way(board)[: TICKS + 1500]

    def host(swaps: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
        core = HostCore(ticked.library(board), ticked.limits(board))
        force, frequency = ticked.on_host(core, counts[:TICKS], board, swaps)
        return force, frequency

    def differ(one: np.ndarray, other: np.ndarray) -> int:
        return int((np.ascontiguousarray(one).view(np.uint32) != np.ascontiguousarray(other).view(np.uint32)).sum())

    ticks, got, swaps = on_unicorn(board, counts)
    force, frequency = host(swaps)
    forces, swapped = on_qemu(board, counts)
    again, _ = host(swapped)
    return {
        "ticks": TICKS,
        "touching": int((force > 0).sum()),
        "largest_force_n": float(force.max()),
        "unicorn": {
            "ticks": len(ticks),
            "force": differ(got[:, 0], force[ticks]),
            "estimate": differ(got[:, 1], frequency[ticks]),
        },
        "qemu": {"ticks": len(forces), "force": differ(forces, again)},
    }


def faults(kind: FaultKind) -> dict[str, Any]:
    """Push through one fault of a kind at every fourth byte, and look at every moment whether the table is whole."""
    pushes = hit = ended = 0
    wrong = []
    for number, (pair, size) in enumerate(PUSHES.items()):
        for to_device in (True, False):
            for at in range((number + to_device) % STEP, size, STEP):
                fault = LinkFault(to_device, at, kind, amount=1 + at % 40)
                pushes += 1
                try:
                    core, link, done = push_through([fault], pair)
                except AssertionError as error:
                    wrong.append(f"{fault}: {error}")
                    continue
                hit += bool(link.happened)
                ended += done
                if done and core.image() != image(PAIRS[pair][1]):
                    wrong.append(f"{fault}: told done, and another table runs")
    return {"pushes": pushes, "fault_happened": hit, "ended_on_the_new_table": ended, "wrong": wrong}


def fuzzed(minutes: float) -> dict[str, Any]:
    defines = (f"-DAVC_CAPACITY_ROWS={ROWS[1]}", f"-DAVC_CAPACITY_RECORDS={RECORDS[1]}")
    program = build_fuzzer(scratch() / "largest", estimator="fused", defines=defines)
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryDirectory() as harmful:
        done = subprocess.run(  # noqa: S603 - ours
            [
                *(str(program), f"-max_total_time={round(60 * minutes)}", "-max_len=1024", "-print_final_stats=1"),
                *(f"-seed={SEED}", f"-artifact_prefix={harmful}/", folder, str(corpus_folder())),
            ],
            capture_output=True,
            check=False,
        )
        report = done.stderr.decode(errors="replace")
        kept = {path.name: path.read_bytes().hex() for path in Path(harmful).iterdir()}
    executed = re.search(r"number_of_executed_units:\s*(\d+)", report)
    covered = re.findall(r"cov: (\d+)", report)
    return {
        "minutes": minutes,
        "runs": int(executed[1]) if executed else None,
        "edges": int(covered[-1]) if covered else None,
        "rows": ROWS[1],
        "records": RECORDS[1],
        "ended_with": done.returncode,
        "harmful": kept,
    }


FAULTS = """One fault at every fourth byte of a push, to the device and from it: of 70 rows over 12, and of one observer
of 8 states over another. Wrong: at a look the device did not run the old table or the new one, whole.

"""
TEXT = """# Firmware, long

{made_by} Firmware sources {build}, interface version {interface}.

## Ticks that are equal in every bit

One motion of {ticks} ticks (taps, strokes, drift, rest, jumps, noise, presses in random order and size), five couplings
pushed one after the other: tables with estimator and adaptation, constant gains, state feedback of 4 and 8 states, a
guard, both contact laws, a lower force limit. Against the core compiled for the host by gcc, values of 32 bits that
differ:

{equal}

## Faults on the line

{faults}

## Fuzzing

{fuzz}
"""


def write_page(document: dict[str, Any]) -> None:
    cells = document["cells"]
    equal = [
        [
            rate,
            cells[rate]["ticks"],
            cells[rate]["touching"],
            rounded(cells[rate]["largest_force_n"]),
            cells[rate]["unicorn"]["ticks"],
            cells[rate]["unicorn"]["force"],
            cells[rate]["unicorn"]["estimate"],
            cells[rate]["qemu"]["force"],
        ]
        for rate in RATES
        if rate in cells and "error" not in cells[rate]
    ]
    kinds = {name: cell for name, cell in cells.items() if name.startswith("fault ") and "error" not in cell}
    rows = [
        [name.removeprefix("fault "), *(cell[key] for key in _COUNTS), len(cell["wrong"])]
        for name, cell in kinds.items()
    ]
    if rows:
        rows.append(["all", *(sum(int(row[place]) for row in rows) for place in range(1, 5))])
    told = ("kind", "pushes", "fault happened", "ended on the new table", "wrong")
    fuzz = [
        f"Largest configuration (tables of {cell['rows']} rows, {cell['records']} records, estimator `fused`), address "
        f"and undefined-behaviour sanitizers: {cell['minutes']:g} minutes on the clock, {cell['cell_cpu_s'] / 60:.1f} "
        f"of processor time on a shared machine; {cell['runs']} runs, {cell['edges']} edges covered, "
        f"{len(cell['harmful'])} harmful."
        for name, cell in cells.items()
        if name.startswith("fuzz") and "error" not in cell
    ]
    broken = [f"- {name}: {cell['error']}" for name, cell in cells.items() if "error" in cell]
    head = (
        "rate",
        "ticks",
        "with a force",
        "largest, N",
        "Unicorn: ticks",
        "force",
        "estimate",
        "QEMU, Cortex-M4F: force",
    )
    text = TEXT.format(
        made_by=made_by(document["about"]),
        build=document["about"]["firmware"],
        interface=INTERFACE_VERSION,
        ticks=TICKS,
        equal=table(head, equal),
        faults=FAULTS + table(told, rows) if rows else "Not run.",
        fuzz="\n\n".join(fuzz) or "Not run.",
    )
    PAGE.write_text(text + "\n".join(["", *broken, ""] if broken else []), encoding="utf-8")


_COUNTS = ("pushes", "fault_happened", "ended_on_the_new_table")


def cells(only: str | None, minutes: float) -> Iterator[tuple[str, Callable[[], dict[str, Any]]]]:
    if only in {None, "ticks"}:
        for rate in RATES:
            yield rate, partial(equal_ticks, rate)
    if only in {None, "faults"}:
        for kind in FaultKind:
            yield f"fault {kind.name.lower()}", partial(faults, kind)
    if only in {None, "fuzz"}:
        yield f"fuzz {minutes:g} min", partial(fuzzed, minutes)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=("ticks", "faults", "fuzz"), help="one of the three")
    parser.add_argument("--fuzz-minutes", type=float, default=30.0, metavar="M", help="default 30")
    arguments = parser.parse_args()
    told = about("python tests/benchmarks/firmware_long.py", SEED) | {"firmware": source_hash()}
    computed(dict(cells(arguments.only, arguments.fuzz_minutes)), RESULTS, told, write_page)


if __name__ == "__main__":
    main()
