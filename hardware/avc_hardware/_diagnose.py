"""Diagnose: what of the hardware side is present on this computer."""

from __future__ import annotations

import importlib.metadata
import shutil
from dataclasses import dataclass

from avc_hardware._firmware import ARM_INSTALL, IMAGE, image_sha256, source_hash
from avc_hardware._ports import Port, list_ports


@dataclass(frozen=True)
class Diagnosis:
    """Facts and advice.

    Attributes:
        emulator: version of Unicorn, or None: then ``--port emulator`` is not available.
        image_sha256: of the packaged firmware image.
        image_current: whether the image was built from the C sources beside it.
        c_compiler: path of gcc, clang or cc, or None.
        arm_compiler: path of the cross compiler, or None.
        ports: serial ports.
        advice: what to install or change; empty when all is there.
    """

    emulator: str | None
    image_sha256: str
    image_current: bool
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
    current = source_hash().encode() in IMAGE.read_bytes()
    arm = shutil.which("arm-none-eabi-gcc")
    ports = list_ports()
    advice = []
    if emulator is None:
        advice.append("no emulated device: pip install 'avc-casadi[emulator]'")
    if not current:
        advice.append("the firmware image is older than its sources: python -m avc_hardware.firmware_build")
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
        image_current=current,
        c_compiler=next((path for name in ("gcc", "clang", "cc") if (path := shutil.which(name))), None),
        arm_compiler=arm,
        ports=ports,
        advice=tuple(advice),
    )
