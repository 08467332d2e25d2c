"""List the serial ports of this computer."""

from __future__ import annotations

import argparse

from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._text import table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments; there are none."""
    parser.description = "List the serial ports of this computer, USB devices first."


def run(args: argparse.Namespace, console: Console) -> Answer:  # noqa: ARG001
    """List the ports."""
    from avc_hardware import list_ports

    ports = [vars(port) for port in list_ports()]
    document = {"schema": "avc-ports/1", "ports": ports}
    rows = [
        (port["device"], port["description"], port["serial_number"] or "-", "yes" if port["accessible"] else "no")
        for port in ports
    ]
    text = table(("port", "description", "serial number", "may be opened"), rows, left=range(4)) if rows else "none"
    return Answer(document, f"{text}\nwithout a device: --port emulator")
