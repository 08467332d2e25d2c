"""A firmware image: segments of an ELF file, its symbols."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from avc_casadi import MissingExtraError


@dataclass(frozen=True)
class Image:
    """A firmware image: bytes by the physical address at which they are loaded; address and size of each symbol."""

    segments: dict[int, bytes]
    symbols: dict[str, tuple[int, int]]


def read_elf(path: Path) -> Image:
    """Read an image that `build_image` has made."""
    try:
        elffile: Any = importlib.import_module("elftools.elf.elffile")
    except ImportError as error:
        raise MissingExtraError(
            "reading a firmware image needs the extra 'emulator': pip install 'avc-casadi[emulator]'"
        ) from error
    with path.open("rb") as stream:
        elf = elffile.ELFFile(stream)
        segments = {part["p_paddr"]: part.data() for part in elf.iter_segments("PT_LOAD") if part["p_filesz"]}
        symbols = {}
        for symbol in elf.get_section_by_name(".symtab").iter_symbols():
            thumb = int(symbol["st_info"]["type"] == "STT_FUNC")  # a bit of the address of a function
            symbols[symbol.name] = (symbol["st_value"] & ~thumb, symbol["st_size"])
    return Image(segments, symbols)
