"""An excitation plan: signal, limits, centring, and its forecast.

Before any motion it is simulated for the device and for every corner of its ranges, with linear mechanics, amplifier,
delay and dry friction, the ramps, the centring and the force limit; the encoder's steps are left out, with a margin of
one step for them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from avc_casadi._util.arrays import FloatArray, IndexArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi._util.units import MotionKind, Units, units_for
from avc_casadi.identification.excitation.signal import FULL, WHOLE, Signal, ramp
from avc_casadi.model.corners import LINEAR_KEYS, device_corners, device_with
from avc_casadi.model.device import Device
from avc_casadi.model.plant import LinearPlant, transition
from avc_casadi.model.sampled_plant import device_plant

Kind = Literal["multisine", "chirp"]

SILENCE_S = 1.0
"""The device stops after so long without a message from the host."""
WINDOW_MOST = 32


@dataclass(frozen=True)
class Plan:
    """An excitation as the device plays it.

    Attributes:
        kind: multisine or chirp.
        sample_time_s: T.
        metres_per_count: of the encoder.
        ticks: played, with the ramps.
        ramp_ticks: in, and out.
        max_force_n: limit of signal and centring together.
        max_speed_m_per_s: limit; beyond it the force stays off.
        max_travel_m: limit to either side of the start.
        spring_n_per_m: weak centring spring.
        damper_ns_per_m: centring damper.
        window: ticks over which the velocity is taken, 1 to 32.
        signal: in addition to the centring.
        motion: of the device; rotary has rad and N.m in all of these.
    """

    kind: Kind
    sample_time_s: float
    metres_per_count: float
    ticks: int
    ramp_ticks: int
    max_force_n: float
    max_speed_m_per_s: float
    max_travel_m: float
    spring_n_per_m: float
    damper_ns_per_m: float
    window: int
    signal: Signal
    motion: MotionKind = "linear"

    @property
    def units(self) -> Units:
        """Names and units of its values."""
        return units_for(self.motion)

    @property
    def seconds(self) -> float:
        """Duration, s."""
        return self.ticks * self.sample_time_s

    @property
    def silent_ticks(self) -> int:
        """Ticks without a message from the host after which the device stops."""
        return max(1, round(SILENCE_S / self.sample_time_s))

    @property
    def band_hz(self) -> tuple[float, float]:
        """Lowest and highest frequency of the signal."""
        return self.signal.frequency_hz(self.ticks, self.sample_time_s)


def speed_window(metres_per_count: float, sample_time_s: float, max_speed_m_per_s: float) -> int:
    """Return the window of a velocity in ticks: a step of the encoder is at most a tenth of the speed limit over it."""
    wanted = metres_per_count / (0.1 * max_speed_m_per_s * sample_time_s)
    return int(min(max(1, -(-wanted // 1)), WINDOW_MOST))


@dataclass(frozen=True, eq=False)
class Forecast:
    """Largest magnitudes, each of shape (devices, scales).

    Attributes:
        force_n: of signal and centring together.
        speed_m_per_s: as the device measures it, over its window.
        travel_m: from the start.
    """

    force_n: FloatArray
    speed_m_per_s: FloatArray
    travel_m: FloatArray


def corners_of(device: Device) -> list[Device]:
    """Return the device itself, then the corners of its ranges of mechanics, delay and friction."""
    whole = device_with(device, {})
    corners = device_corners(device, (*LINEAR_KEYS, "coulomb_friction_n"))
    return [whole, *(one for one in corners if one != whole)]


def forecast(
    plan: Plan, devices: Sequence[Device], scales: FloatArray | None = None, progress: Progress = SILENT
) -> Forecast:
    """Simulate a plan on devices of one structure, with the signal scaled; None is 1 alone."""
    scales = np.ones(1) if scales is None else scales
    signal = plan.signal.units(plan.ticks) * (plan.max_force_n / FULL)
    fade = ramp(plan.ticks, plan.ramp_ticks) / WHOLE
    steps = _Steps.of(devices)
    shape = (len(devices), scales.size)
    state = np.zeros((*shape, steps.states))
    asked = np.zeros((steps.longest + 2, *shape))
    rows = np.arange(len(devices))
    passed = np.zeros((plan.window, *shape))
    most = np.zeros((3, *shape))
    window_s = plan.window * plan.sample_time_s
    for tick in range(plan.ticks):
        if tick % 500 == 0:
            progress.advance(tick, plan.ticks, "ticks simulated")
        away = state[..., steps.seen]
        slot = tick % plan.window
        speed = (away - passed[slot]) / window_s
        passed[slot] = away
        hold = plan.spring_n_per_m * away + plan.damper_ns_per_m * speed
        force = (signal[tick] * scales - hold) * fade[tick]
        for into, found in zip(most, (force, speed, away), strict=True):
            np.maximum(into, np.abs(found), out=into)
        limited = np.minimum(np.maximum(force, -plan.max_force_n), plan.max_force_n)
        asked[tick % len(asked)] = limited
        state = steps.advance(state, asked[(tick - steps.late) % len(asked), rows])
    step_m = plan.metres_per_count
    return Forecast(most[0], most[1] + step_m / window_s, most[2] + step_m)


@dataclass(frozen=True, eq=False)
class _Steps:
    """Parts of a sample: transition, force and friction; their delays, (parts, devices); friction; measured state."""

    parts: tuple[tuple[FloatArray, FloatArray, FloatArray], ...]
    late: IndexArray
    most_n: FloatArray
    seen: int

    @classmethod
    def of(cls, devices: Sequence[Device]) -> _Steps:
        whole = np.array([int(one.delay_samples) for one in devices])
        rest = np.array([one.delay_samples for one in devices]) - whole
        split = bool(rest.any())
        shares = [rest, 1 - rest] if split else [np.full(whole.size, 0.5)] * 2
        first = devices[0]
        return cls(
            parts=tuple(_part(devices, share) for share in shares),
            late=np.stack([whole + 1, whole] if split else [whole] * 2),
            most_n=np.array([[one.coulomb_friction_n] for one in devices]),
            seen=2 if first.resonance is not None and first.encoder_at == "handle" else 0,
        )

    @property
    def states(self) -> int:
        return int(self.parts[0][0].shape[-1])

    @property
    def longest(self) -> int:
        return int(self.late.max())

    def advance(self, state: FloatArray, forces: FloatArray) -> FloatArray:
        rubs = bool(self.most_n.any())
        for (matrix, push, rub), force in zip(self.parts, forces, strict=True):
            state = state @ matrix + push * force[..., None]
            if rubs:
                stops = state[..., 1] / -rub[..., 1]
                held = np.minimum(np.maximum(stops, -self.most_n), self.most_n)
                state = state + rub * held[..., None]
        return state


def _part(devices: Sequence[Device], share: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    matrix, push, rub = [], [], []
    for device, part in zip(devices, share, strict=True):
        plant = device_plant(device).linear()
        rubbing = LinearPlant(plant.names, plant.matrix, plant.friction, plant.target, plant.friction)
        seconds = max(float(part), 1e-9) * device.sample_time_s
        step = transition(plant, seconds)
        matrix.append(step.matrix.T)
        push.append([-step.force])
        rub.append([transition(rubbing, seconds).force])
    return np.array(matrix), np.array(push), np.array(rub)
