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
        interface_version, boot_id, capacity_rows, capacity_states, kept_records, bound = values[:6]
        build, chip = values[6:8]
        table_id, table_crc32, coupling_id, faults = values[8:12]
        lowered = Limits(*map(_meant, values[12:15]))
        config_crc32 = values[15]
        limits = BoardLimits(*map(_meant, values[16:27]))
        hold_s, slew_per_s, guard, reach = map(_meant, values[27:31])
        estimator, passive = values[31:33]
        figures = RuntimeFigures(
            sample_time_s=limits.sample_time_s,
            metres_per_count=limits.metres_per_count,
            estimator=ESTIMATOR_NUMBERS[estimator],
            hold_s=hold_s,
            slew_per_s=slew_per_s if slew_per_s < NO_SLEW_PER_S / 2 else None,
            passive=bool(passive),
            guard_damping_ns_per_m=guard,
            hand_m_per_unit=reach,
        )
        return cls(
            interface_version=interface_version,
            boot_id=boot_id,
            capacity_rows=capacity_rows,
            capacity_states=capacity_states,
            kept_records=kept_records,
            bound=bool(bound),
            build=build.rstrip(b"\0").decode("ascii", "replace"),
            unique_id=chip.hex() if any(chip) else "",
            table_id=table_id,
            table_crc32=table_crc32,
            coupling_id=f"{coupling_id:08x}" if coupling_id else "",
            faults=faults,
            lowered=lowered,
            config_crc32=config_crc32,
            limits=limits,
            figures=figures,
        )

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
