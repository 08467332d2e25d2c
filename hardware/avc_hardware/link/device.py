"""What a device reports: its identity (HELLO) and its state (STATUS)."""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from avc_hardware.codegen.figures import ESTIMATOR_NUMBERS, NO_SLEW_PER_S, BoardLimits, RuntimeFigures

MODES = ("table", "ramp", "safe", "fault")
_HELLO = struct.Struct("<9I8s12s4I3fI11f4fHH")
_STATUS = struct.Struct("<7Ii9f4B7I3f2I")
_COUPLING_ID = 23  # place in STATUS


@dataclass(frozen=True)
class Limits:
    """Limits at run time, never above those of the board."""

    force_n: float
    speed_m_per_s: float
    energy_j: float


@dataclass(frozen=True)
class Device:
    """Answer to HELLO."""

    interface_version: int
    boot_id: int
    capacity_rows: int
    capacity_states: int
    capacity_tones: int
    kept_records: int
    window_bytes: int
    chunk_bytes: int
    bound: bool
    build: str
    unique_id: str
    table_id: int
    table_crc32: int
    coupling_id: str
    faults: int
    lowered: Limits
    config_crc32: int
    limits: BoardLimits
    figures: RuntimeFigures

    @classmethod
    def read(cls, payload: bytes) -> Device:
        """Read the payload of the answer to HELLO."""
        values = _HELLO.unpack(payload)
        limits = BoardLimits(*map(_meant, values[19:30]))
        hold_s, slew_per_s, guard, reach = map(_meant, values[30:34])
        figures = RuntimeFigures(
            sample_time_s=limits.sample_time_s,
            metres_per_count=limits.metres_per_count,
            estimator=ESTIMATOR_NUMBERS[values[34]],
            hold_s=hold_s,
            slew_per_s=slew_per_s if slew_per_s < NO_SLEW_PER_S / 2 else None,
            passive=bool(values[35]),
            guard_damping_ns_per_m=guard,
            hand_m_per_unit=reach,
        )
        build = values[9].rstrip(b"\0").decode("ascii", "replace")
        chip = values[10].hex() if any(values[10]) else ""
        coupling = f"{values[13]:08x}" if values[13] else ""
        head = [*values[:8], bool(values[8]), build, chip, *values[11:13], coupling, values[14]]
        return cls(*[*head, Limits(*map(_meant, values[15:18])), values[18], limits, figures])

    @property
    def sample_time_s(self) -> float:
        """Time of a tick."""
        return self.limits.sample_time_s

    @property
    def max_force_n(self) -> float:
        """Full scale of its output."""
        return self.limits.max_force_n


@dataclass(frozen=True)
class DeviceStatus:
    """One STATUS sample; ``frequency_hz`` is NaN at rest."""

    ticks: int
    overruns: int
    saturated: int
    not_finite: int
    stream_expired: int
    heartbeats_missed: int
    swaps: int
    encoder_count: int
    position_m: float
    velocity_m_per_s: float
    frequency_hz: float
    lookup_hz: float
    damping_ns_per_m: float
    stiffness_n_per_m: float
    contact_damping_ns_per_m: float
    force_n: float
    energy_j: float
    mode: str
    streaming: bool
    contact: bool
    has_table: bool
    table_id: int
    table_crc32: int
    coupling_id: str
    boot_id: int
    faults: int
    first_faults: int
    fault_tick: int
    lowered: Limits
    waits: bool
    limits_wait: bool

    @classmethod
    def read(cls, payload: bytes) -> DeviceStatus:
        """Read the payload of the answer to STATUS."""
        values = _STATUS.unpack(payload)
        flags = (MODES[values[17]], *map(bool, values[18:21]))
        coupling = f"{values[_COUPLING_ID]:08x}" if values[20] else ""
        numbers = (*values[21:_COUPLING_ID], coupling, *values[_COUPLING_ID + 1 : 28])
        lowered = Limits(*map(_meant, values[28:31]))
        return cls(*[*values[:17], *flags, *numbers, lowered, *map(bool, values[31:])])


def _meant(value: float) -> float:
    """Return the decimal value meant: 1e-3 travels as 0.0010000000475."""
    return float(str(np.float32(value)))
