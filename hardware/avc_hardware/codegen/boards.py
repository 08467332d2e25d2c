"""Boards of the firmware: processor, memory and sources. Each is a folder with a ``board.toml``, anywhere."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, ValidationError

from avc_casadi import Fault, InputError
from avc_casadi.files.toml import tables_of, text_of

MANIFEST = "board.toml"
FIRMWARE = Path(__file__).resolve().parent.parent / "firmware"
PACKAGED = "netduinoplus2"
IMAGE = FIRMWARE / "image" / f"{PACKAGED}.elf"
ARM_INSTALL = "apt-get install -y --no-install-recommends gcc-arm-none-eabi"
_Text = Annotated[str, StringConstraints(strip_whitespace=True, min_length=1)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class _Flash(_Table):
    """The vectors of a Cortex-M stand at a multiple of their size."""

    origin: int = Field(ge=0, lt=2**32, multiple_of=256)
    bytes: int = Field(ge=4, le=2**32, multiple_of=4)


class _Memory(_Flash):
    origin: int = Field(ge=0, lt=2**32, multiple_of=8)


class _Capacity(_Table):
    """The format counts rows and records in 16 bits; a table with state feedback is as long as 27 rows."""

    rows: int = Field(default=256, ge=27, le=4096)
    records: int = Field(default=4096, ge=128, le=32768)  # that it is a power of two the source checks


class Board(_Table):
    """One board, as its manifest states it."""

    root: Path
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

    @property
    def name(self) -> str:
        """Of files and of the commands that a person copies: whatever the folder is called, one word for a shell."""
        return re.sub(r"^\W|[^A-Za-z0-9._-]", "_", self.root.name)

    @property
    def own(self) -> bool:
        """Whether it is not of the package."""
        return FIRMWARE not in self.root.parents


def read_board(folder: Path) -> Board:
    """Read the manifest of a board; InputError with every fault of it."""
    path = folder / MANIFEST
    try:
        keys: dict[str, Any] = tables_of(text_of(path, "write one: hardware/PORTING.md"), str(path))
        board = Board.model_validate({**keys, "root": folder.resolve()})
    except ValidationError as error:
        faults = [_fault(path, one) for one in error.errors()]
        raise InputError(faults) from error
    except InputError as error:
        raise InputError([replace(fault, key="board") for fault in error.faults]) from error
    faults = [
        Fault(str(path), None, "sources", f"{name} is no file of {folder}; write it, or correct the name")
        for name in board.sources
        if not (folder / name).is_file()
    ]
    if faults:
        raise InputError(faults)
    return board


def _fault(path: Path, error: Any) -> Fault:
    key = ".".join(str(place) for place in error["loc"])
    told = {
        "extra_forbidden": "is unknown (hardware/PORTING.md lists the keys)",
        "missing": "is missing (hardware/PORTING.md)",
    }
    return Fault(str(path), None, key, told.get(error["type"], f"is {error['input']!r}; {error['msg']}"))
