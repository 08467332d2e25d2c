"""The measured tables of hardware/README.md, from results/hardware.json."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from studied import table

Document = Mapping[str, Any]


def wire(found: Document) -> str:
    """What a push and a question take."""
    rates = found["wire"]

    def row(title: str, cell: Callable[[Document], str]) -> tuple[str, ...]:
        return (title, *(cell(rate) for rate in rates.values()))

    rows = [
        row("whole push, out of contact", lambda rate: f"{rate['push_s']:.3f} s"),
        row("STATUS, there and back", lambda rate: f"{1e3 * rate['status_s']:.2g} ms"),
        row("SET_GAINS, there and back", lambda rate: f"{1e3 * rate['set_gains_s']:.2g} ms"),
        row("SET_GAINS at 100 Hz for 5 s", lambda rate: f"{rate['taken']} of {rate['sent']} taken"),
    ]
    return table(("200 rows pushed, verified and read back", *(f"{baud} baud" for baud in rates)), rows)


def ticks(found: Document) -> str:
    """What a tick costs."""
    rows = [(title, f"{cost['typical']:.0f}", f"{cost['most']:.0f}") for title, cost in found["ticks"].items()]
    return table(("instructions of a whole tick, Cortex-M4F", "typical", "at most"), rows)


def observers(found: Document) -> str:
    """What an observer costs."""
    rows = [
        (states, f"{one['bytes']}", f"{one['push_s']:.3f} s", f"{one['typical']:.0f}")
        for states, one in found["observers"].items()
    ]
    return table(("states", "bytes of the table", "pushed, 115200 baud", "instructions in a tick"), rows)


def boards(found: Document) -> str:
    """What a board has to hold."""
    rows = [
        (name, f"{one['flash'] / 1e3:.1f} KB", f"{one['memory'] / 1e3:.1f} KB") for name, one in found["boards"].items()
    ]
    return table(("board", "flash", "memory"), rows)
