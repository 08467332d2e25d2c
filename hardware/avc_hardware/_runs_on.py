"""Whether a coupling runs on the packaged firmware, on a certain device, and the emulated board that is made for it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi import LinkError, NotDeployableError, UnsupportedError
from avc_casadi.coupling import require_coupling
from avc_hardware._bench_plant import board_limits
from avc_hardware._emulator import EmulatedBoard
from avc_hardware._figures import RuntimeFigures
from avc_hardware._host import BoardLimits
from avc_hardware._table import FEEDBACK_STATES

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling
    from avc_casadi.model.problem import Problem
    from avc_hardware._device import Device
    from avc_hardware._table import TableImage

GUARD = "passivity-controller"
# A limit that travels in single precision is the same one.
_ROUNDED = 1 + 1e-6
_BUILD = "build it into firmware (avc firmware FILE --board B --built-in --out DIR), or export it (avc export)"


class FirmwareLacksError(NotDeployableError, UnsupportedError):
    """A coupling needs what the firmware on the device does not have: it may not go there (command line: exit code 1).

    Example:
        >>> try:
        ...     avc_hardware.check_runs_on(coupling)
        ... except avc.NotDeployableError as error:
        ...     print(error)
    """


def check_runs_on(coupling: Coupling, device: Device | None = None) -> None:
    """Refuse a coupling that needs what the firmware does not have.

    Args:
        coupling: what is to run.
        device: whose settings are compared too, as far as the coupling depends on them; None compares with none.

    Raises:
        FirmwareLacksError: names everything that the firmware lacks, and what to do.
        InputError: it is no coupling.
    """
    require_coupling(coupling)
    runtime = coupling.runtime
    if device is not None and device.built_in:
        raise FirmwareLacksError(
            f"{coupling.problem.name}: the device takes no coupling: coupling {device.coupling_id} is built into its "
            "firmware; flash firmware without one to push others (avc firmware DEVICE --board B --out DIR)"
        )
    lacks = []
    if runtime.observer_mass_kg is not None:
        lacks.append("it has no observer between encoder steps (runtime.observer_mass_kg)")
    lacks += _lacks_of_feedback(coupling, FEEDBACK_STATES if device is None else device.capacity_states)
    if runtime.guard not in {None, GUARD}:
        lacks.append(f"it has no guard {runtime.guard} (allowed: {GUARD}, or none)")
    if device is not None:
        lacks += _other_settings(coupling, device)
    if lacks:
        raise FirmwareLacksError(
            f"{coupling.problem.name}: the coupling does not run on this firmware: {'; '.join(lacks)}. "
            f"Take a coupling that it can run (of a method: avc solve P --method static-tuned --out FILE), or {_BUILD}"
        )


def _lacks_of_feedback(coupling: Coupling, most: int) -> list[str]:
    feedback = coupling.runtime.state_feedback
    if feedback is None:
        return []
    lacks = []
    if feedback.states > most:
        lacks.append(
            f"it holds {most} states of an observer, the coupling has {feedback.states} (runtime.state_feedback; "
            "design it with a simpler hand or device)"
        )
    if not coupling.table.constant:
        lacks.append("it feeds states back beside constant gains alone (runtime.state_feedback)")
    return lacks


def _other_settings(coupling: Coupling, device: Device) -> list[str]:
    wanted, has = figures_of(coupling), device.figures
    asked = []
    if not coupling.table.constant:
        asked += ["estimator", "hold_s", "slew_per_s", "passive", "hand_m_per_unit"]
    if coupling.runtime.guard is not None:
        asked.append("guard_damping_ns_per_m")
    return [
        f"its {name} is {getattr(has, name)}, the coupling's {getattr(wanted, name)}"
        for name in asked
        if not _same(getattr(wanted, name), getattr(has, name))
    ]


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=1e-6)
    return bool(one == other)


def check_limits(coupling: Coupling, table: TableImage, device: Device, port: str) -> None:
    """Refuse a table that the device would refuse, naming everything that is wrong with it.

    Raises:
        LinkError: sample time, rows, gains, wall or force limit outside what the device reports.
    """
    faults = []
    if not math.isclose(table.sample_time_s, device.sample_time_s, rel_tol=1e-5):
        faults.append(
            f"the coupling is for a sample time of {table.sample_time_s:g} s, the device runs at "
            f"{device.sample_time_s:.6g} s; solve with device.sample_time_s = {device.sample_time_s:.6g}, or build "
            "firmware for the coupling's: avc firmware"
        )
    if len(table.rows) > device.capacity_rows:
        faults.append(
            f"the coupling has {len(table.rows)} rows, the device holds {device.capacity_rows}; make a coupling for "
            "this capacity (avc_casadi.claims.thinning.reduce_rows) and certify that one: what runs is what was "
            "certified"
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
    faults += _wall_faults(coupling, device)
    if table.max_force_n > device.max_force_n * _ROUNDED:
        faults.append(
            f"the coupling was made for a force limit of {table.max_force_n:g} N, the device gives "
            f"{device.max_force_n:g} N; solve with device.max_force_n = {device.max_force_n:g}, or push with --unsafe"
        )
    if faults:
        raise LinkError(f"{port}: not sent: " + "; ".join(faults))


def _wall_faults(coupling: Coupling, device: Device) -> list[str]:
    wall = coupling.wall
    if not wall.damping_ns_per_m + wall.stiffness_n_per_m > 0:
        return ["the coupling has no wall; give environment.stiffness_n_per_m"]
    limits = (
        ("damping", wall.damping_ns_per_m, device.max_damping_ns_per_m, "N.s/m"),
        ("stiffness", wall.stiffness_n_per_m, device.max_stiffness_n_per_m, "N/m"),
    )
    return [
        f"the wall's {name} is {value:.6g} {unit}, the device's limit {most:.6g} {unit}; lower environment.{name}_*"
        for name, value, most, unit in limits
        if value > most
    ]


def figures_of(coupling: Coupling) -> RuntimeFigures:
    """Return the figures of a firmware for a coupling; where its device says nothing, those of the boards."""
    runtime, limits = coupling.runtime, limits_of(coupling.problem)
    reach = coupling.problem.device.metres_per_unit
    figures = RuntimeFigures(limits.sample_time_s, limits.metres_per_count, hand_m_per_unit=reach)
    if runtime.guard is not None:
        figures = replace(figures, guard_damping_ns_per_m=coupling.problem.device.damping_ns_per_m)
    if coupling.table.constant:
        return figures
    return replace(
        figures,
        estimator=runtime.estimator,
        hold_s=runtime.hold_s,
        slew_per_s=runtime.slew_per_s,
        passive=runtime.passive,
    )


def limits_of(problem: Problem) -> BoardLimits:
    """Return the limits of a board for a problem: its device's sample time, encoder and force."""
    return board_limits(problem.device)


def emulated_board(coupling: Coupling, **options: Any) -> EmulatedBoard:
    """Return a fresh emulated board with the sample time, encoder, force and settings of a coupling.

    Args:
        coupling: what will be pushed to it.
        options: of `EmulatedBoard`.

    Raises:
        FirmwareLacksError: the packaged image has no program for it.
        MissingExtraError: the emulator is not installed.
    """
    check_runs_on(coupling)
    return EmulatedBoard(limits=limits_of(coupling.problem), figures=figures_of(coupling), **options)
