"""List the serial ports of this computer; with --ask, the avc devices behind them."""

from __future__ import annotations

import argparse
from typing import Any

from avc_casadi.cli._arguments import positive_int
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._text import table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.description = "List the serial ports of this computer, USB devices first."
    parser.add_argument(
        "--ask",
        action="store_true",
        help="open each port and ask which avc device is there; whatever else is there is sent a few bytes, "
        "and boards like the Arduino start anew",
    )
    parser.add_argument("--baud", type=positive_int, default=115200, help="rate for --ask; default 115200")


def run(args: argparse.Namespace, console: Console) -> Answer:
    """List the ports."""
    from avc_hardware import list_ports

    ports: list[dict[str, Any]] = [vars(port) for port in list_ports()]
    for port in ports:
        with console.step(port["device"]):
            port["avc_device"] = _asked(port["device"], args.baud) if args.ask and port["accessible"] else None
    document = {"schema": "avc-ports/1", "ports": ports}
    head: tuple[str, ...] = ("port", "description", "serial number", "may be opened")
    rows: list[tuple[str, ...]] = [
        (port["device"], port["description"], port["serial_number"] or "-", "yes" if port["accessible"] else "no")
        for port in ports
    ]
    if args.ask:
        head = (*head, "avc device", "coupling")
        rows = [(*row, *_told(port["avc_device"])) for row, port in zip(rows, ports, strict=True)]
    text = table(head, rows, left=range(len(head))) if rows else "none"
    return Answer(document, f"{text}\nwithout a device: --port emulator")


def _asked(port: str, baud: int) -> dict[str, Any] | None:
    """Say hello; None where no avc device answers."""
    import avc_casadi as avc
    from avc_hardware import Connection, open_link

    try:
        with Connection(open_link(port, baud=baud), baud=baud) as connection:
            device = connection.device
    except avc.LinkError:
        return None
    return {
        "name": device.name or None,
        "unique_id": device.unique_id or None,
        "build": device.build,
        "coupling_id": device.coupling_id or None,
        "sample_time_s": device.sample_time_s,
        "faults": device.faults,
    }


def _told(found: dict[str, Any] | None) -> tuple[str, str]:
    if found is None:
        return "-", "-"
    own = " ".join(filter(None, (found["name"], found["unique_id"])))
    return own or "without name and number", found["coupling_id"] or "none"
