"""The few parts of an ELF file that an emulated board needs: what to load where, and where the symbols are."""

from __future__ import annotations

import struct
from dataclasses import dataclass, replace
from pathlib import Path

from avc_casadi import UnsupportedError

_LOAD = 1
_PROCESSORS = (40, 243)
_SYMBOL_TABLE = 2


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
    """
    data = path.read_bytes()
    if data[:6] != b"\x7fELF\x01\x01" or struct.unpack_from("<H", data, 18)[0] not in _PROCESSORS:
        raise UnsupportedError(f"{path.name} is no 32-bit little-endian ARM or RISC-V ELF image")
    program_at, section_at = struct.unpack_from("<II", data, 28)
    program_size, programs, section_size, sections = struct.unpack_from("<HHHH", data, 42)
    segments = []
    for index in range(programs):
        kind, offset, _, physical, size = struct.unpack_from("<5I", data, program_at + index * program_size)
        if kind == _LOAD and size:
            segments.append(Segment(physical, data[offset : offset + size]))
    symbols: dict[str, tuple[int, int]] = {}
    headers = [struct.unpack_from("<10I", data, section_at + index * section_size) for index in range(sections)]
    for header in headers:
        if header[1] == _SYMBOL_TABLE:
            strings = headers[header[6]]
            names = data[strings[4] : strings[4] + strings[5]]
            for at in range(header[4], header[4] + header[5], 16):
                name, value, size = struct.unpack_from("<III", data, at)
                text = names[name : names.index(b"\0", name)].decode()
                if text:
                    symbols[text] = (value & ~1 if data[at + 12] & 15 == 2 else value, size)
    return Image(tuple(segments), symbols)
