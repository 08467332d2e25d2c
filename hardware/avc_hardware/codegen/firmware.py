"""Paths of the firmware's sources and its prebuilt image."""

from __future__ import annotations

import hashlib
from pathlib import Path

FIRMWARE = Path(__file__).resolve().parent.parent / "firmware"
IMAGE = FIRMWARE / "image" / "netduinoplus2.elf"
ARM_INSTALL = "apt-get install -y --no-install-recommends gcc-arm-none-eabi"


def image_sha256() -> str:
    """SHA-256 of the packaged image."""
    return hashlib.sha256(IMAGE.read_bytes()).hexdigest()
