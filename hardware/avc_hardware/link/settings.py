"""What a host changes on a device beside its coupling: faults cleared, limits at run time, what it keeps over a reset.

Limits of force, speed and energy are lowered below those of the board, never above them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from avc_casadi import Fault, InputError, LinkError
from avc_hardware.link import messages as m
from avc_hardware.link.bytes import ByteLink
from avc_hardware.link.connection import DEFAULT_BAUD, Connection, open_link
from avc_hardware.link.device import Device, DeviceStatus
from avc_hardware.link.faults import DeviceFault
from avc_hardware.link.messages import Kind
from avc_hardware.link.monitor import pause

# Ticks until what has been cleared and is still wrong shows again.
_TICKS_UNTIL_LATCHED = 5


@dataclass(frozen=True)
class Cleared:
    """What clearing came to.

    Attributes:
        port: as the user named it.
        were: faults before it.
        left: faults after it, which are still there.
        first: the ones that were latched first.
        tick: when that was.
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
    """Clear the faults of a device: those that it tells, and none that come meanwhile.

    Its table then takes over out of contact, as after a lost heartbeat. What is still wrong is latched again.

    Args:
        port: device path, pyserial URL, ``usb:NUMBER``, ``emulator``, or an open link.
        baud: rate of a serial port.
        on_silence: told once what is waited for, and how long, where the device does not answer at once.

    Raises:
        LinkError: no device, or no answer.
    """
    link = open_link(port, baud=baud) if isinstance(port, str) else port
    with Connection(link, baud=baud, on_silence=on_silence) as connection:
        ask = connection.session.ask
        before = connection.run(ask(Kind.STATUS, b"", DeviceStatus))
        connection.run(ask(Kind.CLEAR, m.clear(before.faults), m.ClearAsked))
        connection.run(pause(_TICKS_UNTIL_LATCHED * connection.device.sample_time_s))
        after = connection.run(ask(Kind.STATUS, b"", DeviceStatus))
    were, left, first = (DeviceFault(codes) for codes in (before.faults, after.faults, before.first_faults))
    return Cleared(link.name, were, left, first, before.fault_tick, after)


_UNITS = {"force_n": "N", "speed_m_per_s": "m/s", "energy_j": "J"}
# Ticks until limits hold that need not wait.
_TICKS = 5


@dataclass(frozen=True)
class Limits:
    """Limits at run time.

    Attributes:
        force_n: of the output, N.
        speed_m_per_s: beyond it a fault is latched; 0: not watched.
        energy_j: that a coupling may give out within about a second without having got it; 0: not watched.
    """

    force_n: float
    speed_m_per_s: float
    energy_j: float


@dataclass(frozen=True)
class DeviceLimits:
    """The limits of a device.

    Attributes:
        port: as the user named it.
        boards: built in; no limit rises above them.
        asked: what was asked for, or what holds where nothing was.
        hold: what holds now.
        waits: whether a higher force waits for the device to be let go.
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

    A lower force holds from the next tick on; a higher one from the next time out of contact, so that it is never felt
    as a kick.

    Args:
        port: device path, pyserial URL, ``usb:NUMBER``, ``emulator``, or an open link.
        force_n: of the output; None leaves it, here and in what follows.
        speed_m_per_s: beyond it a fault is latched.
        energy_j: given out within about a second without having been taken in.
        built_in: begin from those of the board in place of those that hold.
        baud: rate of a serial port.
        on_silence: told once what is waited for, and how long, where the device does not answer at once.

    Raises:
        InputError: a limit that is none, or above the board's.
        LinkError: no device, or no answer.
    """
    link = open_link(port, baud=baud) if isinstance(port, str) else port
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
    """Set limits over an open connection, and wait until those hold that need not wait."""
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
# A sector of 128 KB may take four seconds to erase, in which no byte is heard.
_ERASES_S = 5.0


@dataclass(frozen=True)
class Stored:
    """What a device keeps.

    Attributes:
        port: as the user named it.
        number: how often it was stored.
        coupling_id: of the coupling that is kept; empty without one.
        acts: whether that takes over after a reset, out of contact.
        name: of the device; empty without one.
        force_n: limit at run time that is kept.
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
    """Have a device keep its running coupling, its limits and a name over a reset.

    It gives no force meanwhile, and takes its coupling up again out of contact. Where the power is cut, what was kept
    before or this is whole.

    Args:
        port: device path, pyserial URL, ``usb:NUMBER``, or an open link.
        coupling: whether the running coupling is kept; without it none is.
        acts: whether it takes over after a reset, as soon as the device is out of contact. An encoder that counts from
            where it stood then has its wall there, until position 0 is set.
        name: of the device; None keeps the one it has.
        baud: rate of a serial port.
        on_silence: told once what is waited for, and how long, where the device does not answer at once.

    Raises:
        InputError: a name that is too long, or a coupling that acts and is not kept.
        LinkError: no device, one without such a memory, without a coupling, or in contact.
    """
    if acts and not coupling:
        raise InputError.of("a coupling acts after a reset that is kept; leave out one of the two", key="acts")
    if name is not None and not name.isprintable():
        raise InputError.of(f"is {name!r}; allowed: characters that print, in a line", key="name")
    if name is not None and len(name.encode()) > NAME_BYTES:
        raise InputError.of(f"{name!r} takes {len(name.encode())} bytes; allowed: {NAME_BYTES}", key="name")
    link = open_link(port, baud=baud) if isinstance(port, str) else port
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
    """Return what a device says that it keeps."""
    return Stored(
        port, device.kept_number, device.kept_coupling_id, device.kept_acts, device.name, device.lowered_force_n
    )
