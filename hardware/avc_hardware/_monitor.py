"""Monitor: the device's state again and again."""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator

from avc_hardware._bytes import ByteLink
from avc_hardware._connection import DEFAULT_BAUD, Connection, open_link
from avc_hardware._messages import DeviceStatus, Kind
from avc_hardware._session import Answer, Exchange


def monitor(
    port: str | ByteLink,
    *,
    rate_hz: float = 20.0,
    seconds: float | None = None,
    baud: int = DEFAULT_BAUD,
) -> Iterator[DeviceStatus]:
    """Yield the device's state at a rate, until ``seconds`` are over or the caller stops.

    Args:
        port: device path, pyserial URL, ``emulator``, or an open link.
        rate_hz: samples a second by the link's clock; a slow link gives fewer.
        seconds: duration; without it for ever.
        baud: rate of a serial port.

    Raises:
        LinkError: no device, or unplugged.
    """
    link = open_link(port, baud=baud) if isinstance(port, str) else port
    with Connection(link, baud=baud) as connection:
        start = link.now_s()
        count = 0
        while seconds is None or count <= math.floor(seconds * rate_hz):
            yield connection.run(connection.session.ask(Kind.STATUS, b"", DeviceStatus))
            count += 1
            connection.run(pause(start + count / rate_hz - link.now_s()))


def pause(seconds: float) -> Generator[Exchange, Answer, None]:
    """Let time pass, whatever arrives."""
    if seconds > 0:
        yield Exchange(b"", seconds)
