"""Push of a coupling's table to the device, checked before and read back after."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from avc_casadi import InputError, LinkError
from avc_casadi._util.json_values import Document
from avc_casadi.claims.deployable import require_deployable
from avc_casadi.coupling import Coupling
from avc_hardware.codegen.figures import Config
from avc_hardware.codegen.firmware_fit import check_runs_on, config_for
from avc_hardware.codegen.tick_program import packed_config
from avc_hardware.emulator.board import emulated_board
from avc_hardware.link.connection import DEFAULT_BAUD, Connection, open_link
from avc_hardware.link.faults import DeviceFault
from avc_hardware.link.table import TableImage

if TYPE_CHECKING:
    from avc_casadi.model.gains import Gains
    from avc_hardware.codegen.figures import BoardLimits
    from avc_hardware.link.bytes import ByteLink
    from avc_hardware.link.device import Device


@dataclass(frozen=True)
class PushResult(Document):
    """Result of a push."""

    JSON_KEYS: ClassVar = (
        "port",
        "coupling_id",
        "table_id",
        "rows",
        "crc32",
        "attempts",
        "seconds",
        "rounding_max",
        "max_force_n",
        "notes",
        "build",
        "sample_time_s",
    )

    port: str
    coupling_id: str
    table_id: int
    rows: int
    crc32: int
    attempts: int
    seconds: float
    rounding_max: float
    max_force_n: float
    notes: tuple[str, ...]
    device: Device

    @property
    def build(self) -> str:
        """Name of the device's firmware."""
        return self.device.build

    @property
    def sample_time_s(self) -> float:
        """Sample time of the device."""
        return self.device.sample_time_s


def push(  # noqa: PLR0913 - options by name, of a public call
    coupling: Coupling,
    port: str | ByteLink,
    *,
    baud: int = DEFAULT_BAUD,
    safe: Gains | None = None,
    deadline_s: float | None = None,
    unsafe: bool = False,
    device_id: str | None = None,
    on_wait: Callable[[], None] | None = None,
) -> PushResult:
    """Send the table of a coupling, with its wall; the device swaps it in whole between two control ticks."""
    require_deployable(coupling, unsafe=unsafe)
    if safe is not None:
        _require_safe(coupling, safe, unsafe=unsafe)
    check_runs_on(coupling)  # a coupling that cannot run is refused before a port is opened
    link = open_link(port, baud=baud, board=partial(emulated_board, coupling))
    start = link.now_s()
    with Connection(link, baud=baud, deadline_s=deadline_s, on_wait=on_wait) as connection:
        chip = connection.device.unique_id
        if device_id is not None and device_id.lower() != chip:
            this = f"device {chip}" if chip else "a device without a serial number"
            raise LinkError(
                f"{link.name}: coupling not sent: this device is {this}, not {device_id}; see avc doctor --ports --ask"
            )
        return push_over(connection, coupling, safe=safe, start_s=start, unsafe=unsafe)


def push_over(
    connection: Connection,
    coupling: Coupling,
    *,
    safe: Gains | None = None,
    start_s: float | None = None,
    unsafe: bool = False,
) -> PushResult:
    """Push over an open connection; a force limit above the device's becomes the device's where unsafe."""
    start = connection.link.now_s() if start_s is None else start_s
    device = connection.device
    check_runs_on(coupling, device.figures, most_states=device.capacity_states, bound=device.bound)
    config = config_for(coupling, Config(device.limits, device.figures), bound=device.bound)
    table = replace(TableImage.of(coupling, safe=safe), config=packed_config(config))
    if unsafe and table.max_force_n > config.limits.max_force_n:
        table = replace(table, max_force_n=config.limits.max_force_n)
    _check_limits(table, config.limits, device.capacity_rows, connection.link.name)
    upload = connection.run(connection.session.push(table, device))
    device = upload.device
    return PushResult(
        port=connection.link.name,
        coupling_id=coupling.id,
        table_id=table.table_id,
        rows=len(table.rows),
        crc32=table.crc32,
        attempts=upload.attempts,
        seconds=connection.link.now_s() - start,
        rounding_max=table.rounding_max,
        max_force_n=min(table.max_force_n or device.max_force_n, device.lowered.force_n),
        notes=_notes(coupling, device),
        device=device,
    )


