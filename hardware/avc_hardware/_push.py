"""Push: a whole table to the device, checked before and read back after."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from avc_casadi import LinkError
from avc_casadi.coupling import GainSchedule
from avc_hardware._bytes import ByteLink
from avc_hardware._connection import DEFAULT_BAUD, Connection, open_link
from avc_hardware._messages import Device
from avc_hardware._table import GainTable, TableSettings, gain_table


@dataclass(frozen=True)
class PushResult:
    """What a push came to.

    Attributes:
        port: as the user named it.
        table_id: name of the table, made from its content.
        rows: that the device now holds.
        crc32: of the table's bytes.
        readback_equal: whether the bytes read back are those sent.
        attempts: how often the transfer was begun.
        seconds: by the link's clock (virtual for the emulator), from opening the port to the end of the read-back.
        rounding_max: largest relative change of a gain by rounding to single precision.
        left_out: rows of the schedule without usable gains.
        reduced_from: usable rows before the cut to the device's capacity.
        reduction_error: largest relative error of a gain at the rows that were cut; 0 without a cut.
        device: what the device said of itself.
    """

    port: str
    table_id: int
    rows: int
    crc32: int
    readback_equal: bool
    attempts: int
    seconds: float
    rounding_max: float
    left_out: int
    reduced_from: int
    reduction_error: float
    device: Device

    def document(self) -> dict[str, object]:
        """Return the `push` document: JSON values only."""
        return {
            "port": self.port,
            "table_id": self.table_id,
            "rows": self.rows,
            "crc32": self.crc32,
            "readback_equal": self.readback_equal,
            "attempts": self.attempts,
            "seconds": self.seconds,
            "rounding_max": self.rounding_max,
            "left_out": self.left_out,
            "reduced_from": self.reduced_from,
            "reduction_error": self.reduction_error,
            "build": self.device.build,
            "sample_time_s": self.device.sample_time_s,
        }


def push(
    gains: GainSchedule,
    port: str | ByteLink,
    *,
    baud: int = DEFAULT_BAUD,
    settings: TableSettings | None = None,
    deadline_s: float | None = None,
    on_log: Callable[[str], None] | None = None,
) -> PushResult:
    """Send the usable rows of a schedule as one table; the device swaps it in whole between two control ticks.

    Args:
        gains: rows without usable gains are left out and counted.
        port: device path, pyserial URL, ``emulator``, or an open link.
        baud: rate of a serial port.
        settings: wall, safe gains and guard that travel with the rows.
        deadline_s: longest duration on the link's clock.
        on_log: takes the firmware's lines of text.

    Raises:
        InputError: no row can be sent.
        LinkError: no device, refused, or lost on the way; the device then runs its old table or the new one, whole.
        MissingExtraError: ``emulator`` without its extra.
    """
    gain_table(gains, settings=settings, sample_time_s=1.0)  # an unusable schedule is refused before a port is opened
    link = open_link(port, baud=baud) if isinstance(port, str) else port
    start = link.now_s()
    with Connection(link, baud=baud, deadline_s=deadline_s, on_log=on_log) as connection:
        return push_over(connection, gains, settings=settings, start_s=start)


def push_over(
    connection: Connection,
    gains: GainSchedule,
    *,
    settings: TableSettings | None = None,
    start_s: float | None = None,
) -> PushResult:
    """Do the same over an open connection."""
    start = connection.link.now_s() if start_s is None else start_s
    device = connection.device
    table = gain_table(gains, settings=settings, capacity_rows=device.capacity_rows, sample_time_s=device.sample_time_s)
    check_limits(table, device, connection.link.name)
    upload = connection.run(connection.session.push(table, device))
    return PushResult(
        port=connection.link.name,
        table_id=table.table_id,
        rows=len(table.rows),
        crc32=table.crc32,
        readback_equal=upload.image == table.image,
        attempts=upload.attempts,
        seconds=connection.link.now_s() - start,
        rounding_max=table.rounding_max,
        left_out=table.left_out,
        reduced_from=table.reduced_from,
        reduction_error=table.reduction_error,
        device=upload.device,
    )


def check_limits(table: GainTable, device: Device, port: str) -> None:
    """Refuse a table that the device would refuse, naming everything that is wrong with it.

    Raises:
        LinkError: sample time or gains outside what the device reports.
    """
    faults = []
    if not math.isclose(table.sample_time_s, device.sample_time_s, rel_tol=1e-5):
        faults.append(
            f"the gains are for a sample time of {table.sample_time_s:g} s, the device runs at "
            f"{device.sample_time_s:.6g} s; solve with device.sample_time_s = {device.sample_time_s:.6g}"
        )
    limits = (
        ("damping b", "N.s/m", device.max_damping_ns_per_m, "coupling.damping_ns_per_m"),
        ("stiffness k", "N/m", device.max_stiffness_n_per_m, "coupling.stiffness_n_per_m"),
        ("contact damping b_p", "N.s/m", device.max_contact_damping_ns_per_m, "coupling.contact_damping_ns_per_m"),
    )
    for column, (name, unit, most, key) in enumerate(limits, start=1):
        over = np.flatnonzero(table.rows[:, column] > np.float32(most))
        if len(over):
            worst = over[np.argmax(table.rows[over, column])]
            faults.append(
                f"{name} is {table.rows[worst, column]:.6g} {unit} at {table.rows[worst, 0]:.4g} Hz "
                f"({len(over)} of {len(table.rows)} rows above the device's {most:.6g} {unit}); narrow {key}"
            )
    if faults:
        raise LinkError(f"{port}: not sent: " + "; ".join(faults))
