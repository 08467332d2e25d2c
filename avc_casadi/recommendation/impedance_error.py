"""How far a coupling feels like the wall, against frequency: the complex error, by two references."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi.claims.passivity.worst_port import impedance_at_handle
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import Gains, GainTable
from avc_casadi.paper.equations import SampleAngle, environment_impedance, perceived_impedance
from avc_casadi.paper.loop import loop_at
from avc_casadi.paper.numbers import NUMPY
from avc_casadi.paper.rendered import felt_impedance

if TYPE_CHECKING:
    from avc_casadi.model.problem import Impedance, Problem
    from avc_casadi.model.schedule import GainSchedule


TOLERANCE = 0.10
GRID_HZ = np.geomspace(0.5, 200.0, 241)
# A rigid coupling as numbers: no spring or damper of a wall comes near it.
_RIGID = 1e15


@dataclass(frozen=True)
class ErrorCurve:
    """Complex error against frequency, each of shape (n,).

    Attributes:
        frequency_hz: interaction frequency.
        sampled: |Z_h - Z_h_ds|/|Z_h_ds| with the sampled wall itself, on the same device, for the goal: counts its
            negative damping k_e T/2 as part of what should be felt, and what the structure gives way.
        physical: the same with the wall that does not know of samples, m s + b_d + b_e + k_e/s at s = j omega.
    """

    frequency_hz: FloatArray
    sampled: FloatArray
    physical: FloatArray

    def within_hz(self, errors: FloatArray, tolerance: float = TOLERANCE) -> float:
        """Highest frequency up to which an error stays within the tolerance; 0 where it never does."""
        beyond = np.flatnonzero(~(errors <= tolerance))
        if len(beyond) == 0:
            return float(self.frequency_hz[-1])
        return float(self.frequency_hz[beyond[0] - 1]) if beyond[0] else 0.0

    def at(self, errors: FloatArray, frequency_hz: float) -> float:
        """Error at one frequency."""
        return float(np.interp(frequency_hz, self.frequency_hz, errors))


def error_curve(
    problem: Problem,
    gains: Gains | GainTable | GainSchedule | Coupling,
    frequency_hz: FloatArray = GRID_HZ,
    wall: Impedance | None = None,
) -> ErrorCurve:
    """Evaluate the complex error of gains before a wall, at the handle of the device as declared.

    Delay, amplifier and structure are counted; of a motion at one frequency the force at that frequency.

    Args:
        problem: device and the wall that is rendered; its bounds do not matter.
        gains: constant gains, or a table, which is read at each frequency; or a coupling, with its state feedback.
        frequency_hz: where; a table is read at its end beyond it.
        wall: the wall that should be felt; None is the one that is rendered.
    """
    wall, device, s = wall or problem.environment, problem.device, 2j * np.pi * frequency_hz
    felt, goal = _at_handle(problem, gains, frequency_hz, wall)
    physical = device.mass_kg * s + device.damping_ns_per_m + wall.damping_ns_per_m + wall.stiffness_n_per_m / s
    return ErrorCurve(frequency_hz, _relative(felt, goal), _relative(felt, physical))


def rendered_stiffness_n_per_m(
    problem: Problem, gains: Gains | GainTable | GainSchedule | Coupling, frequency_hz: FloatArray
) -> FloatArray:
    """Return |Z_h - Z_d| omega of what is rendered at the handle, shape (n,): of a wall without damper its stiffness.

    Args:
        problem: device and the wall that is rendered.
        gains: as for `error_curve`.
        frequency_hz: where.
    """
    device, s = problem.device, 2j * np.pi * frequency_hz
    felt, _ = _at_handle(problem, gains, frequency_hz, problem.environment)
    return np.abs((felt - device.mass_kg * s - device.damping_ns_per_m) * s)


def _at_handle(
    problem: Problem,
    gains: Gains | GainTable | GainSchedule | Coupling,
    frequency_hz: FloatArray,
    wall: Impedance,
) -> tuple[ComplexArray, ComplexArray]:
    """Return the impedance that is felt, and that of the sampled wall itself."""
    stated = problem.changed(stability={"model": "sampled-data"})
    loop, device = loop_at(stated, frequency_hz), problem.device
    law = gains.runtime.state_feedback if isinstance(gains, Coupling) else None
    rows = _rows(gains.table if isinstance(gains, Coupling) else gains, frequency_hz)
    angle = SampleAngle.at(NUMPY, frequency_hz, device.sample_time_s)
    sampled = perceived_impedance(
        loop.device,
        loop.hold,
        environment_impedance(angle, "sampled-data", wall.damping_ns_per_m, wall.stiffness_n_per_m),
    )
    on_time = np.exp(2j * np.pi * frequency_hz * device.delay_samples * device.sample_time_s)
    felt, goal = (
        impedance_at_handle(device, (np.asarray(each) - loop.device) * on_time, frequency_hz)
        for each in (felt_impedance(stated, frequency_hz, rows, law), sampled)
    )
    return felt, goal


def _rows(
    gains: Gains | GainTable | GainSchedule, frequency_hz: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    if isinstance(gains, Gains):
        b, k, b_p = (np.full(len(frequency_hz), value) for value in vars(gains).values())
        return np.where(np.isinf(b), 0.0, b), np.where(np.isinf(k), _RIGID, k), b_p
    table = gains if isinstance(gains, GainTable) else GainTable.of(gains)
    b, k, b_p = table(frequency_hz)
    return b, k, b_p


def _relative(felt: ComplexArray, wanted: ComplexArray) -> FloatArray:
    return np.asarray(np.abs(felt - wanted) / np.abs(wanted))
