"""The gains of the coupling in a scene: from a table at one interaction frequency, from numbers, or none."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._errors import InputError
from avc_casadi.coupling._interpolation import interpolate

if TYPE_CHECKING:
    from avc_casadi.coupling._schedule import GainSchedule
    from avc_casadi.problem import Device, Problem


@dataclass(frozen=True)
class Gains:
    """Constant gains of the coupling; an infinite damping or stiffness joins device and environment rigidly.

    Attributes:
        damping_ns_per_m: b.
        stiffness_n_per_m: k.
        contact_damping_ns_per_m: b_p of the damped structure.
    """

    damping_ns_per_m: float
    stiffness_n_per_m: float
    contact_damping_ns_per_m: float = 0.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not value >= 0 or (name == "contact_damping_ns_per_m" and math.isinf(value)):
                raise InputError.of(f"is {value}; allowed: 0 or more", file="gains", key=name)

    @property
    def rigid(self) -> bool:
        """Whether device and environment are joined rigidly."""
        return math.isinf(self.damping_ns_per_m) or math.isinf(self.stiffness_n_per_m)


NO_COUPLING = Gains(math.inf, math.inf)
_NEAR_RIGID_N_PER_M = 1e8


def near_rigid_n_per_m(device: Device) -> float:
    """Return a spring that no hand tells from a rigid joint, and that a device still holds in single precision."""
    return _NEAR_RIGID_N_PER_M * device.metres_per_unit**2


def spring_before(problem: Problem, felt_n_per_m: float) -> float:
    """Return the spring, N/m, with which a wall feels so stiff at rest; nearly rigid where it is no stiffer itself.

    Args:
        problem: wall and device.
        felt_n_per_m: stiffness of wall and spring in series.
    """
    wall, rigid = problem.environment.stiffness_n_per_m, near_rigid_n_per_m(problem.device)
    if felt_n_per_m >= wall:
        return rigid
    return min(felt_n_per_m * wall / (wall - felt_n_per_m), rigid)


def without_start(schedule: GainSchedule) -> str:
    """Say that a schedule has no gains at its lowest frequency, where a hand at rest begins; empty where it has."""
    row = int(schedule.frequency_hz.argmin())
    if schedule.status[row].has_gains:
        return ""
    why = schedule.reason[row].rstrip(".")
    return (
        f"no gains at {schedule.frequency_hz[row]:g} Hz, where a hand at rest begins ({schedule.status[row]}"
        f"{f': {why}' if why else ''}). Choose another method, or gains that hold at the lowest frequency."
    )


def gains_at(schedule: GainSchedule, frequency_hz: float | None = None) -> Gains:
    """Take the gains of a table at one interaction frequency.

    Between two rows they are linear in the logarithm of frequency, as on the device.

    Args:
        schedule: a gain table.
        frequency_hz: interaction frequency; None is the table's lowest, that of a hand at rest.

    Raises:
        InputError: outside the table, or a row without gains.
    """
    grid = schedule.frequency_hz
    frequency = float(grid.min()) if frequency_hz is None else frequency_hz
    if not grid.min() <= frequency <= grid.max():
        raise InputError.of(
            f"is {frequency:g} Hz; allowed: {grid.min():g} to {grid.max():g} Hz, the frequencies of the gain table",
            file=schedule.problem,
            key="frequency_hz",
        )
    if frequency == grid.min() and without_start(schedule):
        raise InputError.of(without_start(schedule), file=schedule.problem, key=schedule.method)
    above = int(np.searchsorted(grid, frequency))
    rows = (above,) if grid[above] == frequency else (above - 1, above)
    for row in rows:
        if not schedule.usable[row]:
            raise InputError.of(
                f"has no gains at {grid[row]:g} Hz ({schedule.status[row]}): {schedule.reason[row]} "
                "Choose another method or another interaction frequency",
                file=schedule.problem,
                key=schedule.method,
            )
    table = np.stack(
        [grid, schedule.damping_ns_per_m, schedule.stiffness_n_per_m, schedule.contact_damping_ns_per_m], axis=1
    )[schedule.usable]
    return Gains(*interpolate(table[np.argsort(table[:, 0], kind="stable")], frequency).tolist())
