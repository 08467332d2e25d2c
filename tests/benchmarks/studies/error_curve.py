"""Impedance error of gains and wall against frequency, relative to the sampled and to the physical wall."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi.claims.passivity.worst_port import impedance_at_handle
from avc_casadi.model.gains import Gains, GainTable
from avc_casadi.paper.equations import SampleAngle, environment_impedance, perceived_impedance
from avc_casadi.paper.loop import loop_at
from avc_casadi.paper.numbers import NUMPY
from avc_casadi.paper.rendered import perceived_impedance_of

if TYPE_CHECKING:
    from avc_casadi.model.problem import Impedance, Problem
    from avc_casadi.model.schedule import GainSchedule

TOLERANCE = 0.10
GRID_HZ = np.geomspace(0.5, 200.0, 241)
# A rigid coupling in numbers, far above any wall's spring or damper.
_RIGID = 1e15


@dataclass(frozen=True)
class ErrorCurve:
    """Relative complex impedance error against frequency, each of shape (n,).

    Attributes:
        frequency_hz: interaction frequency.
        sampled: |Z_h - Z_h_ds|/|Z_h_ds| with the sampled wall on the same device as reference: its negative
            damping k_e T/2 and the compliance of the structure count as wanted.
        physical: the same with the continuous-time wall, m s + b_d + b_e + k_e/s at s = j omega.
    """

    frequency_hz: FloatArray
    sampled: FloatArray
    physical: FloatArray

    def within_hz(self, errors: FloatArray, tolerance: float = TOLERANCE) -> float:
        """Return the highest frequency up to which an error stays within the tolerance; 0 where it never does."""
        beyond = np.flatnonzero(~(errors <= tolerance))
        if len(beyond) == 0:
            return float(self.frequency_hz[-1])
        return float(self.frequency_hz[beyond[0] - 1]) if beyond[0] else 0.0

    def at(self, errors: FloatArray, frequency_hz: float) -> float:
        """Return the error at one frequency."""
        return float(np.interp(frequency_hz, self.frequency_hz, errors))


def error_curve(
    problem: Problem,
    gains: Gains | GainTable | GainSchedule,
    frequency_hz: FloatArray = GRID_HZ,
    wall: Impedance | None = None,
) -> ErrorCurve:
    """Return the impedance error of gains and wall at the handle of the declared device.

    Delay, amplifier and structure are included; the force is that at the frequency of the motion.

    Args:
        problem: device and the wall that is rendered; its bounds do not matter.
        gains: constant gains, or a table, which is read at each frequency.
        frequency_hz: of the motion; beyond its end a table is read at its end.
        wall: the reference wall; None is the one that is rendered.
    """
    wall, device, s = wall or problem.environment, problem.device, 2j * np.pi * frequency_hz
    stated = problem.changed(stability={"model": "sampled-data"})
    loop, angle = loop_at(stated, frequency_hz), SampleAngle.at(NUMPY, frequency_hz, device.sample_time_s)
    behind = environment_impedance(angle, "sampled-data", wall.damping_ns_per_m, wall.stiffness_n_per_m)
    felt = _at_handle(stated, perceived_impedance_of(stated, frequency_hz, _rows(gains, frequency_hz)), frequency_hz)
    goal = _at_handle(stated, perceived_impedance(loop.device, loop.hold, behind), frequency_hz)
    physical = device.mass_kg * s + device.damping_ns_per_m + wall.damping_ns_per_m + wall.stiffness_n_per_m / s
    return ErrorCurve(frequency_hz, _relative(felt, goal), _relative(felt, physical))


def _at_handle(stated: Problem, perceived: ComplexArray, frequency_hz: FloatArray) -> ComplexArray:
    """Return the impedance at the handle: the model's with the port's delay, amplifier and structure."""
    loop, device = loop_at(stated, frequency_hz), stated.device
    on_time = np.exp(2j * np.pi * frequency_hz * device.delay_samples * device.sample_time_s)
    return impedance_at_handle(device, (perceived - loop.device) * on_time, frequency_hz)


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
