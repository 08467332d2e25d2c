"""Streaming: the host selects the gains live, by the frequency that the device reports; the table is the fallback."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi import InputError, LinkError
from avc_casadi._util.arrays import FloatArray
from avc_casadi.claims.deployable import require_deployable
from avc_hardware.codegen.firmware_fit import check_runs_on
from avc_hardware.emulator.board import emulated_board
from avc_hardware.link import messages as m
from avc_hardware.link.bytes import ByteLink
from avc_hardware.link.connection import DEFAULT_BAUD, Connection, open_link
from avc_hardware.link.device import MODES, Device, DeviceStatus
from avc_hardware.link.faults import DeviceFault, Refusal, RefusalReason
from avc_hardware.link.messages import GainsTaken, Kind, Message
from avc_hardware.link.push import PushResult, push_over
from avc_hardware.link.session import NoAnswerError
from avc_hardware.link.table import lookup

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling


MIN_RATE_HZ = 1.0
MAX_RATE_HZ = 100.0
RATE_HZ = 50.0
"""Usual rate of messages."""
SECONDS = 5.0
"""Usual duration of a stream."""
_SHARE_LOST = 0.1
"""A stream with a larger share of lost or late messages has failed."""
HOLD_PERIODS = 3
"""Streamed gains hold for so many periods; after that the device falls back to its table."""
_LEAST_TIMEOUT_S = 2e-3
"""Time for an answer where the host itself is late."""
_WAITS_FOR_TABLE = 20
"""Waits, of the hold each, in which the device goes back to its table."""


@dataclass(frozen=True)
class StreamSample:
    """One SET_GAINS and its answer."""

    number: int
    time_s: float
    frequency_hz: float
    lookup_hz: float
    damping_ns_per_m: float
    stiffness_n_per_m: float
    contact_damping_ns_per_m: float
    force_n: float
    round_trip_s: float


@dataclass(frozen=True)
class StreamResult:
    """A whole stream."""

    port: str
    rate_hz: float
    seconds: float
    sent: int
    taken: int
    late: int
    lost: int
    fell_back: int
    round_trip_s: float
    round_trip_max_s: float
    samples: tuple[StreamSample, ...]
    push: PushResult
    status: DeviceStatus
    faults: tuple[str, ...]


def stream(
    coupling: Coupling,
    port: str | ByteLink,
    *,
    rate_hz: float = RATE_HZ,
    seconds: float = SECONDS,
    baud: int = DEFAULT_BAUD,
    unsafe: bool = False,
    on_sample: Callable[[StreamSample], None] | None = None,
) -> StreamResult:
    """Push the coupling, then send its gains live for a time; a message that is late or lost is not repeated."""
    if not MIN_RATE_HZ <= rate_hz <= MAX_RATE_HZ:
        raise InputError.of(f"{rate_hz:g} Hz; allowed: {MIN_RATE_HZ:g} to {MAX_RATE_HZ:g}", key="rate_hz")
    require_deployable(coupling, unsafe=unsafe)
    check_runs_on(coupling)
    link = open_link(port, baud=baud, board=partial(emulated_board, coupling))
    with Connection(link, baud=baud) as connection:
        pushed = push_over(connection, coupling, unsafe=unsafe)
        before = connection.status()
        sent = _Stream(connection, coupling, rate_hz, before.lookup_hz)
        sent.run(seconds, on_sample)
        lasted = link.now_s() - sent.start_s
        middle = connection.status()
        after = _back_on_table(connection, middle, rate_hz)
        device = connection.run(connection.session.hello())
    samples = sent.samples
    refusals = sent.refusals
    trips = sent.round_trips_s
    fell_back = middle.stream_expired - before.stream_expired
    late = sum(refusal.reason is RefusalReason.STALE for refusal in refusals)
    lost = len(samples) - len(trips) - len(refusals)
    faults = [*_faults_of_end(pushed, after, device), *_faults_on_the_way(len(samples), lost, late, refusals)]
    if fell_back > 0:
        faults.append(f"the device returned to its table during the stream, {fell_back} times")
    return StreamResult(
        port=link.name,
        rate_hz=rate_hz,
        seconds=lasted,
        sent=len(samples),
        taken=len(trips),
        late=late,
        lost=lost,
        fell_back=fell_back,
        round_trip_s=float(np.median(trips)) if len(trips) else math.nan,
        round_trip_max_s=float(trips.max()) if len(trips) else math.nan,
        samples=tuple(samples),
        push=pushed,
        status=after,
        faults=tuple(faults),
    )


class _Stream:
    """Gains on their way to a device, by the frequency that it reports."""

    def __init__(self, connection: Connection, coupling: Coupling, rate_hz: float, frequency_hz: float) -> None:
        """Begin a stream of gains at a rate, Hz, at the frequency, Hz, that the device has looked up last."""
        self._connection = connection
        self._coupling_id = int(coupling.id, 16)
        self._rows = coupling.table.single()
        self._rate_hz = rate_hz
        self._frequency_hz = frequency_hz
        self._hold_ticks = max(1, math.ceil(HOLD_PERIODS / rate_hz / connection.device.sample_time_s))
        self.start_s = connection.link.now_s()
        self.samples: list[StreamSample] = []
        self.refusals: list[Refusal] = []

    @property
    def round_trips_s(self) -> FloatArray:
        """Times from a message to its answer, of those that were taken."""
        return np.array([sample.round_trip_s for sample in self.samples if math.isfinite(sample.round_trip_s)])

    def run(self, seconds: float, on_sample: Callable[[StreamSample], None] | None) -> None:
        """Send a message each period for so long, one at least, and report each with its answer."""
        for number in range(max(1, round(seconds * self._rate_hz))):
            self.send(number)
            if on_sample is not None:
                on_sample(self.samples[-1])
            self.wait_until(number + 1)

    def _period_begins_s(self, number: int) -> float:
        """Return the time at which a message's period begins."""
        return self.start_s + number / self._rate_hz

    def wait_until(self, number: int) -> None:
        """Let time pass until the period of a message begins."""
        self._connection.wait(self._period_begins_s(number) - self._connection.link.now_s())

    def send(self, number: int) -> None:
        """Send the gains of the frequency that was heard last, once; add the sample, and a refusal."""
        connection = self._connection
        end_s = self._period_begins_s(number + 1)
        sent_s = connection.link.now_s()
        b, k, b_p = map(float, lookup(self._rows, np.float32(self._frequency_hz)))
        payload = m.set_gains(self._coupling_id, number, self._hold_ticks, b, k, b_p)
        timeout_s = max(end_s - sent_s, _LEAST_TIMEOUT_S)
        request = connection.session.request(Kind.SET_GAINS, payload, trials=1, timeout_s=timeout_s)
        answer: Message | None = None
        with suppress(NoAnswerError):
            answer = connection.run(request)
        taken = answer if isinstance(answer, GainsTaken) else None
        round_trip_s = math.nan
        if taken is not None:
            self._frequency_hz = taken.lookup_hz
            round_trip_s = connection.link.now_s() - sent_s
        elif isinstance(answer, Refusal):
            # These do not end a stream: their effects are reported at its end.
            if answer.reason not in {
                RefusalReason.STALE,
                RefusalReason.NO_TABLE,
                RefusalReason.MODE,
                RefusalReason.OTHER_COUPLING,
            }:
                raise LinkError(f"{connection.link.name}: the device refused streamed gains: {answer}")
            self.refusals.append(answer)
        self.samples.append(
            StreamSample(
                number=number,
                time_s=sent_s - self.start_s,
                frequency_hz=math.nan if taken is None else taken.frequency_hz,
                lookup_hz=math.nan if taken is None else taken.lookup_hz,
                damping_ns_per_m=b,
                stiffness_n_per_m=k,
                contact_damping_ns_per_m=b_p,
                force_n=math.nan if taken is None else taken.force_n,
                round_trip_s=round_trip_s,
            )
        )


