"""Settings of a device beside its coupling: faults cleared, limits at run time."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass

from avc_casadi import Fault, InputError
from avc_hardware.link import messages as m
from avc_hardware.link.bytes import ByteLink
from avc_hardware.link.connection import DEFAULT_BAUD, Connection, open_link
from avc_hardware.link.device import Device, DeviceStatus
from avc_hardware.link.faults import DeviceFault
from avc_hardware.link.messages import Kind
from avc_hardware.link.monitor import pause

# Ticks until a persisting fault shows again after clearing.
_TICKS_UNTIL_LATCHED = 5


@dataclass(frozen=True)
class Cleared:
    """Result of clearing faults."""

    port: str
    were: DeviceFault
    left: DeviceFault
    first: DeviceFault
    tick: int
    status: DeviceStatus


def clear_faults(
    port: str | ByteLink, *, baud: int = DEFAULT_BAUD, on_silence: Callable[[str], None] | None = None
) -> Cleared:
    """Clear the reported faults of a device, not those that occur meanwhile."""
    link = open_link(port, baud=baud)
    with Connection(link, baud=baud, on_silence=on_silence) as connection:
        ask = connection.session.ask
        before = connection.run(ask(Kind.STATUS, b"", DeviceStatus))
        connection.run(ask(Kind.CLEAR, m.words(before.faults), m.Acknowledged))
        connection.run(pause(_TICKS_UNTIL_LATCHED * connection.device.sample_time_s))
        after = connection.run(ask(Kind.STATUS, b"", DeviceStatus))
    were, left, first = (DeviceFault(codes) for codes in (before.faults, after.faults, before.first_faults))
    return Cleared(link.name, were, left, first, before.fault_tick, after)


# Ticks until immediate limits hold.
_TICKS = 5


@dataclass(frozen=True)
class Limits:
    """Limits at run time."""

    force_n: float
    speed_m_per_s: float
    energy_j: float


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
    built_in: bool = False,
    baud: int = DEFAULT_BAUD,
    on_silence: Callable[[str], None] | None = None,
) -> DeviceLimits:
    """Set limits of a device until it starts anew, or read them."""
    link = open_link(port, baud=baud)
    with Connection(link, baud=baud, on_silence=on_silence) as connection:
        device = connection.device
        wanted = (force_n, speed_m_per_s, energy_j)
        if built_in or any(value is not None for value in wanted):
            limit_over(connection, _wanted(device, wanted, built_in=built_in))
        status = connection.run(connection.session.ask(Kind.STATUS, b"", DeviceStatus))
    hold = Limits(status.lowered_force_n, status.lowered_speed_m_per_s, status.lowered_energy_j)
    asked = _wanted(device, wanted, built_in=built_in)
    return DeviceLimits(link.name, _boards(device), asked, hold, status.limits_wait)


def limit_over(connection: Connection, limits: Limits) -> None:
    """Set limits over an open connection, and wait until the immediate ones hold."""
    payload = struct.pack("<3f", limits.force_n, limits.speed_m_per_s, limits.energy_j)
    connection.run(connection.session.ask(Kind.LIMITS, payload, m.Acknowledged))
    connection.run(pause(_TICKS * connection.device.sample_time_s))


def _boards(device: Device) -> Limits:
    limits = device.limits
    return Limits(limits.max_force_n, limits.max_speed_m_per_s, limits.max_energy_j)


def _wanted(device: Device, wanted: tuple[float | None, ...], *, built_in: bool) -> Limits:
    boards = vars(_boards(device))
    now = (device.lowered_force_n, device.lowered_speed_m_per_s, device.lowered_energy_j)
    values, faults = [], []
    for (name, most), value, before in zip(boards.items(), wanted, now, strict=True):
        values.append((most if built_in else before) if value is None else value)
        if value is not None and not (math.isfinite(value) and 0 < value <= (most or math.inf)):
            allowed = f"above 0, at most the board's {most:g}" if most else "above 0"
            faults.append(Fault("", None, name, f"is {value:g}; allowed: {allowed}"))
    if faults:
        raise InputError(faults)
    return Limits(*values)
