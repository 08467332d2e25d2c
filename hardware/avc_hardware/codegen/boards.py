"""Boards of the firmware: processor, memory and sources. Each is a folder with a ``board.toml``, anywhere."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, PrivateAttr

from avc_casadi import Fault, InputError
from avc_casadi.files.toml import tables_of, text_of
from avc_casadi.model import table as t
from avc_casadi.model.quantity import Whole

MANIFEST = "board.toml"
FIRMWARE = Path(__file__).resolve().parent.parent / "firmware"
PACKAGED = "netduinoplus2"
IMAGE = FIRMWARE / "image" / f"{PACKAGED}.elf"
_Address = Annotated[int, BeforeValidator(Whole(0, 2**32 - 1))]
_Size = Annotated[int, BeforeValidator(Whole(4, 2**32)), Field(multiple_of=4)]


class _Flash(t.Table):
    """The vectors of a Cortex-M stand at a multiple of their size."""

    origin: Annotated[_Address, Field(multiple_of=256)]
    bytes: _Size


class _Memory(t.Table):
    origin: Annotated[_Address, Field(multiple_of=8)]
    bytes: _Size


class _Capacity(t.Table):
    """The format counts rows and records in 16 bits; a table with state feedback is as long as 27 rows."""

    rows: Annotated[int, BeforeValidator(Whole(27, 4096))] = 256
    records: Annotated[int, BeforeValidator(Whole(128, 32768))] = 4096  # a power of two, which the source checks


class Board(t.Table):
    """One board, as its manifest states it."""

    title: t.Text = ""
    compiler: t.Text
    install: t.Text = "see the page of its manufacturer"
    flags: list[t.Text] = Field([])
    sources: list[t.Text] = Field(min_length=1)
    estimator: Literal["zero-crossing", "spectral-peak", "adaptive-notch", "fused"] = "zero-crossing"
    commands: list[t.Text] = Field([])
    flash: _Flash
    memory: _Memory
    capacity: _Capacity = _Capacity()
    _root: Path = PrivateAttr()

    @property
    def root(self) -> Path:
        """Its folder."""
        return self._root

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
    file = str(folder / MANIFEST)
    board = t.valid(Board, tables_of(text_of(folder / MANIFEST, "write one: hardware/PORTING.md"), file), file)
    board._root = folder.resolve()  # noqa: SLF001 - where the manifest stands
    faults = [
        Fault(file, None, "sources", f"{name} is no file of {folder}; create the file, or correct the name")
        for name in board.sources
        if not (folder / name).is_file()
    ]
    if faults:
        raise InputError(faults)
    return board
