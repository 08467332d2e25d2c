"""Byte streams: the interface of a link to the layers above, and the serial port as one."""

from __future__ import annotations

import errno
import re
import time
from typing import Protocol, runtime_checkable

import serial

from avc_casadi import LinkError, PortError


@runtime_checkable
class ByteLink(Protocol):
    """A two-way byte stream with its own clock; virtual for the emulator."""

    @property
    def name(self) -> str:
        """Its name as a port."""

    def now_s(self) -> float:
        """Time on the link's clock, seconds."""

    def write(self, data: bytes) -> None:
        """Send all bytes, or raise `LinkError`."""

    def read(self, timeout_s: float) -> bytes:
        """Return the bytes that have arrived, waiting at most ``timeout_s`` for the first; empty when nothing came."""

    def close(self) -> None:
        """Close the link; harmless when repeated."""


class SerialLink:
    """A serial port through pyserial, exclusive to this process."""

    def __init__(self, port: str, baud: int) -> None:
        """Open ``port`` (a device path or a pyserial URL) at ``baud`` bits a second."""
        self._name = port
        try:
            self._port = serial.serial_for_url(
                port,
                baudrate=baud,
                timeout=0,
                # A device that takes no bytes for so long is gone.
                write_timeout=2.0,
                exclusive=True,
                do_not_open=True,
            )
            # Some USB devices send only with DTR set; others are reset by that, and HELLO is repeated.
            self._port.dtr, self._port.rts = True, False
            self._port.open()
            self._port.reset_input_buffer()
        except (OSError, ValueError, KeyError, re.error) as error:
            raise PortError(f"{port}: cannot be opened ({_reason(error)}); {_advice(error)}") from error

    @property
    def name(self) -> str:
        """Path of the port."""
        return self._name

    def now_s(self) -> float:
        """Monotonic clock of this computer."""
        return time.monotonic()

    def write(self, data: bytes) -> None:
        """Send all bytes, or raise `LinkError`."""
        try:
            self._port.write(data)
        except OSError as error:
            raise LinkError(
                f"{self._name}: sending failed ({_reason(error)}); is the device still plugged in?"
            ) from error

    def read(self, timeout_s: float) -> bytes:
        """Return the bytes that have arrived, waiting at most ``timeout_s`` for the first."""
        try:
            self._port.timeout = max(timeout_s, 0.0)
            first = self._port.read(1)
            return bytes(first + self._port.read(self._port.in_waiting)) if first else b""
        except OSError as error:  # pyserial's own SerialException is one; in_waiting raises a bare OSError
            raise LinkError(
                f"{self._name}: receiving failed ({_reason(error)}); is the device still plugged in?"
            ) from error

    def close(self) -> None:
        """Close the port."""
        self._port.close()


def _reason(error: Exception) -> str:
    return f"{getattr(error, 'strerror', None) or error}"


def _advice(error: Exception) -> str:
    """Return what to do about a port that cannot be opened, by the error of the system."""
    number = getattr(error, "errno", None)
    if number == errno.EACCES:
        return "add yourself to the group that owns it (on Debian: sudo usermod -aG dialout $USER, then log in again)"
    if number in {errno.EAGAIN, errno.EBUSY}:
        return "another program has it open; close that program first"
    return (
        "allowed: a path, a URL of pyserial such as socket://HOST:PORT, or 'emulator', which needs no hardware; "
        "`avc doctor --ports` lists the ports of this computer"
    )
