"""Instructions of a control tick, by function, counted one by one on the emulated core."""

from __future__ import annotations

import bisect
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from host_device import BEFORE_WALL

from avc_hardware.codegen.boards import IMAGE
from avc_hardware.codegen.image import read_elf
from avc_hardware.emulator.board import EmulatedBoard
from avc_hardware.emulator.machine import CLOCK_HZ
from avc_hardware.link.connection import Connection
from avc_hardware.link.push import push_over

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling

_ENTRY = "avc_control_tick"
_OUTSIDE = "avc_on_tick"


def _conditional(code: Callable[[int, int], bytes], address: int) -> tuple[int, ...]:
    """Return the addresses of the instructions in the if-then block that begins here; empty where none does."""
    first, second = code(address, 2)
    mask = first & 15
    if second != 0xBF or mask == 0:
        return ()
    found = []
    at = address + 2
    for _ in range(4 - ((mask & -mask).bit_length() - 1)):
        found.append(at)
        at += 4 if code(at, 2)[1] >> 3 in {0b11101, 0b11110, 0b11111} else 2
    return tuple(found)


@dataclass(frozen=True)
class TickCount:
    """Instructions of the longest of many ticks."""

    functions: dict[str, int]
    total: int


def tick_instructions(
    coupling: Coupling, *, counts: Callable[[int], int], ticks: int = 500, image: Path = IMAGE
) -> tuple[TickCount, ...]:
    """Push a coupling to an emulated board at rest, then move and count every tick."""
    symbols = read_elf(image).symbols
    functions = sorted((address, address + size, name) for name, (address, size) in symbols.items() if size)
    starts = [address for address, _, _ in functions]
    found: list[Counter[str]] = []
    counting = moving = False
    tick = -1
    blocks: dict[int, tuple[int, ...]] = {}
    in_block: set[int] = set()

    def seen(address: int) -> None:
        nonlocal counting
        _, end, name = functions[bisect.bisect_right(starts, address) - 1]
        if address >= end:
            return
        if address == symbols[_ENTRY][0]:
            counting = moving
            found.append(Counter())
        elif name == _OUTSIDE:
            counting = False
        if not counting:
            return
        # Unicorn does not call for an instruction whose condition fails; the core spends its time on it all the same.
        if address not in blocks:
            blocks[address] = _conditional(board.machine.code, address)
        if address not in in_block:
            found[-1][name] += 1 + len(blocks[address])
        in_block.discard(address)
        if blocks[address]:
            in_block.clear()
            in_block.update(blocks[address])

    def encoder(_cycle: int) -> int:
        nonlocal tick
        tick += moving
        return counts(tick) if moving else BEFORE_WALL

    board = EmulatedBoard(image, encoder=encoder, on_instruction=seen)
    with Connection(board, session=1) as connection:
        push_over(connection, coupling)
        connection.wait(0.3)
    found.clear()
    moving = True
    board.machine.run_until(board.machine.cycle + (ticks + 1) * CLOCK_HZ // 1000)
    return tuple(TickCount(dict(count), sum(count.values())) for count in found[:ticks])
