"""The serial ports of this computer, and the avc devices behind them."""

from __future__ import annotations

import argparse
from typing import Any

from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._text import table

_NO = "no: add yourself to its group (dialout)"


def found_ports(args: argparse.Namespace, console: Console) -> list[dict[str, Any]]:
    """List the ports, with --ask with the device behind each; it is None where none was asked or none answers."""
    from avc_hardware import list_ports

    ports: list[dict[str, Any]] = [vars(port) for port in list_ports()]
    for port in ports:
        with console.step(port["device"]):
            port["avc_device"] = _asked(port["device"], args.baud) if args.ask and port["accessible"] else None
    return ports


def ports_answer(args: argparse.Namespace, console: Console) -> Answer:
    """Answer with the ports alone."""
    ports = found_ports(args, console)
    text = ports_text(ports, asked=args.ask)
    return Answer({"schema": "avc-ports/1", "ports": ports}, f"{text}\nwithout a device: --port emulator")


def ports_text(ports: list[dict[str, Any]], *, asked: bool) -> str:
    """Lay the ports out for people."""
    head: tuple[str, ...] = ("port", "description", "serial number", "may be opened")
    rows: list[tuple[str, ...]] = [
        (port["device"], port["description"], port["serial_number"] or "-", "yes" if port["accessible"] else _NO)
        for port in ports
    ]
    if asked:
        head = (*head, "avc device", "coupling")
        rows = [(*row, *_told(port["avc_device"])) for row, port in zip(rows, ports, strict=True)]
    return table(head, rows, left=range(len(head))) if rows else "serial ports: none"


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
