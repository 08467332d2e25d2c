"""What a device reports: its identity (HELLO) and its state (STATUS)."""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from avc_hardware.codegen.figures import ESTIMATOR_NUMBERS, NO_SLEW_PER_S, BoardLimits, RuntimeFigures

MODES = ("table", "ramp", "safe", "fault")
_HELLO = struct.Struct("<6I8s12s4I3fI11f4fHH")
_STATUS = struct.Struct("<5Ii9f4B3I3fI")


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
    kept_records: int
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
        limits = BoardLimits(*map(_meant, values[16:27]))
        hold_s, slew_per_s, guard, reach = map(_meant, values[27:31])
        figures = RuntimeFigures(
            sample_time_s=limits.sample_time_s,
            metres_per_count=limits.metres_per_count,
            estimator=ESTIMATOR_NUMBERS[values[31]],
            hold_s=hold_s,
            slew_per_s=slew_per_s if slew_per_s < NO_SLEW_PER_S / 2 else None,
            passive=bool(values[32]),
            guard_damping_ns_per_m=guard,
            hand_m_per_unit=reach,
        )
        build = values[6].rstrip(b"\0").decode("ascii", "replace")
        chip = values[7].hex() if any(values[7]) else ""
        coupling = f"{values[10]:08x}" if values[10] else ""
        head = [*values[:5], bool(values[5]), build, chip, *values[8:10], coupling, values[11]]
        return cls(*[*head, Limits(*map(_meant, values[12:15])), values[15], limits, figures])

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
    stream_expired: int
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
    faults: int
    first_faults: int
    fault_tick: int
    lowered: Limits
    limits_wait: bool

    @classmethod
    def read(cls, payload: bytes) -> DeviceStatus:
        """Read the payload of the answer to STATUS."""
        values = _STATUS.unpack(payload)
        flags = (MODES[values[15]], *map(bool, values[16:19]))
        lowered = Limits(*map(_meant, values[22:25]))
        return cls(*[*values[:15], *flags, *values[19:22], lowered, bool(values[25])])


def _meant(value: float) -> float:
    """Return the decimal value meant: 1e-3 travels as 0.0010000000475."""
    return float(str(np.float32(value)))
