"""What a device reports: its identity (HELLO) and its state (STATUS)."""

from __future__ import annotations

import struct
from dataclasses import dataclass, fields

import numpy as np

from avc_casadi import LinkError
from avc_hardware.codegen.figures import ESTIMATOR_NUMBERS, NO_SLEW_PER_S, BoardLimits, RuntimeFigures

MODES = ("table", "ramp", "safe", "fault")
_COUPLING_ID = 14  # place in STATUS
_HELLO = struct.Struct("<HHHH8sI6fIIHH4fHHHHHHI8fI3f12sIHH")
_STATUS = struct.Struct("<II9fi18I8B3f")


@dataclass(frozen=True)
class Device:
    """Answer to HELLO."""

    interface_version: int
    capacity_rows: int
    window_bytes: int
    chunk_bytes: int
    build: str
    boot_id: int
    sample_time_s: float
    metres_per_count: float
    max_force_n: float
    max_damping_ns_per_m: float
    max_stiffness_n_per_m: float
    max_contact_damping_ns_per_m: float
    table_id: int
    table_crc32: int
    table_rows: int
    transfer_open: bool
    figures: RuntimeFigures
    capacity_states: int
    table_states: int
    capacity_tones: int
    kept_records: int
    coupling_id: str
    wall_damping_ns_per_m: float
    wall_stiffness_n_per_m: float
    force_limit_n: float
    max_speed_m_per_s: float
    max_acceleration_m_per_s2: float
    max_energy_j: float
    stuck_swing_n: float
    max_overruns: int
    faults: int
    lowered_force_n: float
    lowered_speed_m_per_s: float
    lowered_energy_j: float
    unique_id: str
    config_crc32: int
    bound: bool

    @classmethod
    def read(cls, payload: bytes) -> Device:
        """Read the payload of the answer to HELLO."""
        values = _HELLO.unpack(payload)
        build = values[4].rstrip(b"\0").decode("ascii", "replace")
        meant = [_meant(value) for value in values[6:12]]
        hold_s, slew_per_s, guard, reach = map(_meant, values[16:20])
        figures = RuntimeFigures(
            sample_time_s=meant[0],
            metres_per_count=meant[1],
            estimator=ESTIMATOR_NUMBERS[values[20]],
            hold_s=hold_s,
            slew_per_s=slew_per_s if slew_per_s < NO_SLEW_PER_S / 2 else None,
            passive=bool(values[21]),
            guard_damping_ns_per_m=guard,
            hand_m_per_unit=reach,
        )
        running = (*values[12:15], bool(values[15]))
        coupling = _coupling(values[26], bool(values[14]))
        unique_id = values[39].hex() if any(values[39]) else ""
        wall, watched = map(_meant, values[27:30]), map(_meant, values[30:34])
        head = [*values[:4], build, values[5], *meant, *running, figures, *values[22:26], coupling, *wall]
        end = [unique_id, values[40], bool(values[41])]
        return cls(*[*head, *watched, int(values[34]), values[35], *map(_meant, values[36:39]), *end])

    @property
    def limits(self) -> BoardLimits:
        """Return its limits: those built in, or last sent where it is not bound."""
        return BoardLimits(*(float(getattr(self, field.name)) for field in fields(BoardLimits)))


def require_same(first: Device, now: Device) -> None:
    """Refuse another device than the first one, by the numbers of their chips; some chips have none."""
    if now.unique_id != first.unique_id:
        raise LinkError(
            f"another device answers than before, chip {now.unique_id or 'without a number'} in place of "
            f"{first.unique_id or 'one without'}; nothing was sent to it"
        )


@dataclass(frozen=True)
class DeviceStatus:
    """One STATUS sample; ``frequency_hz`` is NaN at rest."""

    ticks: int
    overruns: int
    frequency_hz: float
    lookup_hz: float
    damping_ns_per_m: float
    stiffness_n_per_m: float
    contact_damping_ns_per_m: float
    force_n: float
    position_m: float
    velocity_m_per_s: float
    energy_j: float
    encoder_count: int
    table_id: int
    table_crc32: int
    coupling_id: str
    frames_good: int
    frames_bad: int
    bytes_lost: int
    saturated: int
    not_finite: int
    heartbeats_missed: int
    swaps: int
    stream_number: int
    stream_stale: int
    stream_missing: int
    stream_expired: int
    boot_id: int
    faults: int
    first_faults: int
    fault_tick: int
    mode: str
    streaming: bool
    contact: bool
    has_table: bool
    waits: bool
    limits_wait: bool
    lowered_force_n: float
    lowered_speed_m_per_s: float
    lowered_energy_j: float

    @classmethod
    def read(cls, payload: bytes) -> DeviceStatus:
        """Read the payload of the answer to STATUS."""
        values = _STATUS.unpack(payload)
        mode, streaming, contact, has_table, waits, limits_wait, _, _ = values[-11:-3]
        at = _COUPLING_ID
        coupling = _coupling(values[at], bool(has_table))
        flags = (MODES[mode], *map(bool, (streaming, contact, has_table, waits, limits_wait)))
        return cls(*[*values[:at], coupling, *values[at + 1 : -11], *flags, *map(_meant, values[-3:])])


def _coupling(number: int, has_table: bool) -> str:
    return f"{number:08x}" if has_table else ""


def _meant(value: float) -> float:
    """Return the decimal value meant: 1e-3 travels as 0.0010000000475."""
    return float(str(np.float32(value)))
