"""The few parts of an ELF file that an emulated board needs: what to load where, and where the symbols are."""

from __future__ import annotations

import importlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from avc_casadi import MissingExtraError, UnsupportedError

_PROCESSORS = ("EM_ARM", "EM_RISCV")
_ALLOWED = "allowed: a 32-bit little-endian image of an ARM or RISC-V processor"


@dataclass(frozen=True)
class Segment:
    """Bytes to load at a physical address."""

    address: int
    data: bytes


@dataclass(frozen=True)
class Image:
    """A firmware image.

    Attributes:
        segments: to load.
        symbols: name to (address, size); function addresses without the Thumb bit.
    """

    segments: tuple[Segment, ...]
    symbols: dict[str, tuple[int, int]]

    def patched(self, symbol: str, data: bytes) -> Image:
        """Return the image with other bytes at a symbol.

        Raises:
            UnsupportedError: no such symbol of this size is loaded; the image is an older one.
        """
        address, size = self.symbols.get(symbol, (0, 0))
        for index, segment in enumerate(self.segments):
            at = address - segment.address
            if size == len(data) and 0 <= at <= len(segment.data) - size:
                changed = segment.data[:at] + data + segment.data[at + size :]
                parts = (*self.segments[:index], Segment(segment.address, changed), *self.segments[index + 1 :])
                return replace(self, segments=parts)
        raise UnsupportedError(
            f"the image has no {len(data)} bytes of {symbol}; build it anew: python -m avc_hardware.firmware_build"
        )


def read_elf(path: Path) -> Image:
    """Read a 32-bit little-endian image of an ARM or RISC-V processor.

    Raises:
        UnsupportedError: it is something else.
        MissingExtraError: pyelftools is not installed.
    """
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
        if elf.elfclass != 32 or not elf.little_endian or elf["e_machine"] not in _PROCESSORS:
            what = f"{elf.elfclass}-bit, {'little' if elf.little_endian else 'big'}-endian, {elf['e_machine']}"
            raise UnsupportedError(f"{path.name} is {what}; {_ALLOWED}")
        segments = tuple(
            Segment(part["p_paddr"], part.data()) for part in elf.iter_segments("PT_LOAD") if part["p_filesz"]
        )
        table = elf.get_section_by_name(".symtab")
        symbols = {one.name: _place(one) for one in (table.iter_symbols() if table else ()) if one.name}
    return Image(segments, symbols)


def _place(symbol: Any) -> tuple[int, int]:
    """Return address and size of a symbol, without the Thumb bit of a function."""
    address, size = symbol["st_value"], symbol["st_size"]
    return (address & ~1 if symbol["st_info"]["type"] == "STT_FUNC" else address), size
