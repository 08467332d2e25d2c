"""The perceived impedance of gains, with observer and state feedback if any."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.model.gains import GainSchedule
from avc_casadi.paper.equations import (
    SampleAngle,
    backward_difference,
    coupling_impedance,
    environment_impedance,
    perceived_impedance,
    series,
)
from avc_casadi.paper.loop import loop_at
from avc_casadi.paper.numbers import NUMPY

if TYPE_CHECKING:
    from avc_casadi._util.arrays import ComplexArray, FloatArray
    from avc_casadi.model.gains import Status
    from avc_casadi.model.problem import Problem
    from avc_casadi.model.runtime import StateFeedback


def perceived_impedance_of(
    problem: Problem,
    frequency_hz: FloatArray,
    gains: tuple[FloatArray, FloatArray, FloatArray],
    law: StateFeedback | None = None,
) -> ComplexArray:
    """Return Z_h_avc at each frequency, N.s/m, shape (n,)."""
    loop, (b, k, contact) = loop_at(problem, frequency_hz), gains
    if law is None:
        return np.asarray(loop.perceived(b, k, contact))
    angle = SampleAngle.at(NUMPY, frequency_hz, problem.device.sample_time_s)
    # The law runs on a device: to it the wall is a force over position, in any model of the problem.
    wall, coupling = problem.environment, coupling_impedance(angle, b, k)
    behind = environment_impedance(angle, "sampled-data", wall.damping_ns_per_m, wall.stiffness_n_per_m)
    stiffness = (contact + series(coupling, behind, numbers=NUMPY)) * backward_difference(angle)
    # The impedance of a 1 N/m spring converts force over position to force over velocity, in the problem's model.
    unit = environment_impedance(angle, problem.stability.model, 0.0, 1.0)
    force = force_behind(law, stiffness, np.exp(2j * np.pi * angle.turns))
    return np.asarray(perceived_impedance(loop.device, loop.hold, force * unit))


def force_behind(law: StateFeedback, stiffness_n_per_m: ComplexArray, z: ComplexArray) -> ComplexArray:
    """Return force over the measured position at each frequency, N/m, shape (n,), at a dead-zone gain of 1."""
    gain, weight = np.array(law.innovation), np.array(law.feedback)
    closed = np.array(law.state) + stiffness_n_per_m[:, None, None] * np.outer(law.force_m_per_n, weight)
    pencil = z[:, None, None] * np.eye(law.states) - closed
    believed = np.linalg.solve(pencil, closed @ gain[:, None])[..., 0]
    return np.asarray(stiffness_n_per_m * ((believed + gain) @ weight) / (1 + believed[:, law.measures]))


def gain_schedule(
    problem: Problem,
    method: str,
    gains: tuple[FloatArray, FloatArray, FloatArray],
    status: tuple[Status, ...],
    *,
    solver: str | None = None,
    reason: tuple[str, ...] | None = None,
    requested: tuple[FloatArray, FloatArray] | None = None,
    requested_contact: FloatArray | None = None,
    impedance: ComplexArray | None = None,
    frequency_hz: FloatArray | None = None,
    build_seconds: float = 0.0,
    solve_seconds: float = 0.0,
    notes: tuple[str, ...] = (),
    state_feedback: StateFeedback | None = None,
) -> GainSchedule:
    """Return the schedule of gains (b, k, b_p); one code recomputes the impedances of every method."""
    frequency = problem.frequencies_hz() if frequency_hz is None else frequency_hz
    loop = loop_at(problem, frequency)
    usable = np.array([item.has_gains for item in status], dtype=bool)
    b, k, bp = (np.where(usable, np.asarray(gain, dtype=np.float64), np.nan) for gain in gains)
    perceived = np.full(frequency.shape, np.nan, dtype=np.complex128)
    if usable.any():
        perceived[usable] = perceived_impedance_of(
            problem, frequency[usable], (b[usable], k[usable], bp[usable]), state_feedback
        )
    return GainSchedule(
        problem=problem.name,
        method=method,
        solver=solver,
        structure=problem.coupling.structure,
        model=problem.stability.model,
        sample_time_s=problem.device.sample_time_s,
        frequency_hz=frequency,
        damping_ns_per_m=b,
        stiffness_n_per_m=k,
        contact_damping_ns_per_m=bp,
        impedance=perceived if impedance is None else impedance,
        target=np.asarray(loop.target),
        stated=problem,
        status=status,
        reason=reason or ("",) * len(status),
        requested_damping_ns_per_m=b if requested is None else requested[0],
        requested_stiffness_n_per_m=k if requested is None else requested[1],
        requested_contact_damping_ns_per_m=bp if requested_contact is None else requested_contact,
        build_seconds=build_seconds,
        solve_seconds=solve_seconds,
        notes=notes,
        state_feedback=state_feedback,
    )
