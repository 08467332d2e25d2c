"""A firmware image: segments of an ELF file, its symbols."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from avc_casadi import MissingExtraError, UnsupportedError

_ALLOWED = "allowed: a 32-bit little-endian image of an ARM processor"


@dataclass(frozen=True)
class Segment:
    """Bytes to load at a physical address."""

    address: int
    data: bytes


@dataclass(frozen=True)
class Image:
    """A firmware image."""

    segments: tuple[Segment, ...]
    symbols: dict[str, tuple[int, int]]


def read_elf(path: Path) -> Image:
    """Read a 32-bit little-endian image of an ARM processor."""
    try:
        elffile: Any = importlib.import_module("elftools.elf.elffile")
        exceptions: Any = importlib.import_module("elftools.common.exceptions")
    except ImportError as error:
        raise MissingExtraError(
            "reading a firmware image needs the extra 'emulator': pip install 'avc-casadi[emulator]'"
        ) from error
    with path.open("rb") as stream:
        try:
            elf = elffile.ELFFile(stream)
        except exceptions.ELFError as error:
            raise UnsupportedError(f"{path.name} is no ELF image ({error}); {_ALLOWED}") from error
        if elf.elfclass != 32 or not elf.little_endian or elf["e_machine"] != "EM_ARM":
            what = f"{elf.elfclass}-bit, {'little' if elf.little_endian else 'big'}-endian, {elf['e_machine']}"
            raise UnsupportedError(f"{path.name} is {what}; {_ALLOWED}")
        segments = tuple(
            Segment(part["p_paddr"], part.data()) for part in elf.iter_segments("PT_LOAD") if part["p_filesz"]
        )
        table = elf.get_section_by_name(".symtab")
        symbols = {}
        for one in table.iter_symbols() if table else ():
            thumb = int(one["st_info"]["type"] == "STT_FUNC")  # a bit of the address of a function
            symbols[one.name] = (one["st_value"] & ~thumb, one["st_size"])
    return Image(segments, symbols)
