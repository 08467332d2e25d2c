"""Boards of the firmware: processor, memory and sources. One of your own is a folder anywhere with a ``board.toml``."""

from __future__ import annotations

import re
import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StringConstraints, ValidationError

from avc_casadi import Fault, InputError
from avc_casadi.files.toml_text import tables_of, text_of

MANIFEST = "board.toml"
FIRMWARE = Path(__file__).resolve().parent.parent / "firmware"
IMAGE = FIRMWARE / "image" / "netduinoplus2.elf"
ARM_INSTALL = "apt-get install -y --no-install-recommends gcc-arm-none-eabi"


@dataclass(frozen=True)
class Target:
    """One board."""

    title: str
    name: str
    cpu: tuple[str, ...]
    flash: tuple[int, int]  # origin and size, bytes
    ram: tuple[int, int]
    root: Path  # of board.h and the sources
    defines: tuple[str, ...] = ()
    estimator: str = "fused"  # too slow for floats in software
    commands: tuple[str, ...] = ()  # to flash or to run an image, with {name} for the file without its ending
    sources: tuple[str, ...] = ("board.c",)
    compiler: str = "arm-none-eabi-gcc"
    install: str = ARM_INSTALL

    @property
    def own(self) -> bool:
        """Whether it is not of the package."""
        return FIRMWARE not in self.root.parents


TARGETS = {
    "netduinoplus2": Target(
        "STM32F405, Cortex-M4F at 168 MHz, real or emulated",
        "netduinoplus2",
        ("-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"),
        (0x08000000, 0x100000),
        (0x20000000, 0x20000),
        FIRMWARE / "boards" / "netduinoplus2",
        commands=(
            "st-flash --reset write {name}.bin 0x08000000",
            "dfu-util -a 0 -s 0x08000000:leave -D {name}.bin    (BOOT0 high at reset)",
            'openocd -f interface/stlink.cfg -f target/stm32f4x.cfg -c "program {name}.elf verify reset exit"',
            "qemu-system-arm -M netduinoplus2 -kernel {name}.elf -display none -serial pty",
        ),
    ),
}

_Text = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class _Flash(_Table):
    """The vectors of a Cortex-M stand at a multiple of their size."""

    origin: int = Field(ge=0, lt=2**32, multiple_of=256)
    bytes: int = Field(ge=4, le=2**32, multiple_of=4)


class _Memory(_Flash):
    origin: int = Field(ge=0, lt=2**32, multiple_of=8)


def _power_of_two(value: int) -> int:
    if value & (value - 1):
        raise ValueError("should be a power of two")
    return value


class _Capacity(_Table):
    """The format counts rows and records in 16 bits; a table with state feedback is as long as 27 rows."""

    rows: int = Field(default=256, ge=27, le=4096)
    records: Annotated[int, Field(ge=128, le=32768), AfterValidator(_power_of_two)] = 4096


class _Board(_Table):
    title: _Text = ""
    compiler: _Text
    install: _Text = "see its maker's page"
    flags: list[_Text] = []
    sources: list[_Text] = Field(min_length=1)
    estimator: Literal["zero-crossing", "spectral-peak", "adaptive-notch", "fused"] = "zero-crossing"
    commands: list[_Text] = []
    flash: _Flash
    memory: _Memory
    capacity: _Capacity = _Capacity()


def read_board(folder: Path) -> Target:
    """Read the manifest of a board; InputError with every fault of it."""
    path = folder / MANIFEST
    try:
        keys: dict[str, Any] = tables_of(text_of(path, "write one: hardware/PORTING.md"), str(path))
        board = _Board.model_validate(keys)
    except ValidationError as error:
        faults = [_fault(path, one) for one in error.errors()]
        raise InputError(faults) from error
    except InputError as error:
        raise InputError([replace(fault, key="board") for fault in error.faults]) from error
    flash, memory = ((region.origin, region.bytes) for region in (board.flash, board.memory))
    faults = [
        Fault(str(path), None, "sources", f"{name} is no file of {folder}; write it, or correct the name")
        for name in board.sources
        if not (folder / name).is_file()
    ]
    if shutil.which(board.compiler) is None:
        message = f"is {board.compiler!r}, which is no program on the path; correct the name, or install it: "
        faults.append(Fault(str(path), None, "compiler", message + board.install))
    if max(flash[0], memory[0]) < min(sum(flash), sum(memory)):
        faults.append(Fault(str(path), None, "memory", "lies over flash; allowed: apart from each other"))
    if faults:
        raise InputError(faults)
    return Target(
        title=board.title or folder.name,
        # Of files and of the commands that a person copies: whatever the folder is called, one word for a shell.
        name=re.sub(r"^\W|[^A-Za-z0-9._-]", "_", folder.resolve().name),
        cpu=tuple(board.flags),
        flash=flash,
        ram=memory,
        root=folder.resolve(),
        defines=(f"-DAVC_CAPACITY_ROWS={board.capacity.rows}", f"-DAVC_CAPACITY_RECORDS={board.capacity.records}"),
        estimator=board.estimator,
        commands=tuple(board.commands),
        sources=tuple(board.sources),
        compiler=board.compiler,
        install=board.install,
    )


def _fault(path: Path, error: Any) -> Fault:
    key = ".".join(str(place) for place in error["loc"])
    if error["type"] == "extra_forbidden":
        return Fault(str(path), None, key, "is unknown (hardware/PORTING.md lists the keys)")
    if error["type"] == "missing":
        return Fault(str(path), None, key, "is missing (hardware/PORTING.md)")
    return Fault(str(path), None, key, f"is {error['input']!r}; {error['msg']}")
