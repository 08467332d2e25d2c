"""What a device reports: its identity (HELLO) and its state (STATUS)."""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from avc_casadi import LinkError
from avc_hardware.codegen.figures import ESTIMATOR_NUMBERS, RuntimeFigures

MODES = ("table", "ramp", "safe", "fault")
_COUPLING_ID = 14  # place in STATUS
_HELLO = struct.Struct("<HHHH8sII6fIIHH4fHHHHHHI8fI3f12s")
_STATUS = struct.Struct("<II9fi18I8B3f")


@dataclass(frozen=True)
class Device:
    """Answer to HELLO.

    Attributes:
        interface_version: of the messages' meaning; must equal this program's.
        capacity_rows: rows that a table may have.
        window_bytes: bytes that may be in transit unanswered.
        chunk_bytes: largest part of a table in one message.
        build: name of the firmware's sources.
        serial: number of the device, 0 where it has none.
        boot_id: changes with each start.
        sample_time_s: of the control loop.
        metres_per_count: of the encoder.
        max_force_n: limit of the output.
        max_damping_ns_per_m: limit of b.
        max_stiffness_n_per_m: limit of k.
        max_contact_damping_ns_per_m: limit of b_p.
        table_id: of the running table, 0 without one.
        table_crc32: of the running table.
        table_rows: of the running table.
        transfer_open: whether a host is sending a table.
        figures: of its control tick.
        capacity_states: largest number of observer states of a table.
        table_states: observer states of the running table.
        capacity_tones: sines that an excitation may have.
        kept_records: records of an excitation that wait for the host.
        coupling_id: of the running coupling, 8 hexadecimal digits; empty without one.
        wall_damping_ns_per_m: of the running wall; 0 without one.
        wall_stiffness_n_per_m: of the running wall.
        force_limit_n: in force with the running table.
        max_speed_m_per_s: above it a fault is latched; 0, here and below: not monitored.
        max_acceleration_m_per_s2: above it the encoder counts as having jumped.
        max_energy_j: largest net energy that a coupling may deliver within about a second.
        stuck_swing_n: oscillation of the force under which a working encoder moves.
        max_overruns: consecutive ticks that may be too long.
        faults: codes of `DeviceFault`.
        lowered_force_n: limit at run time, at most `max_force_n`.
        lowered_speed_m_per_s: the same of `max_speed_m_per_s`.
        lowered_energy_j: the same of `max_energy_j`.
        unique_id: unique number of the chip, hexadecimal; empty where it has none.
    """

    interface_version: int
    capacity_rows: int
    window_bytes: int
    chunk_bytes: int
    build: str
    serial: int
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

    @classmethod
    def read(cls, payload: bytes) -> Device:
        """Read the payload of the answer to HELLO."""
        values = _HELLO.unpack(payload)
        build = values[4].rstrip(b"\0").decode("ascii", "replace")
        meant = [_meant(value) for value in values[7:13]]
        hold_s, slew_per_s, guard, reach = map(_meant, values[17:21])
        figures = RuntimeFigures(
            sample_time_s=meant[0],
            metres_per_count=meant[1],
            estimator=ESTIMATOR_NUMBERS[values[21]],
            hold_s=hold_s,
            slew_per_s=slew_per_s or None,
            passive=bool(values[22]),
            guard_damping_ns_per_m=guard,
            hand_m_per_unit=reach,
        )
        running = (*values[13:16], bool(values[16]))
        coupling = _coupling(values[27], bool(values[15]))
        unique_id = values[40].hex() if any(values[40]) else ""
        wall, watched = map(_meant, values[28:31]), map(_meant, values[31:35])
        head = [*values[:4], build, *values[5:7], *meant, *running, figures, *values[23:27], coupling, *wall]
        return cls(*[*head, *watched, int(values[35]), values[36], *map(_meant, values[37:40]), unique_id])


def require_same(first: Device, now: Device) -> None:
    """Refuse another device than the first one, by the numbers of their chips; some chips have none.

    Raises:
        LinkError: the numbers differ.
    """
    if now.unique_id != first.unique_id:
        raise LinkError(
            f"another device answers than before, chip {now.unique_id or 'without a number'} in place of "
            f"{first.unique_id or 'one without'}; nothing was sent to it"
        )


@dataclass(frozen=True)
class DeviceStatus:
    """One STATUS sample; ``frequency_hz`` is NaN at rest.

    Attributes:
        ticks: control ticks since the start.
        overruns: ticks that came due before the previous one had ended.
        frequency_hz: estimate of the interaction frequency.
        lookup_hz: frequency of the table look-up: the estimate, held a while when lost, then falling to the lowest row.
        damping_ns_per_m: present b.
        stiffness_n_per_m: present k.
        contact_damping_ns_per_m: present b_p.
        force_n: last output, positive out of the wall.
        position_m: positive into the wall.
        velocity_m_per_s: backward difference.
        energy_j: delivered by the hand (positive) since the start: sum of the held force times the next displacement.
        encoder_count: raw position.
        table_id: of the running table.
        table_crc32: of the running table.
        coupling_id: of the running coupling, 8 hexadecimal digits; empty without one.
        frames_good: received.
        frames_bad: received with an error and dropped.
        bytes_lost: by the receiver.
        saturated: ticks at the force limit.
        not_finite: ticks whose force was NaN or infinite and was set to 0.
        heartbeats_missed: times that the host fell silent.
        swaps: accepted tables.
        stream_number: of the last accepted SET_GAINS.
        stream_stale: SET_GAINS refused as older than another.
        stream_missing: numbers never received.
        stream_expired: number of fallbacks to the table.
        boot_id: changes with each start.
        faults: codes of `DeviceFault`, all that are latched, and whether the host is silent.
        first_faults: codes that were latched first.
        fault_tick: tick of these.
        mode: table | ramp | safe | fault.
        streaming: whether streamed gains are active.
        contact: whether the device is in contact with the wall.
        has_table: whether there is a table.
        waits: whether another table waits for the device to be released.
        limits_wait: whether higher limits wait for its release.
        lowered_force_n: limit at run time.
        lowered_speed_m_per_s: limit at run time.
        lowered_energy_j: limit at run time.
    """

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
