"""Serial ports of this computer, the one of a known USB device, and what else of the hardware side is present."""

from __future__ import annotations

import importlib.metadata
import os
import shutil
from dataclasses import dataclass

from serial.tools import list_ports as tools

from avc_casadi import PortError
from avc_hardware.codegen.firmware import ARM_INSTALL, image_sha256


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


@dataclass(frozen=True)
class Diagnosis:
    """Facts and advice.

    Attributes:
        emulator: version of Unicorn, or None: then ``--port emulator`` is not available.
        image_sha256: of the packaged firmware image.
        c_compiler: path of gcc, clang or cc, or None.
        arm_compiler: path of the cross compiler, or None.
        ports: serial ports.
        advice: what to install or change; empty when all is there.
    """

    emulator: str | None
    image_sha256: str
    c_compiler: str | None
    arm_compiler: str | None
    ports: tuple[Port, ...]
    advice: tuple[str, ...]


def diagnose() -> Diagnosis:
    """Look, without opening a port."""
    try:
        emulator: str | None = importlib.metadata.version("unicorn")
    except importlib.metadata.PackageNotFoundError:
        emulator = None
    arm = shutil.which("arm-none-eabi-gcc")
    ports = list_ports()
    advice = []
    if emulator is None:
        advice.append("no emulated device: pip install 'avc-casadi[emulator]'")
    if arm is None:
        advice.append(f"no cross compiler (needed only to change the firmware): {ARM_INSTALL}")
    advice += [
        f"{port.device} may not be opened by this user (on Debian: sudo usermod -aG dialout $USER, then log in again)"
        for port in ports
        if not port.accessible
    ]
    return Diagnosis(
        emulator=emulator,
        image_sha256=image_sha256(),
        c_compiler=next((path for name in ("gcc", "clang", "cc") if (path := shutil.which(name))), None),
        arm_compiler=arm,
        ports=ports,
        advice=tuple(advice),
    )
