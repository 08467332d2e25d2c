"""Instructions of a control tick, by function, counted one by one on the emulated core."""

from __future__ import annotations

import bisect
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from avc_casadi.design import GainSchedule
from avc_hardware._connection import Connection
from avc_hardware._elf import read_elf
from avc_hardware._emulator import EmulatedBoard
from avc_hardware._firmware import IMAGE
from avc_hardware._machine import CLOCK_HZ
from avc_hardware._table import TableSettings, gain_table

_ENTRY = "avc_device_tick"
_OUTSIDE = "systick_handler"


@dataclass(frozen=True)
class TickCount:
    """Instructions of the longest of many ticks.

    Attributes:
        functions: instructions in each function, without what it calls.
        total: of the whole tick, from the call of `avc_device_tick` to its return.
    """

    functions: dict[str, int]
    total: int


def tick_instructions(
    gains: GainSchedule,
    *,
    settings: TableSettings | None = None,
    motion_m: Callable[[float], float],
    ticks: int = 500,
    image: Path = IMAGE,
) -> tuple[TickCount, ...]:
    """Push a table to an emulated board and count every tick after that.

    Args:
        gains: the table.
        settings: what travels with it.
        motion_m: position of the encoder at a time.
        ticks: how many.
        image: of the netduinoplus2 board.
    """
    symbols = read_elf(image).symbols
    functions = sorted((address, address + size, name) for name, (address, size) in symbols.items() if size)
    starts = [address for address, _, _ in functions]
    counts: list[Counter[str]] = []
    counting = False

    def seen(address: int) -> None:
        nonlocal counting
        _, end, name = functions[bisect.bisect_right(starts, address) - 1]
        if address >= end:
            return
        if name == _ENTRY and address == symbols[_ENTRY][0]:
            counting = True
            counts.append(Counter())
        elif name == _OUTSIDE:
            counting = False
        if counting:
            counts[-1][name] += 1

    board = EmulatedBoard(image, motion_m=motion_m, on_instruction=seen)
    with Connection(board, session=1) as connection:
        connection.run(connection.session.push(gain_table(gains, settings=settings), connection.device))
    counts.clear()
    board.machine.run_until(board.machine.cycle + ticks * CLOCK_HZ // 1000)
    return tuple(TickCount(dict(count), sum(count.values())) for count in counts[:ticks])
