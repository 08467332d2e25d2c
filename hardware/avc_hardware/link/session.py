"""Session: the host's side of every dialogue as a pure state machine, without I/O and without time."""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import TypeVar

from avc_casadi import LinkError
from avc_hardware.link import messages as m
from avc_hardware.link.device import Device, DeviceStatus
from avc_hardware.link.faults import INTERFACE_VERSION, Refusal, RefusalReason
from avc_hardware.link.frames import DELIMITER, Frame, encode
from avc_hardware.link.messages import Kind, Message
from avc_hardware.link.table import TableImage

T = TypeVar("T")

CHUNK_BYTES = 512  # of a table in a message
RETRIES = 4
ATTEMPTS = 5
# A table takes over out of contact: polling interval, and number of polls before it is given up.
CONTACT_WAIT_S = 0.25
CONTACT_TRIALS = 40
BUSY_WAIT_S = 0.7
"""Wait of a push while another host sends.

The device drops a transfer that was abandoned two seconds ago: the waits of all attempts are longer."""


class NoAnswerError(LinkError):
    """The device did not answer in time."""


class RefusedError(LinkError):
    """The device refused, with its reason."""

    def __init__(self, refusal: Refusal) -> None:
        self.refusal = refusal
        super().__init__(f"the device refused: {refusal}")


class InContactError(LinkError):
    """The device was not released, so that the new table was withdrawn."""


@dataclass(frozen=True)
class Exchange:
    """One step of a dialogue: bytes to send (may be empty), then the longest wait for an answer."""

    data: bytes
    timeout_s: float


Answer = tuple[int, Message] | None


@dataclass(frozen=True)
class Upload:
    """Result of a push."""

    device: Device
    attempts: int
    ticks: int
    waited: int


