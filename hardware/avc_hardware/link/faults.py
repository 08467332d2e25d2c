"""Refusals and faults: reasons of a device to refuse a message, or to stop; as numbers on the wire and in words."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum, IntFlag

from avc_hardware.link.frames import PROTOCOL_VERSION


class DeviceFault(IntFlag):
    """Faults latched until they are cleared; HEARTBEAT alone ends by itself."""

    JUMP = 1
    STUCK = 2
    SPEED = 4
    ENERGY = 8
    NOT_FINITE = 16
    OVERRUN = 32
    DISABLED = 64
    WATCHDOG = 128
    BROWN_OUT = 256
    HEARTBEAT = 512

    @property
    def word(self) -> str:
        """Return the faults in a few words, separated by commas."""
        return ", ".join(_WORDS[fault] for fault in type(self)(self))

    @property
    def advice(self) -> tuple[str, ...]:
        """Return meaning and remedy of each, a sentence each."""
        return tuple(f"{_WORDS[fault]}: {_ADVICE[fault]}" for fault in type(self)(self))


_WORDS = {
    DeviceFault.JUMP: "encoder jumped",
    DeviceFault.STUCK: "encoder stuck",
    DeviceFault.SPEED: "too fast",
    DeviceFault.ENERGY: "too much energy",
    DeviceFault.NOT_FINITE: "force not a number",
    DeviceFault.OVERRUN: "ticks too long",
    DeviceFault.DISABLED: "enable line open",
    DeviceFault.WATCHDOG: "reset by the watchdog",
    DeviceFault.BROWN_OUT: "supply sank",
    DeviceFault.HEARTBEAT: "host silent",
}
_ADVICE = {
    DeviceFault.JUMP: "between two ticks it moved as nothing of this mass can; look at its wires, shield and supply",
    DeviceFault.STUCK: "no count came though the force swung; look at its wires, or for what blocks the device",
    DeviceFault.SPEED: "the device was faster than its limit; look for an unstable coupling, or a hand that let go",
    DeviceFault.ENERGY: "the coupling gave out more than it got; it does not hold this device (avc diagnose)",
    DeviceFault.NOT_FINITE: "the observer or the gains went beyond all bounds; push another coupling",
    DeviceFault.OVERRUN: "several in a row took longer than a sample time; a slower estimator or a longer sample time",
    DeviceFault.DISABLED: "the emergency stop, or what stands for it, is open; close it",
    DeviceFault.WATCHDOG: "the firmware hung and was started anew; push the coupling again",
    DeviceFault.BROWN_OUT: "the supply fell below its limit and the device started anew; push the coupling again",
    DeviceFault.HEARTBEAT: "no heartbeat in time; send them again, and let go of the device",
}

INTERFACE_VERSION = 12  # of the messages' meaning


class Reason(IntEnum):
    """Reasons of a refusal."""

    VERSION = 1
    MESSAGE = 2
    SIZE = 3
    BUSY = 4
    NO_TRANSFER = 5
    OFFSET = 6
    CRC = 7
    ROWS = 8
    NOT_FINITE = 9
    NOT_MONOTONIC = 10
    LIMIT = 11
    SAMPLE_TIME = 12
    STALE = 13
    NO_TABLE = 14
    INTERFACE = 15
    STATES = 16
    EXCITED = 17
    NO_EXCITATION = 18
    WALL = 19
    FORCE = 20
    COUPLING = 21
    IN_CONTACT = 22
    MODE = 23
    HOLD = 24
    FAULT = 25
    FLAGS = 29
    OTHER_COUPLING = 30
    BOARD = 31


_SENTENCES = {
    Reason.VERSION: "the firmware has protocol {detail}, this program {own}; bring both to the same release",
    Reason.MESSAGE: "the firmware does not know message or unit {detail}; update the firmware",
    Reason.SIZE: "a message or the table has a wrong size (the device counts {detail})",
    Reason.BUSY: "another host is sending a table (session {detail:#010x}); wait until it has ended",
    Reason.NO_TRANSFER: "the device knows of no transfer; it may have been reset",
    Reason.OFFSET: "a part of the table was lost before byte {detail}",
    Reason.CRC: "the checksum of the table is wrong",
    Reason.ROWS: "the table has too many rows or none; allowed: 1 to {detail}",
    Reason.NOT_FINITE: "{row} holds a number that is not finite",
    Reason.NOT_MONOTONIC: "{row} does not rise in frequency; sort the table and drop repeated frequencies",
    Reason.LIMIT: "{row} is outside the device's limits",
    Reason.SAMPLE_TIME: "the table was designed for another sample time than the device's",
    Reason.WALL: "the table has no wall, or one outside the device's limits",
    Reason.FORCE: "the table was designed for more force than the device gives, or its limit is no force",
    Reason.COUPLING: "the table does not name its coupling",
    Reason.IN_CONTACT: "the device is in contact; the table takes over when it is let go",
    Reason.MODE: "the device does not run its table now (mode {detail}); nothing is kept for later",
    Reason.FAULT: "the device has latched faults ({fault}); clear them first: avc device --clear",
    Reason.FLAGS: "{row} has a flag that the firmware does not know, which is older than this program; update it",
    Reason.OTHER_COUPLING: "the gains are those of another coupling than {detail:08x}, which the device runs; push "
    "theirs first",
    Reason.BOARD: "the configuration is of another device or program than the firmware is built for: avc firmware",
    Reason.HOLD: "it would hold too long; allowed: at most {detail} ticks",
    Reason.STALE: "gains with a number not above {detail} came late",
    Reason.INTERFACE: "the firmware has interface version {detail}, this program {interface}; use one release for both",
    Reason.NO_TABLE: "the device holds no table yet; push one first",
    Reason.STATES: "the table feeds back too many states; allowed: at most {detail}, beside a single row of gains",
    Reason.EXCITED: "an excitation is running (number {detail:#010x}); wait for its end, or stop it",
    Reason.NO_EXCITATION: "the device knows of another excitation or of none ({detail:#010x}); it may have been reset",
}
_PLACES = {
    0xFFFF: "the table's header",
    0xFFFE: "the state feedback",
    0xFFFD: "the plan of the excitation",
    0xFFFC: "a limit",
    0xFFFB: "the configuration",
}


@dataclass(frozen=True)
class Refusal:
    """A REFUSED answer."""

    reason: Reason | int
    detail: int

    def __str__(self) -> str:
        if not isinstance(self.reason, Reason):
            return f"for a reason unknown to this program (code {self.reason}, {self.detail}); update avc-casadi"
        return _SENTENCES[self.reason].format(
            detail=self.detail,
            row=_PLACES.get(self.detail, f"row {self.detail}"),
            own=PROTOCOL_VERSION,
            interface=INTERFACE_VERSION,
            fault=DeviceFault(self.detail).word if self.reason is Reason.FAULT else "",
        )

    @classmethod
    def read(cls, payload: bytes) -> Refusal:
        """Read the payload of REFUSED."""
        code, _, detail = struct.unpack("<HHI", payload)
        return cls(_reason(code), detail)


def _reason(code: int) -> Reason | int:
    try:
        return Reason(code)
    except ValueError:
        return code
