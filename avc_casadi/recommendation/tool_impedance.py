"""Rendered impedance of a virtual tool or a follower: mass and drag in free motion, stiffness in rigid contact."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from avc_casadi.loops.engine import Engine, clocks, required_tool
from avc_casadi.loops.follower import Link, Touch, link_clocks, required_follower
from avc_casadi.loops.loop import Body
from avc_casadi.model.device import DeviceRange
from avc_casadi.model.ends import RIGID_N_PER_M, ToolGains, tool_states
from avc_casadi.model.hands import Hand
from avc_casadi.model.plant import sampled_plant

if TYPE_CHECKING:
    from avc_casadi._util.units import Units
    from avc_casadi.model.device import Device
    from avc_casadi.model.problem import Problem

REPORTED_HZ = (1.0, 10.0)
"""Frequencies reported, in the band in which hands move."""
_BAND_HZ = tuple(np.geomspace(0.3, 100.0, 80).tolist())


@dataclass(frozen=True)
class Felt:
    """Impedance at the handle at one frequency.

    Attributes:
        frequency_hz: of the motion.
        mass_kg: rendered in free motion, Im(Z)/omega; None where nothing moves.
        drag_ns_per_m: rendered in free motion, Re(Z), of device, tool and loop.
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


@dataclass(frozen=True)
class RenderedBand:
    """Rendered and wanted impedance over a band of frequencies.

    Attributes:
        problem: name of the problem.
        felt: rendered impedance by frequency, ascending.
        mass_kg: wanted in free motion: of the device and the remote mass, as one body.
        damping_ns_per_m: of both.
        stiffness_n_per_m: wanted on a rigid object: K.
        units: of the device.
    """

    problem: str
    felt: tuple[Felt, ...]
    mass_kg: float
    damping_ns_per_m: float
    stiffness_n_per_m: float
    units: Units


def rendered_band(problem: Problem, gains: ToolGains) -> RenderedBand:
    """Return the rendered impedance of the remote end over the band of hand motion and perception."""
    device = problem.device
    if problem.follower is not None:
        felt, other = rendered_follower, problem.follower.at_leader()
        far = other.mass_kg, other.damping_ns_per_m
    else:
        felt, tool = rendered_tool, tool_states(required_tool(problem), 0.0)[-1]
        far = (0.0, 0.0) if tool.fixed else (tool.mass_kg, tool.damping_ns_per_m)
    found = tuple(felt(problem, gains, _BAND_HZ))
    mass, damping = device.mass_kg + far[0], device.damping_ns_per_m + far[1]
    return RenderedBand(problem.name, found, mass, damping, gains.stiffness_n_per_m, problem.units)


def rendered_tool(problem: Problem, gains: ToolGains, frequencies_hz: Sequence[float] = REPORTED_HZ) -> list[Felt]:
    """Return the rendered impedance of the heaviest tool, with the nominal device as a rigid body."""
    device, engine = problem.device, required_tool(problem)
    free, rigid = tool_states(engine, 0.0)[-1], tool_states(engine, RIGID_N_PER_M)[-1]
    t = device.sample_time_s
    clock = clocks(max(engine.step_s), t)[-1]

    def at(frequency_hz: float) -> Felt:
        moved, stopped = (
            Engine(Body.driven(t), clock, engine, [one]).force_per_metre(gains, frequency_hz) for one in (free, rigid)
        )
        far = free.mass_kg, free.damping_ns_per_m
        return _felt(device, gains, frequency_hz, far, None if free.fixed else moved, stopped)

    return [at(hz) for hz in _heard(device, frequencies_hz)]


def rendered_follower(problem: Problem, gains: ToolGains, frequencies_hz: Sequence[float] = REPORTED_HZ) -> list[Felt]:
    """Return the rendered impedance of the follower, with both nominal devices as rigid bodies."""
    leader, follower = problem.device, required_follower(problem)
    other = follower.at_leader()
    none = np.zeros(2)
    touched = sampled_plant(other.model_copy(update={"range": DeviceRange()}), Hand(none, none, none))
    clock = link_clocks(leader.sample_time_s, other.sample_time_s, *follower.delays_s[-1])[-1]
    driven, touch = Body.driven(leader.sample_time_s), Touch.of(touched, np.array([0.0, np.inf]), none)
    ends = [Link(driven, touch.axes(place), clock, follower) for place in (0, 1)]

    def at(frequency_hz: float) -> Felt:
        free, rigid = (one.force_per_metre(gains, frequency_hz) for one in ends)
        return _felt(leader, gains, frequency_hz, (other.mass_kg, other.damping_ns_per_m), free, rigid)

    return [at(hz) for hz in _heard(leader, frequencies_hz)]


def _heard(device: Device, frequencies_hz: Sequence[float]) -> list[float]:
    return [hz for hz in frequencies_hz if hz * device.sample_time_s < 0.25]


def _felt(
    device: Device,
    gains: ToolGains,
    frequency_hz: float,
    far: tuple[float, float],
    free: complex | None,
    rigid: complex,
) -> Felt:
    """Return the impedance rendered by the commanded forces in free motion and in rigid contact."""
    t, s = device.sample_time_s, 2j * np.pi * frequency_hz
    hold = (1 - np.exp(-s * t)) / (s * t) * np.exp(-s * t * device.delay_samples) / s
    alone = device.mass_kg * s + device.damping_ns_per_m
    contact, wanted = alone + rigid * hold, alone + gains.stiffness_n_per_m / s
    stiffness, error = float(abs((contact - alone) * s)), float(abs(contact - wanted) / abs(wanted))
    if free is None:
        return Felt(frequency_hz, None, None, None, stiffness, error)
    moved, body = alone + free * hold, alone + far[0] * s + far[1]
    mass, drag = float(moved.imag / abs(s)), float(moved.real)
    return Felt(frequency_hz, mass, drag, float(abs(moved - body) / abs(body)), stiffness, error)