class Session:
    """Numbers and repeats the messages of one host."""

    def __init__(self, number: int, *, timeout_s: float, on_wait: Callable[[], None] | None = None) -> None:
        """Start a session."""
        self.number = number
        self.timeout_s = timeout_s
        self.on_wait = on_wait
        self._sequence = number & 0x7FFF

    def message(self, kind: Kind, payload: bytes) -> tuple[int, bytes]:
        """Return the number and the bytes of a new message."""
        self._sequence = (self._sequence + 1) & 0xFFFF
        return self._sequence, encode(Frame(kind, self._sequence, payload))

    def request(
        self, kind: Kind, payload: bytes, *, trials: int = RETRIES, timeout_s: float | None = None
    ) -> Generator[Exchange, Answer, Message]:
        """Repeat one message until it is answered; a refusal is returned like any answer."""
        sequence, data = self.message(kind, payload)
        wait_s = self.timeout_s if timeout_s is None else timeout_s
        for trial in range(trials):
            # A partial frame may be in the pipe: a delimiter ends it.
            answer = yield Exchange(DELIMITER + data, wait_s * (1 + trial))
            while answer is not None:
                if answer[0] == sequence:
                    return answer[1]
                answer = yield Exchange(b"", wait_s)
        raise NoAnswerError(f"no answer to {kind.name} after {trials} requests")

    def hello(self) -> Generator[Exchange, Answer, Device]:
        """Identify the device, which refuses a host of another interface."""
        return (yield from self.ask(Kind.HELLO, m.words(self.number, INTERFACE_VERSION), Device))

    def ask(self, kind: Kind, payload: bytes, expected: type[T]) -> Generator[Exchange, Answer, T]:
        """Send one message and return its answer, which must be of the expected class."""
        answer = yield from self.request(kind, payload)
        if isinstance(answer, Refusal):
            raise RefusedError(answer)
        if not isinstance(answer, expected):
            raise LinkError(f"{kind.name} was answered with {type(answer).__name__}")
        return answer

    def read_table(self, size: int) -> Generator[Exchange, Answer, bytes]:
        """Return ``size`` bytes of the running table, read in parts."""
        image = b""
        while len(image) < size:
            part = m.words(len(image), min(CHUNK_BYTES, size - len(image)))
            image += (yield from self.ask(Kind.READBACK, part, m.Readback)).data
        return image

    def push(self, table: TableImage, device: Device) -> Generator[Exchange, Answer, Upload]:
        """Send a table, have it swapped in, read it back; restarted when the device was reset or is busy."""
        failure: LinkError | None = None
        for attempt in range(1, ATTEMPTS + 1):
            try:
                if attempt > 1:
                    device = yield from self.hello()
                committed = yield from self._transfer(table, device)
                config = table.config  # before the table, which a device that was reset since has not
                if config:
                    config = (yield from self.ask(Kind.CONFIG, b"", m.ConfigRead)).data
                    device = yield from self.hello()
                image = yield from self.read_table(len(table.image))
            except RefusedError as error:
                anew = {
                    RefusalReason.SIZE,
                    RefusalReason.BUSY,
                    RefusalReason.NO_TRANSFER,
                    RefusalReason.OFFSET,
                    RefusalReason.CRC,
                    RefusalReason.NO_TABLE,
                }
                if error.refusal.reason not in anew:
                    raise
                failure = error
                if error.refusal.reason is RefusalReason.BUSY:
                    yield from _wait(BUSY_WAIT_S)
            else:
                if (image, config) == (table.image, table.config):
                    return Upload(device, attempt, committed.ticks, committed.waited)
                failure = LinkError("the table read back differs from the one sent; another host may have pushed")
        raise LinkError(f"the table was not taken after {ATTEMPTS} attempts: {failure}") from failure

    def _transfer(self, table: TableImage, device: Device) -> Generator[Exchange, Answer, m.Committed]:
        """Send a table in chunks, with the configuration where the device has another, and let it be swapped in."""
        image = table.image
        table_id = table.table_id
        begin = m.begin(self.number, table_id, table.crc32, len(table.rows), table.states)
        begun = yield from self.ask(Kind.BEGIN, begin, m.Acknowledged)
        if table.config and table.config[:4] != device.config_crc32.to_bytes(4, "little"):
            yield from self.ask(Kind.CONFIG, m.words(self.number, table_id) + table.config, m.Acknowledged)
        received = begun.value
        while received < len(image):
            part = m.words(self.number, table_id, received) + image[received : received + CHUNK_BYTES]
            received = (yield from self.ask(Kind.CHUNK, part, m.Acknowledged)).value
        return (yield from self._commit(table))

    def _commit(self, table: TableImage) -> Generator[Exchange, Answer, m.Committed]:
        """Have the table swapped in; wait while the device is in contact, and finally withdraw it."""
        payload = m.words(self.number, table.table_id, table.crc32)
        for trial in range(CONTACT_TRIALS):
            try:
                return (yield from self.ask(Kind.COMMIT, payload, m.Committed))
            except RefusedError as error:
                if error.refusal.reason is not RefusalReason.IN_CONTACT:
                    raise
            if trial == 0 and self.on_wait is not None:
                self.on_wait()
            yield from _wait(CONTACT_WAIT_S)
        yield from self.ask(Kind.ABORT, m.words(self.number), m.Acknowledged)
        device = yield from self.hello()  # it may have been released at the last moment
        if (device.table_id, device.table_crc32) == (table.table_id, table.crc32):
            return (yield from self.ask(Kind.COMMIT, payload, m.Committed))
        status = yield from self.ask(Kind.STATUS, b"", DeviceStatus)
        face_m = 0.0 if table.feedback is None else -table.feedback.face_m
        why = f"the device stood at {status.position_m:.4g}, inside the new wall, which begins at {face_m:.4g},"
        if status.contact and status.has_table and not status.faults:  # after a fault nothing of it runs
            why = "the device was in contact with the wall that it runs"
        raise InContactError(
            f"{why} for {CONTACT_TRIALS * CONTACT_WAIT_S:.0f} s, and a coupling takes over out of contact only; the "
            "device still runs its previous coupling: move the device out of the wall, release it, and push again"
        )


def _wait(seconds: float) -> Generator[Exchange, Answer, None]:
    while (yield Exchange(b"", seconds)) is not None:
        pass
