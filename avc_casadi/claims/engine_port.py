r"""The port between a physics engine and a coupling, once a step: its passivity, and so stability with passive engines.

Every T_s = N T the engine gives the tool a velocity v and x(n) = x(n-1) + T_s v(n); the map from v to the force is

    G(z) = z^-a K X + z^-c B - [K B] C (z I - A_N)^-1 B_N z^-q [X 1]',    X = T_s z/(z - 1)

A_N, B_N are N samples of the device with the tool's state held, C reads its newest position and velocity, q is the age
in steps of the tool's state at the device, a and c those of its force on the tool. Of a held force F_e, L being the
loop from it back to itself, G(z) = z^-a K X + z^-c B + L/(1 - L) z^-e (K X + B). With G positive real the loop with any
passive engine is stable (Brown and Colgate 1997); an explicit mass is not passive.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi.claims.levels import ideal
from avc_casadi.claims.llewellyn import llewellyn_margin
from avc_casadi.loops.engine import Clock, Engine, clocks
from avc_casadi.loops.loop import Body
from avc_casadi.loops.system import TOLERANCE
from avc_casadi.loops.wall import SampledLoop
from avc_casadi.model.corners import LINEAR_KEYS, device_corners
from avc_casadi.model.device import Device
from avc_casadi.model.ends import ToolGains, ToolState, VirtualTool
from avc_casadi.model.hands import hand_corners, with_released
from avc_casadi.model.plant import SampledPlant, sampled_plant
from avc_casadi.model.problem import Hands

# Angles per step, linearly and logarithmically spaced, and refinements about the lowest.
_ANGLES, _SMALLEST, _FINER = 400, 1e-5, 3
# Rounding error of a real part, as a share of the largest term: the spring's is K T_s/angle.
_TOLERANCE = 1e-9


@dataclass(frozen=True)
class EnginePort:
    """Passivity of a coupling at the engine's port."""

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
    """Ages, in steps, of the velocity set by the engine where it is used."""

    spring: int
    damper: int
    state: int
    force: int

    @classmethod
    def of(cls, tool: VirtualTool) -> PortDelays:
        """Return those of an exchange; v(n) is the velocity that is solved together with the force of step n."""
        # An implicit engine uses the state that it solves for, so that on-time sends the previous one. An explicit one
        # uses and sends the state at the beginning of its step; the new one is ahead.
        implicit = tool.integrator == "implicit"
        solves = implicit or tool.integrator == "implicit-damping"
        if tool.exchange == "held-force":
            return cls(int(solves and not implicit), 0, tool.queued, int(solves))
        if tool.exchange == "ahead":
            return cls(int(not implicit), int(not solves), tool.queued, int(solves))
        return cls(int(solves and not implicit), 0, tool.queued + int(solves), int(solves))


def engine_port(device: Device, hands: Hands, tool: VirtualTool, gains: ToolGains) -> EnginePort:
    """Return the passivity of a coupling at the engine's port; the tool's mass and its contacts do not enter."""
    t, people = device.sample_time_s, with_released(hand_corners(hands))
    if tool.integrator == "exact" or tool.substeps > 1:
        why = "passivity at the engine's port is known of steps by the new velocity, one for each force of the coupling"
        raise UnsupportedError(f"{why}; the spectral radius of the lifted loop judges it", key="simulation.integrator")
    plant = sampled_plant(device_corners(device, LINEAR_KEYS), people)
    lowest = []
    for step_s in sorted(set(tool.step_s)):
        clock = clocks(step_s, t)[0]
        if not clock.whole:
            raise UnsupportedError(
                f"passivity at the engine's port is known where the step is a whole multiple of T = {t:g} s, not for "
                f"{step_s:g} s: the port is no single map then; the spectral radius of the lifted loop judges it",
                key="simulation.step_s",
            )
        lowest.append((*_Port(plant, clock, tool, gains).lowest(), step_s))
    margin, angle, row, step_s = min(lowest)
    tolerance = _TOLERANCE * (gains.damping_ns_per_m + gains.stiffness_n_per_m * max(tool.step_s))
    llewellyn = _with_any_hand(device, tool, gains)
    return EnginePort(
        passive=margin >= -tolerance,
        margin_ns_per_m=margin,
        frequency_hz=angle / (2 * np.pi * step_s),
        hand=people.values(row % len(people)),
        step_s=step_s,
        any_hand=None if llewellyn is None else llewellyn >= -tolerance,
        any_hand_margin_ns_per_m=llewellyn,
        engine_is_implicit=tool.integrator == "implicit",
    )


