"""The exported C on bare processors: built, run in an emulator, its forces, stack and size."""

from __future__ import annotations

import re
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from exported import WARNINGS
from hardware_bench import export_c, require, run, scratch

from avc_casadi._util.arrays import Float32Array, FloatArray
from avc_casadi.coupling import Coupling

_HERE = Path(__file__).parent
_BARE = ("-ffreestanding", "-nostdlib", f"-Wl,-T,{_HERE / 'exported_bench.ld'}", "-Wl,--build-id=none")
_ARM = (*_BARE, "-mthumb", "-Wl,--defsym=CODE=0,--defsym=MEMORY=0x20000000")
_RISCV = (*_BARE, "-Wl,--defsym=CODE=0x80000000,--defsym=MEMORY=0x80100000")
_NO_WINDOW = ("-display", "none", "-monitor", "none")
_SEMIHOSTED = (*_NO_WINDOW, "-serial", "none", "-semihosting-config", "enable=on,target=native")


@dataclass(frozen=True)
class Board:
    """A processor and what runs it."""

    tools: str
    flags: tuple[str, ...]
    libraries: tuple[str, ...]
    emulator: tuple[str, ...]


def _avr(processor: str) -> Board:
    return Board("avr-", (f"-mmcu={processor}", "-Os"), ("-lm",), ("simavr", "-m", processor, "-f", "16000000"))


BOARDS = {
    "ATmega328P": _avr("atmega328p"),
    "ATmega2560": _avr("atmega2560"),
    "Cortex-M0": Board(
        "arm-none-eabi-",
        (*_ARM, "-Os", "-mcpu=cortex-m0", "-mfloat-abi=soft"),
        ("-lgcc",),
        ("qemu-system-arm", "-M", "microbit", *_SEMIHOSTED, "-kernel"),
    ),
    "Cortex-M4F": Board(
        "arm-none-eabi-",
        (*_ARM, "-O2", "-mcpu=cortex-m4", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"),
        ("-lgcc",),
        ("qemu-system-arm", "-M", "mps2-an386", *_SEMIHOSTED, "-kernel"),
    ),
    "riscv64": Board(
        "riscv64-unknown-elf-",
        (*_RISCV, "-O2", "-march=rv64gc", "-mabi=lp64d", "-mcmodel=medany"),
        ("-lgcc",),
        ("qemu-system-riscv64", "-M", "virt", *_NO_WINDOW, "-serial", "stdio", "-bios", "none", "-kernel"),
    ),
}


@dataclass(frozen=True)
class Ran:
    """What a board did."""

    forces: Float32Array
    flash_bytes: int
    copied_bytes: int
    program_bytes: int
    state_bytes: int
    stack_bytes: int
    cycles: int


def _positions(positions_m: FloatArray) -> str:
    bits = np.asarray(positions_m, dtype=np.float32).view(np.uint32)
    numbers = ", ".join(f"{value}u" if value < 2**16 else f"{value}ul" for value in bits.ravel().tolist())
    return f"""#if defined(__AVR__)
#include <avr/pgmspace.h>
#else
#define PROGMEM
#define pgm_read_dword(place) (*(place))
#endif
enum {{ STROKES = {bits.shape[0]}, SAMPLES = {bits.shape[1]} }};
static const uint32_t positions[] PROGMEM = {{{numbers}}};
static uint32_t bits_at(unsigned int index)
{{
    return pgm_read_dword(&positions[index]);
}}
"""


def _output(emulator: str, *arguments: str) -> str:
    """Return what a program printed, without colours."""
    done = subprocess.run(  # noqa: S603 - ours
        [emulator, *arguments], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=600, check=True
    )
    return re.sub("\x1b\\[[0-9;]*m", "", done.stdout.decode(errors="replace"))


def _sizes(size: str, file: str) -> tuple[int, int]:
    """Return the bytes of program and of what memory starts with."""
    program, initialised = run(size, file).decode().splitlines()[1].split()[:2]
    return int(program), int(initialised)


def ran(name: str, coupling: Coupling, positions_m: FloatArray) -> Ran:
    """Build for a board of `BOARDS` and run; positions of shape (strokes, samples), each stroke after a start."""
    board = BOARDS[name]
    gcc, size = f"{board.tools}gcc", f"{board.tools}size"
    require(gcc, board.emulator[0])
    folder = Path(tempfile.mkdtemp(dir=scratch()))
    for file, text in export_c(coupling).items():
        (folder / file).write_text(text, encoding="ascii")
    (folder / "positions.h").write_text(_positions(positions_m), encoding="ascii")
    compiling = tuple(flag for flag in board.flags if not flag.startswith("-Wl,"))
    coupling_o, image = str(folder / "coupling.o"), str(folder / "image.elf")
    run(gcc, "-std=c99", *WARNINGS, *compiling, "-c", str(folder / "avc_coupling.c"), "-o", coupling_o)
    main = str(_HERE / "exported_bench.c")
    run(gcc, "-std=gnu11", *board.flags, f"-I{folder}", main, coupling_o, *board.libraries, "-o", image)
    emulator, *arguments = board.emulator
    words = re.findall(r"(?:(stack|cycles|state) )?\b([0-9a-f]{8})\b", _output(emulator, *arguments, image))
    figures = {kind: int(value, 16) for kind, value in words if kind}
    bits = np.array([int(value, 16) for kind, value in words if not kind], dtype=np.uint32)
    alone = _sizes(size, coupling_o)
    return Ran(
        forces=bits.view(np.float32).reshape(np.shape(positions_m)),
        flash_bytes=sum(alone),
        copied_bytes=alone[1],
        program_bytes=sum(_sizes(size, image)),
        state_bytes=figures["state"],
        stack_bytes=figures["stack"],
        cycles=figures["cycles"],
    )