def _require_safe(coupling: Coupling, safe: Gains, *, unsafe: bool) -> None:
    """Check safe gains as the device runs them: alone, on the loop of the coupling's problem."""
    contact = safe.contact_damping_ns_per_m
    if contact:
        raise InputError.of(f"is {contact:g}; allowed: 0", key="safe.contact_damping_ns_per_m")
    if safe.damping_ns_per_m or safe.stiffness_n_per_m:
        require_deployable(Coupling.constant(coupling.problem, safe, "safe gains"), unsafe=unsafe)


def _notes(coupling: Coupling, device: Device) -> tuple[str, ...]:
    """Describe where the device differs from the one that the coupling was made for."""
    force, step = coupling.max_force_n, coupling.problem.device.encoder_resolution_m
    most, coarse = device.max_force_n, device.limits.metres_per_count
    tapped = 0.0 if coupling.trial is None else coupling.trial.largest_tap_force_n
    notes = []
    faults = DeviceFault(device.faults)
    if faults:
        notes.append(f"the device gives no force until its faults are cleared (avc device --clear): {faults.word}")
    if force is None and tapped > most:
        made = f"designed without a force limit, and a simulated tap needed {tapped:.3g}; set device.max_force_n"
        notes.append(f"the device limits the force at {most:g}, the coupling was {made} and recommend again")
    if force is not None and force > most * _ROUNDED:
        made = f"made for {force:g}; its certificate does not know the lower limit"
        notes.append(f"the device limits the force at {most:g}, the coupling was {made}")
    if device.lowered.force_n * _ROUNDED < min(most, force or most):
        then = "raise it after a successful first test: avc device --force-n F"
        notes.append(f"the device's force is limited to {device.lowered.force_n:g} at run time; {then}")
    if step and step * _ROUNDED < coarse:
        made = f"made for {step:g}, and not simulated with the coarser steps"
        notes.append(f"the device's encoder has steps of {coarse:g}, the coupling was {made}")
    return tuple(notes)


_ROUNDED = 1 + 1e-6
"""Factor within which limits that agree in single precision are equal."""
_SINGLE_ROUNDING = 1e-5
"""Share by which sample times that agree in single precision differ at most."""


def _check_limits(table: TableImage, device: BoardLimits, capacity_rows: int, port: str) -> None:
    """Refuse a table that the device would refuse, with every reason."""
    faults = []
    if not math.isclose(table.sample_time_s, device.sample_time_s, rel_tol=_SINGLE_ROUNDING):
        faults.append(
            f"the coupling is for a sample time of {table.sample_time_s:g} s, the device runs at "
            f"{device.sample_time_s:.6g} s; solve with device.sample_time_s = {device.sample_time_s:.6g}, or build "
            "firmware for the coupling's: avc firmware"
        )
    if len(table.rows) > capacity_rows:
        faults.append(
            f"the coupling has {len(table.rows)} rows, the device stores {capacity_rows}; make a coupling of "
            f"fewer rows (frequency.points = {capacity_rows}), because the certified table must run"
        )
    limits = (
        ("damping b", device.max_damping_ns_per_m, table.wall_damping_ns_per_m),
        ("stiffness k", device.max_stiffness_n_per_m, table.wall_stiffness_n_per_m),
        ("contact damping b_p", device.max_contact_damping_ns_per_m, 0.0),
    )
    for column, (name, most, wall) in enumerate(limits, start=1):
        largest = table.rows[:, column].max()
        if largest > np.float32(most):
            faults.append(f"{name} is {largest:.6g} and the device's limit is {most:.6g}; narrow [coupling]")
        if wall > most:
            faults.append(
                f"{name} of the wall is {wall:.6g} and the device's limit is {most:.6g}; soften [environment]"
            )
    if table.max_force_n > device.max_force_n * _ROUNDED:
        faults.append(
            f"the coupling was made for a force limit of {table.max_force_n:g}, the device gives "
            f"{device.max_force_n:g}; solve with device.max_force_n = {device.max_force_n:g}, or push with --unsafe"
        )
    if faults:
        raise LinkError(f"{port}: not sent: " + "; ".join(faults))
