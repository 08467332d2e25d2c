"""Settings of a device beside its coupling: faults cleared, limits at run time.

Limits of force, speed and energy are lowered below those of the board, never above them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from avc_casadi import Fault, InputError
from avc_casadi._util.units import M_PER_S, NEWTON
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
    """Result of clearing faults.

    Attributes:
        port: as given.
        were: faults before it.
        left: persisting faults.
        first: faults that were latched first.
        tick: of these.
        status: of the device afterwards.
    """

    port: str
    were: DeviceFault
    left: DeviceFault
    first: DeviceFault
    tick: int
    status: DeviceStatus


def clear_faults(
    port: str | ByteLink, *, baud: int = DEFAULT_BAUD, on_silence: Callable[[str], None] | None = None
) -> Cleared:
    """Clear the reported faults of a device, not those that occur meanwhile.

    Its table then takes over out of contact, as after a lost heartbeat. Persisting faults are latched again.

    Args:
        port: device path, pyserial URL, ``usb:NUMBER``, ``emulator``, or an open link.
        baud: rate of a serial port.
        on_silence: called once with the awaited answer and the time, where the device does not answer at once.

    Raises:
        LinkError: no device, or no answer.
    """
    link = open_link(port, baud=baud)
    with Connection(link, baud=baud, on_silence=on_silence) as connection:
        ask = connection.session.ask
        before = connection.run(ask(Kind.STATUS, b"", DeviceStatus))
        connection.run(ask(Kind.CLEAR, m.clear(before.faults), m.ClearAsked))
        connection.run(pause(_TICKS_UNTIL_LATCHED * connection.device.sample_time_s))
        after = connection.run(ask(Kind.STATUS, b"", DeviceStatus))
    were, left, first = (DeviceFault(codes) for codes in (before.faults, after.faults, before.first_faults))
    return Cleared(link.name, were, left, first, before.fault_tick, after)


_UNITS = {"force_n": NEWTON, "speed_m_per_s": M_PER_S, "energy_j": "J"}
# Ticks until immediate limits hold.
_TICKS = 5


@dataclass(frozen=True)
class Limits:
    """Limits at run time.

    Attributes:
        force_n: of the output, N.
        speed_m_per_s: above it a fault is latched; 0: not monitored.
        energy_j: largest net energy that a coupling may deliver within about a second; 0: not monitored.
    """

    force_n: float
    speed_m_per_s: float
    energy_j: float


@dataclass(frozen=True)
class DeviceLimits:
    """The limits of a device.

    Attributes:
        port: as given.
        boards: built in; no limit rises above them.
        asked: as requested, or the present ones where nothing was.
        hold: present ones.
        waits: whether a higher force waits for the device to be released.
    """

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
    """Set limits of a device until it starts anew, or read them.

    A lower force holds from the next tick on; a higher one from the next time out of contact, so that it never steps in
    contact.

    Args:
        port: device path, pyserial URL, ``usb:NUMBER``, ``emulator``, or an open link.
        force_n: of the output; None keeps the present one, here and below.
        speed_m_per_s: above it a fault is latched.
        energy_j: net energy delivered within about a second.
        built_in: start from the board's limits in place of the present ones.
        baud: rate of a serial port.
        on_silence: called once with the awaited answer and the time, where the device does not answer at once.

    Raises:
        InputError: an invalid limit, or one above the board's.
        LinkError: no device, or no answer.
    """
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
    payload = m.limits(limits.force_n, limits.speed_m_per_s, limits.energy_j)
    connection.run(connection.session.ask(Kind.LIMITS, payload, m.LimitsTaken))
    connection.run(pause(_TICKS * connection.device.sample_time_s))


def _boards(device: Device) -> Limits:
    return Limits(device.max_force_n, device.max_speed_m_per_s, device.max_energy_j)


def _wanted(device: Device, wanted: tuple[float | None, ...], *, built_in: bool) -> Limits:
    boards = vars(_boards(device))
    now = (device.lowered_force_n, device.lowered_speed_m_per_s, device.lowered_energy_j)
    values, faults = [], []
    for (name, most), value, before in zip(boards.items(), wanted, now, strict=True):
        values.append((most if built_in else before) if value is None else value)
        if value is not None and not (math.isfinite(value) and 0 < value <= (most or math.inf)):
            allowed = f"above 0, at most the board's {most:g} {_UNITS[name]}" if most else "above 0"
            faults.append(Fault("", None, name, f"is {value:g}; allowed: {allowed}"))
    if faults:
        raise InputError(faults)
    return Limits(*values)
