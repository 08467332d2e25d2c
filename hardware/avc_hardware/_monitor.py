"""Monitor: the device's state again and again."""

from __future__ import annotations

import math
import time
from collections.abc import Generator, Iterator

from avc_casadi import LinkError
from avc_hardware._bytes import ByteLink
from avc_hardware._connection import DEFAULT_BAUD, Connection, open_link
from avc_hardware._device import DeviceStatus
from avc_hardware._emulator import EmulatedBoard
from avc_hardware._messages import Kind
from avc_hardware._session import Answer, Exchange

# How often to look whether an unplugged device is back.
_LOOK_AGAIN_S = 0.2


def monitor(
    port: str | ByteLink,
    *,
    rate_hz: float = 20.0,
    seconds: float | None = None,
    baud: int = DEFAULT_BAUD,
    reconnect_s: float = 0.0,
) -> Iterator[DeviceStatus]:
    """Yield the device's state at a rate, until ``seconds`` are over or the caller stops.

    Args:
        port: device path, pyserial URL, ``usb:NUMBER``, ``emulator``, or an open link.
        rate_hz: samples a second by the link's clock; a slow link gives fewer.
        seconds: duration; without it for ever.
        baud: rate of a serial port.
        reconnect_s: how long to wait for a device that was unplugged; with ``usb:NUMBER`` it may come back elsewhere.

    Raises:
        LinkError: no device, or unplugged for longer.
    """
    left = math.inf if seconds is None else math.floor(seconds * rate_hz) + 1
    give_up: float | None = None
    while left > 0:
        try:
            link = open_link(port, baud=baud) if isinstance(port, str) else port
            with Connection(link, baud=baud) as connection:
                start = link.now_s()
                count = 0
                while left > 0:
                    status = connection.run(connection.session.ask(Kind.STATUS, b"", DeviceStatus))
                    give_up = None
                    count += 1
                    left -= 1
                    yield status
                    connection.run(pause(start + count / rate_hz - link.now_s()))
                    if seconds is None and isinstance(link, EmulatedBoard):
                        time.sleep(1 / rate_hz)  # virtual time would rush past whoever watches
        except LinkError:
            now = time.monotonic()
            give_up = now + reconnect_s if give_up is None else give_up
            if not isinstance(port, str) or now >= give_up:
                raise
            time.sleep(_LOOK_AGAIN_S)


def pause(seconds: float) -> Generator[Exchange, Answer, None]:
    """Let time pass, whatever arrives."""
    if seconds > 0:
        yield Exchange(b"", seconds)
