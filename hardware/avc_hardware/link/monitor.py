"""Monitor: telemetry of the device, and the heartbeat of the watching host."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import suppress

from avc_casadi import InputError, LinkError
from avc_casadi._util.interrupt import DeferredInterrupt
from avc_hardware.emulator.board import EmulatedBoard
from avc_hardware.link.bytes import ByteLink
from avc_hardware.link.connection import DEFAULT_BAUD, Connection, open_link
from avc_hardware.link.device import Device, DeviceStatus
from avc_hardware.link.messages import Acknowledged, Kind, words
from avc_hardware.link.settings import FORCE_FALLS_S
from avc_hardware.link.telemetry import TelemetrySample

LONGEST_HEARTBEAT_S = 5.0
"""Longest time from one heartbeat to the next that a device allows."""
RATE_HZ = 20.0
"""Usual rate of records."""
_HOLDS_S = 2.0
"""Time for which a subscription holds without renewal."""
_RENEW_S = 0.5
"""Time after which it is renewed."""
_BEATS = 3
"""Heartbeats that are sent in the time in which one is necessary."""
_BEAT_BYTES = 1 + 4 + 8 + 12 + 3 * 10
"""A heartbeat, its answer and the head of a message of telemetry.

A delimiter first, then their contents, ten bytes of frame and COBS each."""
_RECORD_BYTES = 44
"""A record of that message."""
_MOST_RECORDS = 8
"""The most records of it."""
_ROUNDING = 1e-9
"""Share by which a time may fall short of a whole number of records by rounding."""


def monitor(
    port: str | ByteLink,
    *,
    rate_hz: float = RATE_HZ,
    seconds: float | None = None,
    heartbeat_s: float | None = None,
    baud: int = DEFAULT_BAUD,
    on_device: Callable[[Device], None] | None = None,
    on_end: Callable[[DeviceStatus], None] | None = None,
) -> Generator[TelemetrySample, None, None]:
    """Yield telemetry, a record every so many ticks, until ``seconds`` are over or the caller stops."""
    if heartbeat_s is not None and not 0 < heartbeat_s <= LONGEST_HEARTBEAT_S:
        message = f"{heartbeat_s:g} s; allowed: above 0, at most {LONGEST_HEARTBEAT_S:g} s"
        raise InputError.of(message, key="heartbeat_s")
    with Connection(open_link(port, baud=baud), baud=baud) as connection:
        device = connection.device
        if heartbeat_s is not None:
            _check_heartbeat(heartbeat_s, rate_hz, device, baud)
        if on_device is not None:
            on_device(device)
        between_s = _every(device, rate_hz) * device.sample_time_s
        left = math.inf if seconds is None else math.floor(seconds / between_s * (1 + _ROUNDING)) + 1
        try:
            for sample in watch(connection, rate_hz, heartbeat_s, paced=seconds is None):
                left -= 1 + sample.lost
                yield sample
                if left <= 0:
                    break
        except LinkError:
            raise
        except BaseException:
            with DeferredInterrupt():
                _end(connection, heartbeat_s, on_end)
            raise
        _end(connection, heartbeat_s, on_end)


def watch(
    connection: Connection, rate_hz: float, heartbeat_s: float | None = None, *, paced: bool = False
) -> Iterator[TelemetrySample]:
    """Maintain subscription and heartbeat over an open connection; yield for ever."""
    link, device = connection.link, connection.device
    ticks_between = _every(device, rate_hz)
    subscribe = words(ticks_between, math.ceil(_HOLDS_S / device.sample_time_s))
    last: tuple[int, int] | None = None  # boot number and tick of the last record
    beat_at = math.inf if heartbeat_s is None else -math.inf
    renew_at = -math.inf
    start = time.monotonic() - link.now_s()
    while True:
        if heartbeat_s is not None and link.now_s() >= beat_at:
            beat_at = link.now_s() + heartbeat_s / _BEATS
            connection.heartbeat(heartbeat_s)
        if link.now_s() >= renew_at:
            renew_at = link.now_s() + _RENEW_S
            connection.ask(Kind.SUBSCRIBE, subscribe, Acknowledged)
        message = connection.telemetry(min(beat_at, renew_at) - link.now_s())
        if message is None:
            continue
        if paced and isinstance(link, EmulatedBoard):
            time.sleep(max(0.0, start + link.now_s() - time.monotonic()))  # virtual time would rush past the watcher
        for record in message.records:
            ticks, count = record[:2]
            lost = 0
            if last is not None and last[0] == message.boot_id:
                # Counted in 32 bits; the first record after an expired subscription may come sooner.
                lost = max(((ticks - last[1]) & 0xFFFFFFFF) // message.ticks_between - 1, 0)
            last = (message.boot_id, ticks)
            time_s = ticks * device.sample_time_s
            position_m = count * device.limits.metres_per_count
            yield TelemetrySample(*[*record, time_s, position_m, message.coupling_id, message.boot_id, lost])


def _check_heartbeat(heartbeat_s: float, rate_hz: float, device: Device, baud: int) -> None:
    """Refuse a heartbeat too fast for this line: a request may intervene, with its answer after a message."""
    byte_s = 10 / baud
    records = 1
    while records < _MOST_RECORDS and records < rate_hz * (_BEAT_BYTES + records * _RECORD_BYTES) * byte_s:
        records += 1  # so many are made while this is on the wire
    least_s = _BEATS * max(device.sample_time_s, (_BEAT_BYTES + records * _RECORD_BYTES) * byte_s)
    if heartbeat_s < least_s:
        message = (
            f"{heartbeat_s:g} s; allowed: {math.ceil(1e3 * least_s) / 1e3:g} to {LONGEST_HEARTBEAT_S:g} s: "
            f"{_BEATS} heartbeats are sent in that time, and one takes up to {1e3 * least_s / _BEATS:.3g} ms next to "
            f"records at {rate_hz:g} Hz ({baud} baud, ticks of {1e3 * device.sample_time_s:g} ms)"
        )
        raise InputError.of(message, key="heartbeat_s")


def _every(device: Device, rate_hz: float) -> int:
    """Return the ticks from one record to the next, at least 1."""
    return max(1, round(1 / (rate_hz * device.sample_time_s)))


def _end(connection: Connection, heartbeat_s: float | None, on_end: Callable[[DeviceStatus], None] | None) -> None:
    """End subscription and heartbeat; a lost device needs neither."""
    with suppress(LinkError):
        connection.ask(Kind.SUBSCRIBE, words(0, 0), Acknowledged)
        if heartbeat_s is not None:
            connection.ask(Kind.HEARTBEAT, words(1), Acknowledged)
            connection.wait(FORCE_FALLS_S + 3 * connection.device.sample_time_s)  # in which the force falls to 0
        if on_end is not None:
            on_end(connection.status())
