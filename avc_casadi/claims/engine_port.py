r"""The port between a physics engine and a coupling, once a step: its passivity, and so stability with passive engines.

Every T_s = N T the engine gives the tool a velocity v and x(n) = x(n-1) + T_s v(n); the map from v to the force is

    G(z) = z^-a K X + z^-c B - [K B] C (z I - A_N)^-1 B_N z^-q [X 1]',    X = T_s z/(z - 1)

A_N, B_N are N samples of the device with the tool's state held, C reads the position and velocity that the engine has
of it (the newest, or those of a sample before), q is the age in steps of the tool's state at the device, a and c those
of its force on the tool. Of a held force F_e, L being the loop from it back to itself, G(z) = z^-a K X + z^-c B
+ L/(1 - L) z^-e (K X + B). With G positive real the loop with any passive engine is stable (Brown and Colgate 1997);
an explicit mass is not passive.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import singledispatch
from typing import Any

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi._util.json_values import plain
from avc_casadi._util.page import Worded, worded
from avc_casadi.claims.levels import ideal
from avc_casadi.claims.llewellyn import llewellyn_margin
from avc_casadi.loops.engine import EngineLoop, StepTiming, clocks
from avc_casadi.loops.loop import Body
from avc_casadi.loops.loop_family import TOLERANCE
from avc_casadi.loops.plant_family import PlantFamily
from avc_casadi.loops.wall import SampledLoop
from avc_casadi.model.corners import LINEAR_KEYS, device_corners
from avc_casadi.model.device import Device
from avc_casadi.model.ends import End, Simulation, ToolGains, ToolState
from avc_casadi.model.plant import SampledPlant
from avc_casadi.model.problem import Hands, Problem

# Angles per step: evenly spaced, a quarter as many spaced logarithmically from the smallest on, up to where these meet.
_ANGLES = 400
_SMALLEST_ANGLE = 1e-5
_MEETING_ANGLE = 0.1
# Refinements about the lowest angle, and angles of each.
_REFINEMENTS = 3
_ANGLES_OF_REFINEMENT = 41
# An engine's step of up to so many samples of the device is one sample: each sample is a step.
_ONE_SAMPLE = 1.5
# Rounding error of a real part, as a share of the largest term: the spring's is K T_s/angle.
_TOLERANCE = 1e-9


@dataclass(frozen=True)
class EnginePort:
    """Passivity of a coupling at the engine's port.

    Attributes:
        passive: whether Re G >= 0 at every angle, with every corner hand and released, at every corner of the device.
        margin_ns_per_m: the lowest Re G, N.s/m.
        frequency_hz: its frequency.
        hand: the hand with it.
        step_s: the engine's step with it.
        any_hand: whether it holds with any passive hand; None where that is not known.
        any_hand_margin_ns_per_m: Llewellyn's margin, N.s/m; None where it is not known.
        engine_is_implicit: whether the engine solves its tool together with the coupling's force.
    """

    passive: bool
    margin_ns_per_m: float
    frequency_hz: float
    hand: dict[str, float]
    step_s: float
    any_hand: bool | None
    any_hand_margin_ns_per_m: float | None
    engine_is_implicit: bool


@dataclass(frozen=True)
class PortDelays:
    """Ages, in steps, of the velocity set by the engine where it is used.

    Attributes:
        spring: a, in the force of the spring on the tool.
        damper: c, in the force of the damper on the tool.
        state: q, in the tool's state at the device.
        force: e, in the loop of a held force.
    """

    spring: int
    damper: int
    state: int
    force: int

    @classmethod
    def of(cls, tool: Simulation) -> PortDelays:
        """Return the ages of an exchange, steps; v(n) is the velocity that is solved with the force of step n."""
        # An implicit engine uses the state that it solves for, so that on-time sends the previous one. An explicit one
        # uses and sends the state at the beginning of its step; the new one is ahead.
        implicit = tool.integrator == "implicit"
        solves = implicit or tool.integrator == "implicit-damping"
        solves_damping_alone = solves and not implicit
        if tool.exchange == "held-force":
            return cls(spring=int(solves_damping_alone), damper=0, state=tool.queued, force=int(solves))
        if tool.exchange == "ahead":
            return cls(spring=int(not implicit), damper=int(not solves), state=tool.queued, force=int(solves))
        return cls(spring=int(solves_damping_alone), damper=0, state=tool.queued + int(solves), force=int(solves))


@dataclass(frozen=True)
class _Lowest:
    """The lowest Re G, N.s/m, its angle per step and the row of device and hand."""

    real_ns_per_m: float
    angle: float
    row: int


def engine_port(device: Device, hands: Hands, tool: Simulation, gains: ToolGains) -> EnginePort:
    """Return the least Re G of a coupling at the engine's port over frequencies, hands and devices, N.s/m, and where.

    G is force over velocity at the tool, whose mass and contacts do not enter; passive is Re G >= 0.

    Raises:
        UnsupportedError: an exact integrator, several substeps, or steps that are no whole samples.
    """
    t = device.sample_time_s
    family = PlantFamily.between(device, hands)
    if tool.integrator == "exact" or tool.substeps > 1:
        why = "passivity at the engine's port is not computed for exact integration or for several substeps"
        raise UnsupportedError(f"{why}; the claim of stability is separate", key="simulation.integrator")
    plant = family.sampled
    lowest_of_steps = []
    for step_s in sorted(set(tool.step_s)):
        timings = clocks(step_s, t, tool.clock)
        if any(len(timing.samples) > 1 for timing in timings):
            raise UnsupportedError(
                f"passivity at the engine's port is computed for steps of whole samples (T = {t:g} s) only, not for "
                f"{step_s:g} s; the claim of stability is separate",
                key="simulation.step_s",
            )
        lowest_of_steps += [(_Port(plant, timing, tool, gains).lowest(), step_s) for timing in timings]
    lowest, step_s = min(lowest_of_steps, key=lambda pair: (pair[0].real_ns_per_m, pair[0].angle, pair[0].row, pair[1]))
    tolerance = _TOLERANCE * (gains.damping_ns_per_m + gains.stiffness_n_per_m * max(tool.step_s))
    llewellyn = _with_any_hand(device, tool, gains)
    return EnginePort(
        passive=lowest.real_ns_per_m >= -tolerance,
        margin_ns_per_m=lowest.real_ns_per_m,
        frequency_hz=lowest.angle / (2 * np.pi * step_s),
        hand=family.hands.values(lowest.row % len(family.hands)),
        step_s=step_s,
        any_hand=None if llewellyn is None else llewellyn >= -tolerance,
        any_hand_margin_ns_per_m=llewellyn,
        engine_is_implicit=tool.integrator == "implicit",
    )


@dataclass(frozen=True)
class PortPassivity(Worded):
    """Whether the port of an end is passive.

    Attributes:
        port: passivity of the port; None where it is not judged.
        refused: why it is not judged; empty where it is.
    """

    port: EnginePort | None
    refused: str = ""

    def document(self) -> dict[str, Any]:
        """Return JSON values."""
        judged: dict[str, Any] = {"passive": None} if self.port is None else plain(self.port)
        return judged | {"refused": self.refused or None, "claim": worded(self)}


@singledispatch
def port_passivity(end: End, problem: Problem, gains: ToolGains) -> PortPassivity | None:  # noqa: ARG001
    """Return the passivity of a coupling at the port of its end; None where an end has no port, as most."""
    return None


@port_passivity.register
def _engine_passivity(end: Simulation, problem: Problem, gains: ToolGains) -> PortPassivity | None:
    try:
        return PortPassivity(engine_port(problem.device, problem.hands, end, gains))
    except UnsupportedError as refusal:
        return PortPassivity(None, str(refusal))


class _Port:
    """G of a coupling at some devices with hands, at one step of an engine; the engine's loop with its tool driven."""

    def __init__(self, plant: SampledPlant, timing: StepTiming, tool: Simulation, gains: ToolGains) -> None:
        fixed = ToolState(math.inf, 0.0, 0.0, 0.0)
        self._engine = EngineLoop(Body.of(plant), timing, tool, [fixed])
        self._gains = gains
        self._late = PortDelays.of(tool)
        self._held_force = tool.exchange == "held-force"
        self._step = np.linalg.matrix_power(self._engine.sample(gains), timing.samples[0])

    def impedance(self, angles: FloatArray) -> ComplexArray:
        """Return G, force over velocity at the tool, N.s/m, at angles omega T_s, shape (angles, devices, hands).

        The tool's velocity is imposed; spring and damper act on it and through the device's loop, each at its own
        delay. T_s is the engine's step.
        """
        k = self._gains.stiffness_n_per_m
        b = self._gains.damping_ns_per_m
        late = self._late
        loop = self._engine.loop
        inner = loop.at["tool"].start
        x, v = self._engine.reading(late=self._engine.clock.late[0])
        force = (k * x + b * v)[:inner]
        z = np.exp(1j * angles)[:, None, None]
        place = self._engine.clock.step_s * z / (z - 1)
        tool_alone = k * place * z**-late.spring + b * z**-late.damper
        matrix = self._step[..., :inner, :inner]
        drive = self._step[..., :inner, -1 if self._held_force else -2 :]
        inverse = np.linalg.solve(z[..., None, None] * np.eye(inner) - matrix, drive.astype(complex))
        loop_gain = np.tensordot(inverse, force, axes=(-2, 0)) * z[..., None] ** -late.state
        if self._held_force:
            back = loop_gain[..., 0]
            return np.asarray(tool_alone + back / (1 - back) * z**-late.force * (k * place + b))
        return np.asarray(tool_alone - loop_gain[..., 0] * place - loop_gain[..., 1])

    def lowest(self) -> _Lowest:
        """Return the lowest Re G over angles, N.s/m, with angle and row; -inf where the driven loop is unstable."""
        lowest = _Lowest(-np.inf, 0.0, 0)
        if not self._engine.closed(self._gains).radius.max() < 1 - TOLERANCE:
            return lowest
        slow = np.geomspace(_SMALLEST_ANGLE, _MEETING_ANGLE, _ANGLES // 4, endpoint=False)
        angles = np.concatenate([slow, np.linspace(_MEETING_ANGLE, np.pi, _ANGLES)])
        for _ in range(1 + _REFINEMENTS):
            values = self.impedance(angles).real.reshape(len(angles), -1)
            place, row = divmod(int(np.argmin(values)), values.shape[1])
            lowest = _Lowest(float(values[place, row]), float(angles[place]), row)
            before = angles[max(place - 1, 0)]
            after = angles[min(place + 1, len(angles) - 1)]
            angles = np.linspace(before, after, _ANGLES_OF_REFINEMENT)
        return lowest


def _with_any_hand(device: Device, tool: Simulation, gains: ToolGains) -> float | None:
    """Return Llewellyn's margin, N.s/m, of the coupling between hand and tool; None where it is not computed.

    It is computed where each sample starts a step whose tool the device has, nothing is late, and the device is ideal.
    """
    delays = PortDelays.of(tool)
    force_delay = delays.force if tool.exchange == "held-force" else 0
    late = max(delays.spring, delays.damper, delays.state, force_delay) > 0 or tool.clock != "device"
    if max(tool.step_s) > _ONE_SAMPLE * device.sample_time_s or late or not ideal(device):
        return None
    margins = []
    for corner in device_corners(device, LINEAR_KEYS):
        loop = SampledLoop(
            device_damping_ns_per_m=corner.damping_ns_per_m,
            environment_damping_ns_per_m=0.0,
            environment_stiffness_n_per_m=0.0,
            sample_time_s=corner.sample_time_s,
            delay_samples=corner.delay_samples,
            model="sampled-data",
        )
        margin, _ = llewellyn_margin(
            loop, gains.damping_ns_per_m, gains.stiffness_n_per_m, gains.local_damping_ns_per_m
        )
        margins.append(float(margin[0]))
    return min(margins)
