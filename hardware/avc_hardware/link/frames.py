"""Frames: COBS with a zero byte as delimiter, and a CRC-32 over the content. Nothing here waits or fails."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass

PROTOCOL_VERSION = 1
MAX_ENCODED = 1024
MAX_CONTENT = 1016
DELIMITER = b"\x00"
_HEADER = struct.Struct("<BBH")
_CRC = struct.Struct("<I")
MAX_PAYLOAD = MAX_CONTENT - _HEADER.size - _CRC.size


@dataclass(frozen=True)
class Frame:
    """One message on the wire."""

    type: int
    sequence: int
    payload: bytes
    version: int = PROTOCOL_VERSION


def cobs_encode(data: bytes) -> bytes:
    """Stuff bytes so that none is zero (consistent overhead byte stuffing)."""
    out = bytearray()
    blocks = data.split(b"\x00")
    for index, block in enumerate(blocks):
        rest = block
        while len(rest) >= 254:
            out += b"\xff" + rest[:254]
            rest = rest[254:]
            if not rest and index == len(blocks) - 1:
                return bytes(out)
        out.append(len(rest) + 1)
        out += rest
    return bytes(out)


def cobs_decode(data: bytes) -> bytes | None:
    """Undo `cobs_encode`; None where the bytes are not stuffed."""
    out = bytearray()
    place = 0
    while place < len(data):
        code = data[place]
        block = data[place + 1 : place + code]
        if code == 0 or len(block) != code - 1 or 0 in block:
            return None
        out += block
        place += code
        if code != 0xFF and place < len(data):
            out.append(0)
    return bytes(out)


def encode(frame: Frame) -> bytes:
    """Return the frame's bytes with the delimiter at the end."""
    content = _HEADER.pack(frame.version, frame.type, frame.sequence) + frame.payload
    return cobs_encode(content + _CRC.pack(zlib.crc32(content))) + DELIMITER


def decode(encoded: bytes) -> Frame | None:
    """Return the frame of the bytes between two delimiters; None where it is broken."""
    content = cobs_decode(encoded)
    if content is None or not _HEADER.size + _CRC.size <= len(content) <= MAX_CONTENT:
        return None
    body, check = content[: -_CRC.size], content[-_CRC.size :]
    if zlib.crc32(body) != _CRC.unpack(check)[0]:
        return None
    version, kind, sequence = _HEADER.unpack_from(body)
    return Frame(kind, sequence, body[_HEADER.size :], version)


class Decoder:
    """Collects bytes into frames; broken ones are counted and skipped."""

    def __init__(self) -> None:
        self._pending = bytearray()
        self._skipping = False
        self.broken = 0

    def feed(self, data: bytes) -> list[Frame]:
        """Return the frames that these bytes complete."""
        frames = []
        *ended, rest = data.split(DELIMITER)
        for piece in ended:
            self._collect(piece)
            if self._pending or self._skipping:
                frame = None if self._skipping else decode(bytes(self._pending))
                self._pending.clear()
                self._skipping = False
                if frame is None:
                    self.broken += 1
                else:
                    frames.append(frame)
        self._collect(rest)
        return frames

    def _collect(self, piece: bytes) -> None:
        self._pending += piece
        if len(self._pending) >= MAX_ENCODED:  # no delimiter for too long: not a frame
            self._pending.clear()
            self._skipping = True
