"""The serial ports of this computer, and the avc devices behind them."""

from __future__ import annotations

import argparse
from typing import Any

from avc_casadi.cli._console import Answer, Console


def found_ports(args: argparse.Namespace, console: Console) -> list[dict[str, Any]]:
    """List the ports, with --ask with the device behind each; it is None where none was queried or none answers."""
    from avc_hardware import list_ports

    ports: list[dict[str, Any]] = [vars(port) for port in list_ports()]
    for port in ports:
        with console.step(port["device"]):
            port["avc_device"] = _asked(port["device"], args.baud) if args.ask and port["accessible"] else None
    return ports


def ports_answer(args: argparse.Namespace, console: Console) -> Answer:
    """Return the ports alone."""
    from avc_casadi.present.pages.installation import port_rows

    ports = found_ports(args, console)
    text = console.page.rendered(
        "serial ports", port_rows(ports, asked=args.ask), ["without a device: --port emulator"]
    )
    return Answer({"schema": "avc-ports/1", "ports": ports}, text)


def _asked(port: str, baud: int) -> dict[str, Any] | None:
    """Send HELLO; None where no avc device answers."""
    import avc_casadi as avc
    from avc_hardware import Connection, open_link

    try:
        with Connection(open_link(port, baud=baud), baud=baud) as connection:
            device = connection.device
    except avc.LinkError:
        return None
    return {
        "unique_id": device.unique_id or None,
        "build": device.build,
        "coupling_id": device.coupling_id or None,
        "sample_time_s": device.sample_time_s,
        "faults": device.faults,
    }
