"""Boards of the firmware: processor, memory, sources, and flashing.

A custom board is a folder anywhere with its sources and a ``board.toml`` that describes their build; its processor is a
Cortex-M.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from avc_casadi import Fault, InputError
from avc_casadi.files.toml_text import tables_of, text_of
from avc_hardware.codegen.figures import ESTIMATOR_NUMBERS
from avc_hardware.codegen.firmware import ARM_INSTALL

MANIFEST = "board.toml"

_M4F = ("-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16")


@dataclass(frozen=True)
class Target:
    """One board.

    Attributes:
        title: description.
        folder: name of the folder with board.h and the sources.
        cpu: compiler flags of the core.
        flash: origin and size, bytes.
        ram: origin and size, bytes.
        extra: further sources, relative to firmware/boards.
        defines: compiler definitions.
        estimator: method; the fused one is too slow for floats in software.
        commands: to flash or to run an image, with {name} for the file without its ending.
        root: the folder of a board that is not in the package; None for firmware/boards/FOLDER.
        sources: in the folder.
        compiler: the cross compiler, a gcc.
        install: how to install it.
    """

    title: str
    folder: str
    cpu: tuple[str, ...]
    flash: tuple[int, int]
    ram: tuple[int, int]
    extra: tuple[str, ...] = ()
    defines: tuple[str, ...] = ()
    estimator: str = "fused"
    commands: tuple[str, ...] = ()
    root: Path | None = None
    sources: tuple[str, ...] = ("board.c",)
    compiler: str = "arm-none-eabi-gcc"
    install: str = ARM_INSTALL


_STM32F405 = ((0x08000000, 0x100000), (0x20000000, 0x20000))
_FLASHING = (
    "st-flash --reset write {name}.bin 0x08000000",
    "dfu-util -a 0 -s 0x08000000:leave -D {name}.bin    (BOOT0 high at reset)",
    'openocd -f interface/stlink.cfg -f target/stm32f4x.cfg -c "program {name}.elf verify reset exit"',
    "STM32_Programmer_CLI -c port=SWD -w {name}.hex -v -rst",
)
TARGETS = {
    "netduinoplus2": Target(
        "STM32F405 as emulators have it, without clocks",
        "netduinoplus2",
        _M4F,
        *_STM32F405,
        commands=("qemu-system-arm -M netduinoplus2 -kernel {name}.elf -display none -serial pty",),
    ),
    "stm32f405": Target(
        "STM32F405, Cortex-M4F at 168 MHz",
        "netduinoplus2",
        _M4F,
        *_STM32F405,
        ("stm32f405/clock.c",),
        commands=_FLASHING,
    ),
}

# The format counts rows and records in 16 bits; a table with state feedback is as long as 27 rows.
ROWS = (27, 4096)
RECORDS = (128, 32768)
# Bytes of the vectors that the packaged start of a Cortex-M has, to the next power of two.
_VECTORS = 256


@dataclass
class _Reader:
    """Reader of the keys of a table that collects their faults."""

    file: str
    keys: dict[str, Any]
    faults: list[Fault] = field(default_factory=list)
    place: str = ""
    asked: list[str] = field(default_factory=list)

    def fault(self, key: str, message: str) -> None:
        self.faults.append(Fault(self.file, None, self.place + key, message))

    def take(self, key: str, default: Any, allowed: str, accepts: Callable[[Any], bool]) -> Any:
        """Return a key's value, or the default; a default of None requires the key."""
        self.asked.append(key)
        if key not in self.keys:
            if default is None:
                self.fault(key, f"is missing; give {allowed}")
            return default
        value = self.keys.pop(key)
        if not accepts(value):
            self.fault(key, f"is {value!r}; allowed: {allowed}")
            return default
        return value

    def table(self, key: str) -> _Reader:
        self.asked.append(key)
        value = self.keys.pop(key, {})
        if not isinstance(value, dict):
            self.fault(key, f"is {value!r}; allowed: a table")
            value = {}
        return _Reader(self.file, dict(value), self.faults, f"{self.place}{key}.")

    def end(self) -> None:
        for key in self.keys:
            self.fault(key, f"is unknown; allowed: {', '.join(self.asked)} (hardware/PORTING.md)")


def _text(value: Any) -> bool:
    return isinstance(value, str) and bool(value.strip())


def _texts(value: Any) -> bool:
    return isinstance(value, list) and all(_text(one) for one in value)