def _back_on_table(connection: Connection, status: DeviceStatus, rate_hz: float) -> DeviceStatus:
    """Wait until a device is back on its table and return its state; it counts in its own ticks, which may lag."""
    for _ in range(_WAITS_FOR_TABLE):
        if not status.streaming:
            break
        connection.wait(HOLD_PERIODS / rate_hz)
        status = connection.status()
    return status


def _faults_of_end(pushed: PushResult, status: DeviceStatus, device: Device) -> list[str]:
    """Describe how the device's table differs from the pushed one."""
    faults = []
    if device.boot_id != pushed.device.boot_id:
        faults.append("the device has restarted since the push")
    if not status.has_table:
        faults.append("the device has no table")
    elif (device.table_id, device.table_crc32) != (pushed.table_id, pushed.crc32):
        faults.append(f"the device runs table {device.table_id} of coupling {device.coupling_id}, another host's")
    if status.streaming:
        faults.append("the device still runs streamed gains")
    if status.faults:
        faults.append(f"the device has a fault: {DeviceFault(status.faults).word}")
    if status.mode != MODES[0]:
        faults.append(f"the device does not run its table (mode {status.mode})")
    return faults


def _faults_on_the_way(sent: int, lost: int, late: int, refusals: list[Refusal]) -> list[str]:
    """Describe losses and refusals above a small share of the messages."""
    faults = []
    if lost + late > _SHARE_LOST * sent:
        faults.append(f"{lost} of {sent} messages were lost, {late} late")
    if len(refusals) - late > _SHARE_LOST * sent:
        last = next(refusal for refusal in reversed(refusals) if refusal.reason is not RefusalReason.STALE)
        faults.append(f"{len(refusals) - late} of {sent} messages were refused, the last: {last}")
    return faults
