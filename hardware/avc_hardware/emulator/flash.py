"""The flash controller of an emulated STM32F405, with its two sectors of non-volatile storage.

By the reference manual (RM0090, 3.6 and 3.9): two keys unlock it, other ones lock it until the next reset; a sector is
erased as a whole, to ones; writing a word only clears bits; an error sets a bit of the status and has no other effect.
While it is busy the flash cannot be read.
"""

from __future__ import annotations

import random

BASE = 0x40023C00
"""Address of its registers."""
SECTOR_BYTES = 0x20000
KEPT = 0x080C0000
"""Address of sectors 10 and 11, behind which the flash ends."""
_FIRST_SECTOR, _SECTORS = 10, 2
_KEY, _STATUS, _CONTROL = 0x04, 0x0C, 0x10
_KEYS = (0x45670123, 0xCDEF89AB)
_BUSY, _LOCK = 1 << 16, 1 << 31
_PROGRAM, _ERASE, _START = 1 << 0, 1 << 1, 1 << 16
_WRITE_PROTECTED, _MISALIGNED, _WRONG_SIZE, _WRONG_SEQUENCE = 1 << 4, 1 << 5, 1 << 6, 1 << 7
_ERRORS = _WRITE_PROTECTED | _MISALIGNED | _WRONG_SIZE | _WRONG_SEQUENCE
# Typical times of the data sheet, in cycles of 168 MHz: a sector of 128 KB by words 1 s, a word 16 us.
_ERASE_CYCLES, _WORD_CYCLES = 168_000_000, 2688


class FlashController:
    """Registers and memory.

    Attributes:
        memory: of the two sectors.
        left: operations (erases, words) until a power cut in the middle of one; None: no cut.
        powered: false after the cut, until the next reset.
        busy_until: cycle at which the running operation ends.
    """

    def __init__(self, memory: bytes = b"\xff" * (_SECTORS * SECTOR_BYTES)) -> None:
        """Start with a content, or erased."""
        self.memory = bytearray(memory)
        self.left: int | None = None
        self.reset()

    def reset(self) -> None:
        """Lock it; its content is kept."""
        self.powered = True
        self.busy_until = 0
        self._keys: tuple[int, ...] = ()
        self._status = 0
        self._control = _LOCK

    def busy(self, cycle: int) -> bool:
        """Return whether the flash cannot be read."""
        return cycle < self.busy_until

    def read_register(self, address: int, cycle: int) -> int:
        """Return the value of a register."""
        match address - BASE:
            case 0x0C:
                return self._status | (_BUSY if self.busy(cycle) else 0)
            case 0x10:
                return self._control
        return 0

    def write_register(self, address: int, value: int, cycle: int) -> None:
        """Accept a key, clear errors, or start to erase."""
        register = address - BASE
        if register == _KEY:
            self._keys = (*self._keys, value)
            if self._keys == _KEYS:
                self._control &= ~_LOCK
        elif register == _STATUS:
            self._status &= ~(value & _ERRORS)
        elif register == _CONTROL and not self._control & _LOCK:
            self._control = value
            if value & _LOCK:
                self._keys = ()
            elif value & _START and value & _ERASE:
                self._control &= ~_START
                self._erase((value >> 3 & 0xF) - _FIRST_SECTOR, cycle)

    def read(self, offset: int, size: int) -> int:
        """Return the bytes at an offset from `KEPT`."""
        return int.from_bytes(self.memory[offset : offset + size], "little")

    def write(self, offset: int, size: int, value: int, cycle: int) -> None:
        """Program a word, where the controller is set for it."""
        if self._control & (_LOCK | _PROGRAM) != _PROGRAM:
            self._status |= _WRONG_SEQUENCE
        elif size != 1 << (self._control >> 8 & 3):
            self._status |= _WRONG_SIZE
        elif offset % size:
            self._status |= _MISALIGNED
        else:
            whole = self._takes()
            kept = 0 if whole else random.Random(offset).getrandbits(8 * size)  # noqa: S311 - bits not yet written
            new = self.read(offset, size) & (value | kept)
            self.memory[offset : offset + size] = new.to_bytes(size, "little")
            self.busy_until = cycle + _WORD_CYCLES

    def _erase(self, index: int, cycle: int) -> None:
        if not 0 <= index < _SECTORS:
            self._status |= _WRITE_PROTECTED  # the program is there
            return
        place = slice(index * SECTOR_BYTES, (index + 1) * SECTOR_BYTES)
        if self._takes():
            self.memory[place] = b"\xff" * SECTOR_BYTES
        else:
            erased = random.Random(index).randbytes(SECTOR_BYTES)  # noqa: S311 - bits that are ones already
            self.memory[place] = bytes(old | new for old, new in zip(self.memory[place], erased, strict=True))
        self.busy_until = cycle + _ERASE_CYCLES

    def _takes(self) -> bool:
        """Return whether the power lasts for one more operation."""
        if self.left is None:
            return True
        self.left -= 1
        self.powered = self.left >= 0
        return self.powered
