"""Faults: a link that spoils what passes through it, at stated bytes; for tests of a host, a firmware or a port."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import StrEnum

from avc_casadi import LinkError
from avc_hardware.link.bytes import ByteLink


class FaultKind(StrEnum):
    """What happens to a byte, or to the link at that byte."""

    FLIP = "flip"  # some bits change
    DROP = "drop"  # some bytes are lost
    DUPLICATE = "duplicate"  # some bytes come twice
    REORDER = "reorder"  # the byte comes after the next ones
    INSERT = "insert"  # a foreign byte comes before it
    TRUNCATE = "truncate"  # the rest of this write or read is lost
    SPLIT = "split"  # the rest comes with the next read, or is sent before the next write
    STALL = "stall"  # nothing passes for some time, in either direction; what is sent is lost
    RESET = "reset"  # the device starts anew
    UNPLUG = "unplug"  # the link is gone


@dataclass(frozen=True)
class LinkFault:
    """One fault."""

    to_device: bool
    at: int
    kind: FaultKind
    amount: int = 1


class FaultyLink:
    """Wraps a link; each fault happens once."""

    def __init__(
        self, link: ByteLink, faults: Iterable[LinkFault], *, reset: Callable[[], None] = lambda: None
    ) -> None:
        """Wrap ``link``; ``reset`` makes the device start anew."""
        self._link = link
        self._faults = list(faults)
        self._reset = reset
        self._counts = {True: 0, False: 0}
        self._held = {True: b"", False: b""}
        self._silent_until_s = -1.0
        self._unplugged = False
        self.happened: list[LinkFault] = []

    @property
    def name(self) -> str:
        """Name of the wrapped link."""
        return self._link.name

    def now_s(self) -> float:
        """Clock of the wrapped link."""
        return self._link.now_s()

    def write(self, data: bytes) -> None:
        """Send what is left of the bytes."""
        self._check()
        data = self._spoil(data, to_device=True)
        self._check()
        if data and self.now_s() >= self._silent_until_s:
            self._link.write(data)

    def read(self, timeout_s: float) -> bytes:
        """Return what is left of the bytes."""
        self._check()
        data = self._spoil(self._link.read(timeout_s), to_device=False)
        self._check()
        return data if self.now_s() >= self._silent_until_s else b""

    def close(self) -> None:
        """Close the wrapped link."""
        self._link.close()

    def _check(self) -> None:
        if self._unplugged:
            raise LinkError(f"{self.name}: unplugged")

    def _spoil(self, data: bytes, *, to_device: bool) -> bytes:
        start = self._counts[to_device]
        self._counts[to_device] = start + len(data)
        held, self._held[to_device] = self._held[to_device], b""
        due = [
            fault for fault in self._faults if fault.to_device == to_device and start <= fault.at < start + len(data)
        ]
        for fault in sorted(due, key=lambda fault: -fault.at):  # from the end, so that positions stay right
            self._faults.remove(fault)
            self.happened.append(fault)
            data = self._apply(fault, data, fault.at - start)
        return held + data

    def _apply(self, fault: LinkFault, data: bytes, at: int) -> bytes:
        before, here, after = data[:at], data[at : at + 1], data[at + 1 :]
        amount = fault.amount
        left = b""
        match fault.kind:
            case FaultKind.FLIP:
                left = bytes(byte ^ (amount & 0xFF or 1) for byte in here) + after
            case FaultKind.DROP:
                left = data[at + amount :]
            case FaultKind.DUPLICATE:
                left = data[at : at + amount] + data[at:]
            case FaultKind.REORDER:
                left = after[:amount] + here + after[amount:]
            case FaultKind.INSERT:
                left = bytes([amount & 0xFF]) + here + after
            case FaultKind.SPLIT:
                self._held[fault.to_device] = here + after + self._held[fault.to_device]
            case FaultKind.STALL:
                self._silent_until_s = self.now_s() + 0.01 * amount
            case FaultKind.RESET:
                self._reset()
            case FaultKind.UNPLUG:
                self._unplugged = True
            case FaultKind.TRUNCATE:
                pass
        return before + left
