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
from avc_hardware.link.faults import DeviceFault, Reason, Refusal
from avc_hardware.link.messages import GainsTaken, Kind
from avc_hardware.link.push import PushResult, push_over
from avc_hardware.link.session import NoAnswerError
from avc_hardware.link.table import lookup

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling


MIN_RATE_HZ, MAX_RATE_HZ = 1.0, 100.0
# A stream with a larger share of lost or late messages has failed.
_SHARE_LOST = 0.1
# Streamed gains hold for so many periods; after that the device falls back to its table.
HOLD_PERIODS = 3


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
    rate_hz: float = 50.0,
    seconds: float = 5.0,
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
    samples: list[StreamSample] = []
    refusals: list[Refusal] = []
    with Connection(link, baud=baud) as connection:
        pushed = push_over(connection, coupling, unsafe=unsafe)
        rows = coupling.table.single()
        hold_ticks = max(1, math.ceil(HOLD_PERIODS / rate_hz / connection.device.sample_time_s))
        before = connection.status()
        start = link.now_s()
        frequency = before.lookup_hz
        for number in range(max(1, round(seconds * rate_hz))):
            end, at = start + (number + 1) / rate_hz, link.now_s()
            b, k, b_p = map(float, lookup(rows, np.float32(frequency)))
            payload = m.set_gains(int(coupling.id, 16), number, hold_ticks, b, k, b_p)
            # When the host itself is late: still allow time for the answer.
            once = connection.session.request(Kind.SET_GAINS, payload, trials=1, timeout_s=max(end - at, 2e-3))
            answer, heard = None, (math.nan, math.nan, math.nan, math.nan)
            with suppress(NoAnswerError):
                answer = connection.run(once)
            if isinstance(answer, GainsTaken):
                frequency = answer.lookup_hz
                heard = (answer.frequency_hz, frequency, answer.force_n, link.now_s() - at)
            elif isinstance(answer, Refusal):
                # These do not end a stream: their effects are reported at its end.
                if answer.reason not in {Reason.STALE, Reason.NO_TABLE, Reason.MODE, Reason.OTHER_COUPLING}:
                    raise LinkError(f"{link.name}: the device refused streamed gains: {answer}")
                refusals.append(answer)
            samples.append(StreamSample(number, at - start, *heard[:2], b, k, b_p, *heard[2:]))
            if on_sample is not None:
                on_sample(samples[-1])
            connection.wait(end - link.now_s())
        lasted = link.now_s() - start
        middle = after = connection.status()
        # The device counts in its own ticks, which may lag behind this computer's clock.
        for _ in range(20):
            if not after.streaming:
                break
            connection.wait(HOLD_PERIODS / rate_hz)
            after = connection.status()
        device = connection.run(connection.session.hello())
    trips: FloatArray = np.array([s.round_trip_s for s in samples if math.isfinite(s.round_trip_s)])
    fell_back = middle.stream_expired - before.stream_expired
    late = sum(one.reason is Reason.STALE for one in refusals)
    lost = len(samples) - len(trips) - len(refusals)
    faults = [*_faults_of_end(pushed, after, device), *_faults_on_the_way(len(samples), lost, late, refusals)]
    if fell_back > 0:
        faults.append(f"the device went back to its table in mid-stream, {fell_back} times")
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


def _faults_of_end(pushed: PushResult, status: DeviceStatus, device: Device) -> list[str]:
    """Describe how the device's table differs from the pushed one."""
    faults = []
    if device.boot_id != pushed.device.boot_id:
        faults.append("the device has started anew since the push")
    if not status.has_table:
        faults.append("the device holds no table")
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
        last = next(one for one in reversed(refusals) if one.reason is not Reason.STALE)
        faults.append(f"{len(refusals) - late} of {sent} messages were refused, the last: {last}")
    return faults
