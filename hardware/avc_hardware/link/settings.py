"""Settings of a device beside its coupling: faults cleared, limits at run time."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass

from avc_casadi import Fault, InputError
from avc_hardware.link.bytes import ByteLink
from avc_hardware.link.connection import DEFAULT_BAUD, Connection, open_link
from avc_hardware.link.device import DeviceStatus, Limits
from avc_hardware.link.faults import DeviceFault
from avc_hardware.link.messages import Acknowledged, Kind, words

_TICKS = 5
"""Ticks until what was set acts: a limit that holds at once, a persisting fault that is latched again."""
FORCE_FALLS_S = 0.1
"""Time in which a force that falls after the last heartbeat is 0."""


@dataclass(frozen=True)
class Cleared:
    """Result of clearing faults."""

    port: str
    were: DeviceFault
    left: DeviceFault
    first: DeviceFault
    tick: int
    status: DeviceStatus


def clear_faults(port: str | ByteLink, *, baud: int = DEFAULT_BAUD) -> Cleared:
    """Clear the reported faults of a device, not those that occur meanwhile; a silent host is no longer waited for."""
    link = open_link(port, baud=baud)
    with Connection(link, baud=baud) as connection:
        before = connection.status()
        connection.ask(Kind.CLEAR, words(before.faults), Acknowledged)
        if before.faults & DeviceFault.HEARTBEAT:
            connection.heartbeat(0.0)  # none is asked for any longer
        connection.wait(FORCE_FALLS_S + _TICKS * connection.device.sample_time_s)
        after = connection.status()
    return Cleared(
        port=link.name,
        were=DeviceFault(before.faults),
        left=DeviceFault(after.faults),
        first=DeviceFault(before.first_faults),
        tick=before.fault_tick,
        status=after,
    )


@dataclass(frozen=True)
class DeviceLimits:
    """The limits of a device."""

    port: str
    boards: Limits
    asked: Limits
    hold: Limits
    waits: bool


def set_limits(
    port: str | ByteLink,
    *,
    force_n: float | None = None,
    speed_m_per_s: float | None = None,
    energy_j: float | None = None,
    baud: int = DEFAULT_BAUD,
) -> DeviceLimits:
    """Set limits of a device until it starts anew, or read them."""
    link = open_link(port, baud=baud)
    with Connection(link, baud=baud) as connection:
        limits = connection.device.limits
        boards = Limits(limits.max_force_n, limits.max_speed_m_per_s, limits.max_energy_j)
        wanted = {"force_n": force_n, "speed_m_per_s": speed_m_per_s, "energy_j": energy_j}
        asked = _wanted(boards, connection.status().lowered, wanted)
        if any(value is not None for value in wanted.values()):
            payload = struct.pack("<3f", asked.force_n, asked.speed_m_per_s, asked.energy_j)
            connection.ask(Kind.LIMITS, payload, Acknowledged)
            connection.wait(_TICKS * connection.device.sample_time_s)
        status = connection.status()
    return DeviceLimits(link.name, boards, asked, status.lowered, status.limits_wait)


def _wanted(boards: Limits, now: Limits, wanted: dict[str, float | None]) -> Limits:
    """Return the limits that are asked for: those of now, with the wanted ones in their place."""
    values: dict[str, float] = {}
    faults = []
    for name, value in wanted.items():
        most: float = getattr(boards, name)
        values[name] = getattr(now, name) if value is None else value
        if value is not None and not (math.isfinite(value) and 0 < value <= (most or math.inf)):
            allowed = f"above 0, at most the board's {most:g}" if most else "above 0"
            faults.append(Fault("", None, name, f"is {value:g}; allowed: {allowed}"))
    if faults:
        raise InputError(faults)
    return Limits(**values)
