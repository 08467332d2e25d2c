"""What a hand feels of a virtual tool: mass and drag in free motion, stiffness against a rigid object."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.claims.stability.tool_loop import required_tool
from avc_casadi.model.lifted_loop import LiftedLoop, ToolGains, clocks
from avc_casadi.model.virtual_tool import RIGID_N_PER_M, tool_states

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem
    from avc_casadi.model.virtual_tool import ToolState

FELT_HZ = (1.0, 10.0)
"""Frequencies at which it is told, in the band in which hands move."""


@dataclass(frozen=True)
class Felt:
    """Impedance at the handle at one frequency.

    Attributes:
        frequency_hz: of the motion.
        mass_kg: felt in free motion, Im(Z)/omega; None where nothing moves.
        drag_ns_per_m: felt in free motion, Re(Z), of device, tool and what the loop adds.
        free_error: distance from device and tool as one body, relative to its |Z|; None where nothing moves.
        stiffness_n_per_m: rendered against a rigid object, |F/x|.
        contact_error: distance from the device on a spring K, relative to its |Z|.
    """

    frequency_hz: float
    mass_kg: float | None
    drag_ns_per_m: float | None
    free_error: float | None
    stiffness_n_per_m: float
    contact_error: float


def felt_tool(problem: Problem, gains: ToolGains) -> list[Felt]:
    """Return what is felt at `FELT_HZ`, of the nominal device as a rigid body and the heaviest tool.

    Args:
        problem: with [simulation].
        gains: of the coupling.
    """
    below = [hz for hz in FELT_HZ if hz * problem.device.sample_time_s < 0.25]
    return [_felt(problem, gains, hz) for hz in below]


def _felt(problem: Problem, gains: ToolGains, frequency_hz: float) -> Felt:
    device, tool = problem.device, required_tool(problem)
    s = 2j * np.pi * frequency_hz
    alone = device.mass_kg * s + device.damping_ns_per_m
    free, rigid = tool_states(tool, 0.0)[-1], tool_states(tool, RIGID_N_PER_M)[-1]
    contact = alone + _coupling(problem, gains, rigid, frequency_hz)
    wanted = alone + gains.stiffness_n_per_m / s
    stiffness, error = float(abs(contact - alone) * abs(s)), float(abs(contact - wanted) / abs(wanted))
    if free.fixed:
        return Felt(frequency_hz, None, None, None, stiffness, error)
    moved = alone + _coupling(problem, gains, free, frequency_hz)
    body = alone + free.mass_kg * s + free.damping_ns_per_m
    return Felt(
        frequency_hz,
        float(moved.imag / abs(s)),
        float(moved.real),
        float(abs(moved - body) / abs(body)),
        stiffness,
        error,
    )


def _coupling(problem: Problem, gains: ToolGains, tool: ToolState, frequency_hz: float) -> complex:
    """Return the impedance that actuator and engine add, held and delayed."""
    device, engine = problem.device, required_tool(problem)
    t, s = device.sample_time_s, 2j * np.pi * frequency_hz
    clock = clocks(max(engine.step_s), t)[-1]
    asked = LiftedLoop.driven(t, clock, engine).force_per_metre(gains, tool, frequency_hz)
    hold = (1 - np.exp(-s * t)) / (s * t) * np.exp(-s * t * device.delay_samples)
    return complex(asked * hold / s)
