"""Serial ports of this computer, and the one of a known USB device."""

from __future__ import annotations

import os
from dataclasses import dataclass

from serial.tools import list_ports as tools

from avc_casadi import PortError


@dataclass(frozen=True)
class Port:
    """A serial port.

    Attributes:
        device: path to give as ``--port``.
        description: what the system calls it.
        manufacturer: None where unknown.
        vendor_id: USB vendor, None for a port that is not USB.
        product_id: USB product.
        serial_number: of the USB device: the same board has the same number on any socket.
        accessible: whether this user may open it.
    """

    device: str
    description: str
    manufacturer: str | None
    vendor_id: int | None
    product_id: int | None
    serial_number: str | None
    accessible: bool


def list_ports() -> tuple[Port, ...]:
    """Return the serial ports, USB devices first; pseudo-terminals never appear."""
    found = [
        Port(
            device=info.device,
            description=info.description or "",
            manufacturer=info.manufacturer,
            vendor_id=info.vid,
            product_id=info.pid,
            serial_number=info.serial_number,
            accessible=os.access(info.device, os.R_OK | os.W_OK) or os.name == "nt",
        )
        for info in tools.comports()
    ]
    return tuple(sorted(found, key=lambda port: (port.vendor_id is None, port.device)))


def find_port(serial_number: str) -> str:
    """Return the path that the USB device with this serial number has now; it may change with every plugging in.

    Raises:
        PortError: it is not there.
    """
    ports = list_ports()
    for port in ports:
        if port.serial_number == serial_number:
            return port.device
    known = ", ".join(port.serial_number for port in ports if port.serial_number) or "none"
    raise PortError(f"no serial port has the USB serial number {serial_number}; present: {known}")
