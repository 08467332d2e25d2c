"""Limits at run time: force, speed and energy lowered below those of the board, never above them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from avc_casadi import Fault, InputError
from avc_hardware import _messages as m
from avc_hardware._connection import DEFAULT_BAUD, Connection, open_link
from avc_hardware._device import Device, DeviceStatus
from avc_hardware._messages import Kind
from avc_hardware._monitor import pause

if TYPE_CHECKING:
    from collections.abc import Callable

    from avc_hardware._bytes import ByteLink

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
