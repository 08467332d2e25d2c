"""An image as the files that flashing tools read: raw binary and Intel HEX."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

    from avc_hardware._elf import Image

_ERASED = 0xFF
_DATA, _END, _HIGH_ADDRESS = 0, 1, 4
_LINE = 16


def as_binary(image: Image) -> tuple[int, bytes]:
    """Return the address of the first byte and all bytes from there on; gaps hold what erased flash holds."""
    first = min(segment.address for segment in image.segments)
    last = max(segment.address + len(segment.data) for segment in image.segments)
    data = bytearray([_ERASED]) * (last - first)
    for segment in image.segments:
        at = segment.address - first
        data[at : at + len(segment.data)] = segment.data
    return first, bytes(data)


def as_intel_hex(image: Image) -> str:
    """Return the lines of an Intel HEX file."""
    return "".join(f":{line.hex().upper()}\n" for line in _records(image))


def _records(image: Image) -> Iterator[bytes]:
    high = -1
    first, data = as_binary(image)
    for at in range(0, len(data), _LINE):
        address = first + at
        if address >> 16 != high:
            high = address >> 16
            yield _record(0, _HIGH_ADDRESS, high.to_bytes(2, "big"))
        yield _record(address & 0xFFFF, _DATA, data[at : at + _LINE])
    yield _record(0, _END, b"")


def _record(address: int, kind: int, data: bytes) -> bytes:
    content = bytes([len(data), *address.to_bytes(2, "big"), kind]) + data
    return content + bytes([-sum(content) & 0xFF])