class _Port:
    """G of a coupling at some devices with hands, at one step of an engine; the engine's loop with its tool driven."""

    def __init__(self, plant: SampledPlant, clock: Clock, tool: VirtualTool, gains: ToolGains) -> None:
        fixed = ToolState(math.inf, 0.0, 0.0, 0.0)
        self._engine = engine = Engine(Body.of(plant), clock, tool, [fixed])
        self._gains, self._late, self._held_force = gains, PortDelays.of(tool), tool.exchange == "held-force"
        self._whole = np.linalg.matrix_power(engine.sample(gains), clock.samples[0])

    def impedance(self, angles: FloatArray) -> ComplexArray:
        """Return G, N.s/m, shape (angles, devices, hands)."""
        k, b, late, loop = self._gains.stiffness_n_per_m, self._gains.damping_ns_per_m, self._late, self._engine.loop
        body, inner = self._engine.body, loop.at["tool"].start
        x = body.output_row @ loop["plant"]
        force = (k * x + b * (x - loop["positions"][0]) / body.sample_time_s)[:inner]
        z = np.exp(1j * angles)[:, None, None]
        place = self._engine.clock.step_s * z / (z - 1)
        own = k * place * z**-late.spring + b * z**-late.damper
        matrix, drive = self._whole[..., :inner, :inner], self._whole[..., :inner, -1 if self._held_force else -2 :]
        inverse = np.linalg.solve(z[..., None, None] * np.eye(inner) - matrix, drive.astype(complex))
        loop_gain = np.tensordot(inverse, force, axes=(-2, 0)) * z[..., None] ** -late.state
        if self._held_force:
            back = loop_gain[..., 0]
            return np.asarray(own + back / (1 - back) * z**-late.force * (k * place + b))
        return np.asarray(own - loop_gain[..., 0] * place - loop_gain[..., 1])

    def lowest(self) -> tuple[float, float, int]:
        """Return the lowest Re G, its angle and the indices of device and hand."""
        if not self._engine.closed(self._gains).radius.max() < 1 - TOLERANCE:
            return -np.inf, 0.0, 0
        angles = np.concatenate(
            [np.geomspace(_SMALLEST, 0.1, _ANGLES // 4, endpoint=False), np.linspace(0.1, np.pi, _ANGLES)]
        )
        for _ in range(_FINER + 1):
            values = self.impedance(angles).real.reshape(len(angles), -1)
            place, row = divmod(int(np.argmin(values)), values.shape[1])
            least = float(values[place, row]), float(angles[place]), row
            angles = np.linspace(angles[max(place - 1, 0)], angles[min(place + 1, len(angles) - 1)], 41)
        return least


def _with_any_hand(device: Device, tool: VirtualTool, gains: ToolGains) -> float | None:
    """Return Llewellyn's margin where each sample is a step, and the device has the tool of that step; else None."""
    delays, corners = PortDelays.of(tool), device_corners(device, LINEAR_KEYS)
    old = max(delays.spring, delays.damper, delays.state, delays.force if tool.exchange == "held-force" else 0)
    if max(tool.step_s) > 1.5 * device.sample_time_s or old or not ideal(device):
        return None
    k, b, local = gains.stiffness_n_per_m, gains.damping_ns_per_m, gains.local_damping_ns_per_m
    loops = [
        SampledLoop(one.damping_ns_per_m, 0.0, 0.0, one.sample_time_s, one.delay_samples, "sampled-data")
        for one in corners
    ]
    return min(float(llewellyn_margin(loop, b, k, local)[0][0]) for loop in loops)
