"""Clear: the faults that a device has latched, after whoever asks has seen them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from avc_hardware import _messages as m
from avc_hardware._bytes import ByteLink
from avc_hardware._connection import DEFAULT_BAUD, Connection, open_link
from avc_hardware._device import DeviceStatus
from avc_hardware._device_fault import DeviceFault
from avc_hardware._messages import Kind
from avc_hardware._monitor import pause

# Ticks until what has been cleared and is still wrong shows again.
_TICKS = 5


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
        connection.run(pause(_TICKS * connection.device.sample_time_s))
        after = connection.run(ask(Kind.STATUS, b"", DeviceStatus))
    were, left, first = (DeviceFault(codes) for codes in (before.faults, after.faults, before.first_faults))
    return Cleared(link.name, were, left, first, before.fault_tick, after)