def _whole(low: int, high: int = 2**32) -> Callable[[Any], bool]:
    return lambda value: isinstance(value, int) and not isinstance(value, bool) and low <= value <= high


def _region(reader: _Reader, key: str, align: int) -> tuple[int, int] | None:
    """Return first address and size, or None where one of them is faulty."""
    table = reader.table(key)
    whole = _whole(0)
    told = f"the first address, a multiple of {align}"
    origin = table.take("origin", None, told, lambda value: whole(value) and value % align == 0)
    size = table.take(
        "bytes", None, "the size in bytes, a multiple of 4", lambda value: _whole(4)(value) and value % 4 == 0
    )
    table.end()
    if origin is None or size is None:
        return None
    if origin + size > 2**32:
        table.fault("bytes", f"{size} from {origin:#x} on end beyond 32 bits; allowed: at most {2**32 - origin}")
    return origin, size


def flashing(command: str, name: str) -> str:
    """Return a command of a manifest with the name of the files put in."""
    return command.replace("{name}", name)


def read_board(folder: Path) -> Target:
    """Read the manifest of a board.

    Args:
        folder: holds ``board.toml``.

    Raises:
        InputError: no such file, or every fault of it.
    """
    path = folder / MANIFEST
    try:
        keys = tables_of(text_of(path, "write one: hardware/PORTING.md"), str(path))
    except InputError as error:
        raise InputError([replace(fault, key="board") for fault in error.faults]) from error
    reader = _Reader(str(path), keys)
    title = reader.take("title", folder.name, "a line of text", _text)
    compiler = reader.take("compiler", None, "a program, as arm-none-eabi-gcc", _text)
    install = reader.take("install", "see its maker's page", "how to install the compiler, a line of text", _text)
    flags = reader.take("flags", [], "a list of the compiler's flags", _texts)
    sources = reader.take("sources", None, "a list of files of the folder", _texts)
    estimators = ", ".join(ESTIMATOR_NUMBERS)
    estimator = reader.take("estimator", "zero-crossing", estimators, ESTIMATOR_NUMBERS.__contains__)
    commands = reader.take("commands", [], "a list of commands that flash {name}.elf, {name}.bin or {name}.hex", _texts)
    # The vectors of a Cortex-M stand at a multiple of their size, its stack at one of 8.
    flash = _region(reader, "flash", _VECTORS)
    memory = _region(reader, "memory", 8)
    capacity = reader.table("capacity")
    rows = capacity.take("rows", 256, "{} to {} rows of a table".format(*ROWS), _whole(*ROWS))
    records = capacity.take(
        "records",
        4096,
        "{} to {} records of an excitation, a power of two".format(*RECORDS),
        lambda value: _whole(*RECORDS)(value) and value & (value - 1) == 0,
    )
    capacity.end()
    reader.end()
    if compiler and shutil.which(compiler) is None:
        message = f"is {compiler!r}, which is no program on the path; correct the name, or install it: {install}"
        reader.fault("compiler", message)
    if sources == []:
        reader.fault("sources", "names no file; allowed: at least the one with the board's functions (hal.h)")
    (rom, rom_bytes), (ram, ram_bytes) = flash or (0, 0), memory or (0, 0)
    if max(rom, ram) < min(rom + rom_bytes, ram + ram_bytes):
        message = f"0x{ram:x} to 0x{ram + ram_bytes:x} lies over flash, 0x{rom:x} to 0x{rom + rom_bytes:x}"
        reader.fault("memory", f"{message}; allowed: apart from each other")
    for name in sources or []:
        if not (folder / name).is_file():
            reader.fault("sources", f"{name} is no file of {folder}; write it, or correct the name")
    if reader.faults:
        raise InputError(reader.faults)
    return Target(
        title=title,
        # Of files and of the commands that a person copies: whatever the folder is called, one word for a shell.
        folder=re.sub(r"^\W|[^A-Za-z0-9._-]", "_", folder.resolve().name),
        cpu=tuple(flags),
        flash=(rom, rom_bytes),
        ram=(ram, ram_bytes),
        defines=(f"-DAVC_CAPACITY_ROWS={rows}", f"-DAVC_CAPACITY_RECORDS={records}"),
        estimator=estimator,
        commands=tuple(commands),
        root=folder.resolve(),
        sources=tuple(sources),
        compiler=compiler,
        install=install,
    )
