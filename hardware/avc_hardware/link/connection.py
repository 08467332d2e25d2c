"""Connection: serial ports, also that of a known USB device; dialogues of a session over a link, by its own clock."""

from __future__ import annotations

import math
import os
import secrets
from collections import deque
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Self, TypeVar

from serial.tools import list_ports as tools

from avc_casadi import InputError, LinkError, PortError
from avc_hardware.emulator.board import EmulatedBoard
from avc_hardware.link.bytes import ByteLink, SerialLink
from avc_hardware.link.device import MODES, Device, DeviceStatus
from avc_hardware.link.frames import DELIMITER, MAX_ENCODED, Decoder
from avc_hardware.link.messages import Acknowledged, Kind, Message, parse, words
from avc_hardware.link.session import Answer, Exchange, NoAnswerError, Session
from avc_hardware.link.table import TableImage
from avc_hardware.link.telemetry import Telemetry


@dataclass(frozen=True)
class Port:
    """A serial port."""

    device: str
    description: str
    serial_number: str | None
    accessible: bool


def list_ports() -> tuple[Port, ...]:
    """Return the serial ports, USB devices first; pseudo-terminals never appear."""
    return tuple(
        Port(
            device=info.device,
            description=info.description or "",
            serial_number=info.serial_number,
            accessible=os.access(info.device, os.R_OK | os.W_OK) or os.name == "nt",
        )
        for info in sorted(tools.comports(), key=lambda info: (info.vid is None, info.device))
    )


def find_port(serial_number: str) -> str:
    """Return the present path of the USB device with this serial number; it may change with every plugging in."""
    ports = list_ports()
    for port in ports:
        if port.serial_number == serial_number:
            return port.device
    known = ", ".join(port.serial_number for port in ports if port.serial_number) or "none"
    raise PortError(f"no serial port has the USB serial number {serial_number!r}; present: {known}")


T = TypeVar("T")

EMULATOR = "emulator"
EMULATOR_IS_FRESH = "each command starts a new emulated board: no table and no state carries over"
USB = "usb:"
DEFAULT_BAUD = 115200
_THINKS_S = 0.15
"""Time for the device and the driver to think, beside that of the bytes on the wire."""
_DEADLINE_S = 15.0
"""Time after which a dialogue is given up, beside that of the bytes on the wire."""


class Connection:
    """An open device: use as a context manager."""

    def __init__(
        self,
        link: ByteLink,
        *,
        baud: int = DEFAULT_BAUD,
        deadline_s: float | None = None,
        session: int | None = None,
        on_wait: Callable[[], None] | None = None,
    ) -> None:
        """Take over a link and send HELLO."""
        self.link = link
        # A full frame out and a full answer back, ten bits a byte.
        timeout_s = _THINKS_S + 2 * MAX_ENCODED * 10 / baud
        self.session = Session(session or secrets.randbits(32), timeout_s=timeout_s, on_wait=on_wait)
        self._deadline_s = _DEADLINE_S + 4 * 2 * 4200 * 10 / baud if deadline_s is None else deadline_s
        self._decoder = Decoder()
        self._waiting: deque[tuple[int, Message]] = deque()
        self._telemetry: deque[Telemetry] = deque()
        try:
            self.link.write(DELIMITER)
            self.device: Device = self.run(self.session.hello())
        except NoAnswerError as error:
            self.link.close()
            raise LinkError(
                f"{link.name}: no answer at {baud} baud; is this the right port (`avc doctor --ports`), does the "
                "device run the avc firmware, and does the firmware have this rate?"
            ) from error
        except BaseException:
            self.link.close()
            raise

    def run(self, dialogue: Generator[Exchange, Answer, T]) -> T:
        """Send the messages of a dialogue and hand it the answers until it returns; give up at the deadline."""
        end_s = self.link.now_s() + self._deadline_s
        try:
            exchange = next(dialogue)
            while True:
                if exchange.data:
                    self.link.write(exchange.data)
                answer = self._next(self._waiting, min(self.link.now_s() + exchange.timeout_s, end_s))
                if answer is None and self.link.now_s() >= end_s:
                    dialogue.close()
                    raise LinkError(
                        f"{self.link.name}: gave up after {self._deadline_s:.0f} s; the line loses too many messages"
                    )
                exchange = dialogue.send(answer)
        except NoAnswerError as error:
            raise NoAnswerError(f"{self.link.name}: {error}; is the device still connected and switched on?") from error
        except StopIteration as stop:
            result: T = stop.value
            return result

    def ask(self, kind: Kind, payload: bytes, expected: type[T]) -> T:
        """Send a message until it is answered; raise for a refusal."""
        return self.run(self.session.ask(kind, payload, expected))

    def status(self) -> DeviceStatus:
        """Return the state of the device."""
        return self.ask(Kind.STATUS, b"", DeviceStatus)

    def wait(self, seconds: float) -> None:
        """Let time pass, whatever arrives."""
        end = self.link.now_s() + seconds
        left = end - self.link.now_s()
        while left > 0:
            self._read(left)
            left = end - self.link.now_s()

    def configure(self, config: bytes) -> None:
        """Send a configuration, as `packed_config` returns it, without a table; none runs after it."""
        self.device = self.run(self.session.push(TableImage.alone(config), self.device)).device

    def heartbeat(self, within_s: float) -> str:
        """Send a heartbeat with the time to the next one, without which the device fades its force."""
        ticks = math.ceil(within_s / self.device.sample_time_s)
        return MODES[self.ask(Kind.HEARTBEAT, words(ticks), Acknowledged).value]

    def telemetry(self, timeout_s: float) -> Telemetry | None:
        """Return the next message that the device has pushed; None when none comes in time."""
        return self._next(self._telemetry, self.link.now_s() + timeout_s)

    def _next(self, queue: deque[T], until_s: float) -> T | None:
        while not queue:
            left = until_s - self.link.now_s()
            if left <= 0:
                return None
            self._read(left)
        return queue.popleft()

    def _read(self, timeout_s: float) -> None:
        """Sort incoming messages: answers and telemetry."""
        for frame in self._decoder.feed(self.link.read(timeout_s)):
            message = parse(frame)
            if isinstance(message, Telemetry):
                self._telemetry.append(message)
            elif message is not None:
                self._waiting.append((frame.sequence, message))

    def close(self) -> None:
        """Close the link."""
        self.link.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def open_link(
    port: str | ByteLink, *, baud: int = DEFAULT_BAUD, board: Callable[[], EmulatedBoard] = EmulatedBoard
) -> ByteLink:
    """Open a port; of an emulated board the one that is made here."""
    if isinstance(port, ByteLink):
        return port
    if port == EMULATOR:
        if baud != DEFAULT_BAUD:
            raise InputError.of(f"is {baud}; allowed with the emulated board: {DEFAULT_BAUD}", key="baud")
        return board()
    number = port.removeprefix(USB)
    return SerialLink(find_port(number) if number != port else port, baud)
