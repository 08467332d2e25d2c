"""Telemetry: records that a device makes at its own ticks and pushes, and what a host makes of them."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from avc_hardware._device import MODES

_HEAD = struct.Struct("<5I")
_RECORD = struct.Struct("<Ii7fI4B")


@dataclass(frozen=True)
class Record:
    """The state of a device at the end of one of its ticks, as it travels.

    Attributes:
        ticks: since the device started.
        encoder_count: raw position.
        velocity_m_per_s: backward difference over one tick.
        force_n: output, positive out of the wall.
        frequency_hz: estimate of the interaction frequency; not a number at rest.
        damping_ns_per_m: b in force.
        stiffness_n_per_m: k in force.
        contact_damping_ns_per_m: b_p in force.
        energy_j: that the hand has given (positive) since the start.
        faults: codes of `DeviceFault`.
        mode: table | ramp | safe | fault.
        streaming: whether streamed gains are in force.
        contact: whether the wall is touched.
        has_table: whether there is a table.
    """

    ticks: int
    encoder_count: int
    velocity_m_per_s: float
    force_n: float
    frequency_hz: float
    damping_ns_per_m: float
    stiffness_n_per_m: float
    contact_damping_ns_per_m: float
    energy_j: float
    faults: int
    mode: str
    streaming: bool
    contact: bool
    has_table: bool


@dataclass(frozen=True)
class Telemetry:
    """A message that the device has pushed.

    Attributes:
        number: of the message since the subscription began; a lost one leaves a gap.
        dropped: records since then for which the line was too slow.
        every: ticks from one record to the next.
        boot_id: changes when the device starts anew.
        coupling_id: of the running coupling, 8 hexadecimal digits; empty without one.
        records: in the order of their ticks.
    """

    number: int
    dropped: int
    every: int
    boot_id: int
    coupling_id: str
    records: tuple[Record, ...]

    @classmethod
    def read(cls, payload: bytes) -> Telemetry:
        """Read the payload of TELEMETRY."""
        number, dropped, every, boot_id, coupling_id = _HEAD.unpack_from(payload)
        records = []
        for *numbers, mode, streaming, contact, has_table in _RECORD.iter_unpack(payload[_HEAD.size :]):
            flags = (MODES[mode], *map(bool, (streaming, contact, has_table)))
            records.append(Record(*numbers, *flags))
        coupling = f"{coupling_id:08x}" if coupling_id else ""
        return cls(number, dropped, every, boot_id, coupling, tuple(records))


@dataclass(frozen=True)
class TelemetrySample(Record):
    """A record with what the host knows of it beside.

    Attributes:
        time_s: ticks in seconds, by the device's sample time.
        position_m: positive into the wall.
        coupling_id: of the running coupling, 8 hexadecimal digits; empty without one.
        boot_id: changes when the device starts anew.
        lost: records between the one before and this one that never came.
    """

    time_s: float
    position_m: float
    coupling_id: str
    boot_id: int
    lost: int


class Samples:
    """Turns messages into samples; a record that never came is seen by the ticks of those round it."""

    def __init__(self, sample_time_s: float, metres_per_count: float) -> None:
        self._sample_time_s = sample_time_s
        self._metres_per_count = metres_per_count
        self._last: tuple[int, int] | None = None

    def take(self, message: Telemetry) -> list[TelemetrySample]:
        """Return the samples of a message."""
        return [self._sample(message, record) for record in message.records]

    def _sample(self, message: Telemetry, record: Record) -> TelemetrySample:
        ticks, lost = record.ticks, 0
        if self._last is not None and self._last[0] == message.boot_id:
            # Counted in 32 bits; the first record after a subscription that ran out may come sooner.
            lost = max(((ticks - self._last[1]) & 0xFFFFFFFF) // max(message.every, 1) - 1, 0)
        self._last = (message.boot_id, ticks)
        return TelemetrySample(
            **vars(record),
            time_s=ticks * self._sample_time_s,
            position_m=record.encoder_count * self._metres_per_count,
            coupling_id=message.coupling_id,
            boot_id=message.boot_id,
            lost=lost,
        )
