"""Clear the faults that a device has latched, once they have been shown: its coupling takes over when it is let go."""

from __future__ import annotations

import argparse

from avc_casadi.cli._arguments import add_port, positive_int
from avc_casadi.cli._console import Answer, Console


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_port(parser)
    parser.add_argument("--baud", type=positive_int, default=115200, help="rate of a serial port; default 115200")


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Clear; 1 if a fault is still there."""
    from avc_hardware import clear_faults

    with console.step(f"clear {args.port}"):
        found = clear_faults(args.port, baud=args.baud, on_silence=console.notice)
    document = {
        "schema": "avc-clear/1",
        "port": found.port,
        "were": [fault.word for fault in found.were],
        "first": [fault.word for fault in found.first],
        "tick": found.tick,
        "left": [fault.word for fault in found.left],
        "mode": found.status.mode,
    }
    lines = list(found.were.advice) or ["no fault was latched"]
    if found.were & found.first:
        lines.append(f"first, at tick {found.tick}: {found.first.word}")
    if found.left:
        return Answer(
            document, "\n".join(lines), code=1, complaint=f"avc: {found.port}: still there: {found.left.word}"
        )
    if found.were:
        lines.append(f"cleared; the device is in mode {found.status.mode}")
    return Answer(document, "\n".join(lines))
