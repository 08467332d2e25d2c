"""Refusals and faults: reasons of a device to refuse a message, or to stop; as numbers on the wire and in words."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import Self

from avc_hardware.link.frames import PROTOCOL_VERSION


class DeviceFault(IntFlag):
    """Faults latched until they are cleared; HEARTBEAT ends with the next one too. In a few words, then what to do."""

    sentence: str

    def __new__(cls, code: int, sentence: str = "") -> Self:
        """Give the number its sentence."""
        made = int.__new__(cls, code)
        made._value_, made.sentence = code, sentence
        return made

    JUMP = 1, "encoder jumped: faster than this mass can move; check the encoder's wires, shield and supply"
    STUCK = 2, "encoder stuck: no counts although the force varied; check the encoder's wires, and free the device"
    SPEED = (
        4,
        "too fast: the device was faster than its limit; check for an unstable coupling, or a hand that released it",
    )
    ENERGY = 8, "too much energy: the coupling generated energy; it is not stable on this device (avc diagnose)"
    NOT_FINITE = 16, "force not a number: observer or gains overflowed; push another coupling"
    OVERRUN = 32, "ticks too long: several in a row; use a simpler estimator or a longer sample time"
    DISABLED = 64, "enable line open: the emergency stop or its substitute is open; close it"
    WATCHDOG = 128, "reset by the watchdog: the firmware hung and restarted; push the coupling again"
    BROWN_OUT = 256, "supply low: the supply fell below its limit and the device restarted; push the coupling again"
    HEARTBEAT = 512, "host silent: no heartbeat came in time; start avc monitor --heartbeat, and release the device"

    @property
    def word(self) -> str:
        """Return the faults in a few words, separated by commas."""
        return ", ".join(fault.sentence.partition(":")[0] for fault in self)

    @property
    def advice(self) -> tuple[str, ...]:
        """Return meaning and remedy of each, a sentence each."""
        return tuple(fault.sentence for fault in self)


INTERFACE_VERSION = 14  # of the messages' meaning


class RefusalReason(IntEnum):
    """Reasons of a refusal: number on the wire, and sentence."""

    sentence: str

    def __new__(cls, code: int, sentence: str = "") -> Self:
        """Give the number its sentence."""
        made = int.__new__(cls, code)
        made._value_, made.sentence = code, sentence
        return made

    VERSION = 1, "the firmware has protocol {detail}, this program {own}; use one release for both"
    MESSAGE = 2, "the firmware does not know message {detail}; update the firmware"
    SIZE = 3, "a message or the table has a wrong size (the device counts {detail})"
    BUSY = 4, "another host is sending a table (session {detail:#010x}); wait until it has ended"
    NO_TRANSFER = 5, "the device has no transfer in progress; it may have been reset"
    OFFSET = 6, "a part of the table was lost before byte {detail}"
    CRC = 7, "the checksum of the table is wrong"
    ROWS = 8, "the table has too many rows, or no row; allowed: 1 to {detail}"
    NOT_FINITE = 9, "{row} has a number that is not finite"
    NOT_MONOTONIC = 10, "{row} does not rise in frequency; sort the table and drop repeated frequencies"
    LIMIT = 11, "{row} is outside the device's limits"
    SAMPLE_TIME = 12, "the table was designed for another sample time than the device's"
    STALE = 13, "the gains came late: their number is not above {detail}"
    NO_TABLE = 14, "the device has no table yet; push a coupling first"
    INTERFACE = 15, "the firmware has interface version {detail}, this program {interface}; use one release for both"
    STATES = 16, "the table has too many observer states; allowed: at most {detail}, with a single row of gains"
    EXCITED = 17, "an excitation is running (number {detail:#010x}); wait for its end, or stop it"
    NO_EXCITATION = 18, "the device runs another excitation, or no excitation ({detail:#010x}); it may have been reset"
    WALL = 19, "the table has no wall, or a wall outside the device's limits"
    FORCE = 20, "the table was designed for more force than the device gives, or its force limit is invalid"
    COUPLING = 21, "the table does not name its coupling"
    IN_CONTACT = 22, "the device is in contact; the table takes over when it is released"
    MODE = 23, "the device does not run its table now (mode {detail}); the gains were not stored, send them again later"
    HOLD = 24, "the duration is too long; allowed: at most {detail} ticks"
    FAULT = 25, "the device has latched faults ({fault}); clear them first: avc device --clear"
    FLAGS = 29, "{row} has a flag that the firmware does not know; the firmware is older than this program: update it"
    OTHER_COUPLING = 30, "the gains belong to another coupling than {detail:08x}, which runs; push their coupling first"
    BOARD = 31, "the configuration is of another device or program than the firmware; build new firmware: avc firmware"


_PLACES = {
    0xFFFF: "the table's header",
    0xFFFE: "the state feedback",
    0xFFFD: "the plan of the excitation",
    0xFFFC: "a limit",
    0xFFFB: "the configuration",
    0xFFFA: "a message of gains",
}


@dataclass(frozen=True)
class Refusal:
    """A REFUSED answer."""

    reason: RefusalReason
    detail: int

    def __str__(self) -> str:
        return self.reason.sentence.format(
            detail=self.detail,
            row=_PLACES.get(self.detail, f"row {self.detail}"),
            own=PROTOCOL_VERSION,
            interface=INTERFACE_VERSION,
            fault=DeviceFault(self.detail).word if self.reason is RefusalReason.FAULT else "",
        )

    @classmethod
    def read(cls, payload: bytes) -> Refusal:
        """Read the payload of REFUSED."""
        code, _, detail = struct.unpack("<HHI", payload)
        return cls({int(reason): reason for reason in RefusalReason}[code], detail)
