"""Store: what a device keeps over a reset: its coupling, its limits at run time, its name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from avc_casadi import InputError, LinkError
from avc_hardware import _messages as m
from avc_hardware._connection import DEFAULT_BAUD, Connection, open_link
from avc_hardware._device import Device
from avc_hardware._messages import Kind

if TYPE_CHECKING:
    from collections.abc import Callable

    from avc_hardware._bytes import ByteLink

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
