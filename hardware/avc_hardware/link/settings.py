"""Settings of a device beside its coupling: faults cleared, limits at run time, non-volatile storage.

Limits of force, speed and energy are lowered below those of the board, never above them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from avc_casadi import Fault, InputError, LinkError
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


NAME_BYTES = 16
"""Longest name of a device, UTF-8."""
# Erasing a sector of 128 KB may take four seconds, in which no byte is received.
_ERASES_S = 5.0


@dataclass(frozen=True)
class Stored:
    """Content of a device's non-volatile storage.

    Attributes:
        port: as given.
        number: how often something was stored.
        coupling_id: of the stored coupling; empty without one.
        acts: whether it takes over after a reset, out of contact.
        name: of the device; empty without one.
        force_n: stored limit at run time.
    """

    port: str
    number: int
    coupling_id: str
    acts: bool
    name: str
    force_n: float


def store(
    port: str | ByteLink,
    *,
    coupling: bool = True,
    acts: bool = False,
    name: str | None = None,
    baud: int = DEFAULT_BAUD,
    on_silence: Callable[[str], None] | None = None,
) -> Stored:
    """Store a device's running coupling, its limits and a name over a reset.

    It gives no force meanwhile, and resumes its coupling out of contact. After a power cut, the old or the new content
    is whole.

    Args:
        port: device path, pyserial URL, ``usb:NUMBER``, or an open link.
        coupling: whether to store the running coupling; else none is.
        acts: whether it takes over after a reset, as soon as the device is out of contact. With an incremental encoder
            the wall is relative to the position then, until position 0 is set.
        name: of the device; None keeps the one it has.
        baud: rate of a serial port.
        on_silence: called once with the awaited answer and the time, where the device does not answer at once.

    Raises:
        InputError: a name that is too long, or a coupling that acts and is not stored.
        LinkError: no device, one without such a memory, without a coupling, or in contact.
    """
    if acts and not coupling:
        raise InputError.of("a coupling acts after a reset that is kept; leave out one of the two", key="acts")
    if name is not None and not name.isprintable():
        raise InputError.of(f"is {name!r}; allowed: characters that print, in a line", key="name")
    if name is not None and len(name.encode()) > NAME_BYTES:
        raise InputError.of(f"{name!r} takes {len(name.encode())} bytes; allowed: {NAME_BYTES}", key="name")
    link = open_link(port, baud=baud)
    with Connection(link, baud=baud, on_silence=on_silence) as connection:
        session, before = connection.session, connection.device
        if not before.flash_bytes:
            raise LinkError(f"{link.name}: this board has no memory that lasts (hal_flash_size); push after each start")
        session.timeout_s = max(session.timeout_s, _ERASES_S)
        flags = m.KEEPS_COUPLING * coupling + m.COUPLING_ACTS * acts
        payload = m.store(flags, before.name if name is None else name)
        connection.run(session.ask(Kind.STORE, payload, m.StoreTaken), deadline_s=6 * _ERASES_S)
        return stored_of(connection.run(session.hello()), link.name)


def stored_of(device: Device, port: str) -> Stored:
    """Return the content of the storage as the device reports it."""
    return Stored(
        port, device.kept_number, device.kept_coupling_id, device.kept_acts, device.name, device.lowered_force_n
    )
