"""Where the firmware's sources and its prebuilt image are, and what they are called."""

from __future__ import annotations

import hashlib
from pathlib import Path

FIRMWARE = Path(__file__).resolve().parent / "firmware"
# The control tick, written from the scene's CasADi expressions by `firmware_build generate`.
GENERATED = FIRMWARE / "core" / "generated"
IMAGE = FIRMWARE / "image" / "netduinoplus2.elf"
ARM_INSTALL = "apt-get install -y --no-install-recommends gcc-arm-none-eabi"


def source_hash(folder: Path = FIRMWARE, *further: bytes) -> str:
    """Return the first 8 hexadecimal digits of the SHA-256 over all firmware sources: the build's name in HELLO."""
    digest = hashlib.sha256(b"".join(further))
    parts = [*(folder / "core").rglob("*"), *(folder / "boards").rglob("*")]
    for path in sorted(path for path in parts if path.suffix in {".c", ".h", ".ld"}):
        digest.update(path.relative_to(folder).as_posix().encode())
        digest.update(path.read_bytes().replace(b"\r\n", b"\n"))
    return digest.hexdigest()[:8]


def image_sha256() -> str:
    """SHA-256 of the packaged image."""
    return hashlib.sha256(IMAGE.read_bytes()).hexdigest()
