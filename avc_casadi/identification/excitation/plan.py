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

from avc_casadi._util.arrays import FloatArray
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
_WINDOW_MOST = 32


@dataclass(frozen=True)
class Plan:
    """An excitation as the device plays it; rotary has rad and N.m in all of these."""

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

    @property
    def peak_force_n(self) -> float:
        """Largest force of the signal alone."""
        return float(np.abs(self.signal.units(self.ticks)).max()) / FULL * self.max_force_n

    @property
    def limits(self) -> dict[str, float]:
        """Limits by the keys of a forecast."""
        most = self.max_force_n, self.max_speed_m_per_s, self.max_travel_m
        return dict(zip(("force_n", "speed_m_per_s", "travel_m"), most, strict=True))


@dataclass(frozen=True, eq=False)
class Forecast:
    """Largest magnitudes, each of shape (devices, scales): force with centring, speed over the window, travel."""

    force_n: FloatArray
    speed_m_per_s: FloatArray
    travel_m: FloatArray


def corners_of(device: Device) -> list[Device]:
    """Return the device itself, then the corners of its ranges of mechanics, delay and friction."""
    whole = device_with(device, {})
    corners = device_corners(device, (*LINEAR_KEYS, "coulomb_friction_n"))
    return [whole, *(one for one in corners if one != whole)]


def speed_window(metres_per_count: float, sample_time_s: float, max_speed_m_per_s: float) -> int:
    """Return the window of a velocity in ticks: a step of the encoder is at most a tenth of the speed limit over it."""
    wanted = metres_per_count / (0.1 * max_speed_m_per_s * sample_time_s)
    return int(min(max(1, -(-wanted // 1)), _WINDOW_MOST))


def forecast(
    plan: Plan, devices: Sequence[Device], scales: Sequence[float] | FloatArray = (1.0,), progress: Progress = SILENT
) -> Forecast:
    """Simulate a plan on devices of one structure, with the signal scaled."""
    scales = np.asarray(scales)
    signal = plan.signal.units(plan.ticks) * (plan.max_force_n / FULL)
    fade = ramp(plan.ticks, plan.ramp_ticks) / WHOLE
    whole = np.array([int(one.delay_samples) for one in devices])
    rest = np.array([one.delay_samples for one in devices]) - whole
    # In two parts of a sample an older and a newer force act; friction is constant over each.
    split = bool(rest.any())
    parts = [_part(devices, share) for share in ([rest, 1 - rest] if split else [np.full(whole.size, 0.5)] * 2)]
    late = np.stack([whole + 1, whole] if split else [whole] * 2)
    rubs = np.array([[one.coulomb_friction_n] for one in devices])
    seen = 2 if devices[0].resonance is not None and devices[0].encoder_at == "handle" else 0
    shape = len(devices), scales.size
    state = np.zeros((*shape, parts[0][0].shape[-1]))
    commands = np.zeros((int(late.max()) + 2, *shape))
    rows, passed, most = np.arange(len(devices)), np.zeros((plan.window, *shape)), np.zeros((3, *shape))
    window_s = plan.window * plan.sample_time_s
    for tick in range(plan.ticks):
        if tick % 500 == 0:
            progress.advance(tick, plan.ticks, "ticks simulated")
        away = state[..., seen]
        speed = (away - passed[tick % plan.window]) / window_s
        passed[tick % plan.window] = away
        force = (signal[tick] * scales - plan.spring_n_per_m * away - plan.damper_ns_per_m * speed) * fade[tick]
        most = np.maximum(most, np.abs([force, speed, away]))
        commands[tick % len(commands)] = np.clip(force, -plan.max_force_n, plan.max_force_n)
        acting = commands[(tick - late) % len(commands), rows]
        for (matrix, push, rub), acts in zip(parts, acting, strict=True):
            state = state @ matrix + push * acts[..., None]
            state = state + rub * np.clip(state[..., 1] / -rub[..., 1], -rubs, rubs)[..., None]
    return Forecast(most[0], most[1] + plan.metres_per_count / window_s, most[2] + plan.metres_per_count)


def _part(devices: Sequence[Device], shares: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return transition, effect of the force and of friction over a share of a sample, one of each device."""
    matrix, push, rub = [], [], []
    for device, share in zip(devices, shares.tolist(), strict=True):
        plant, seconds = device_plant(device).linear(), max(share, 1e-9) * device.sample_time_s
        rubbing = LinearPlant(plant.names, plant.matrix, plant.friction, plant.target, plant.friction)
        step = transition(plant, seconds)
        matrix.append(step.matrix.T)
        push.append([-step.force])
        rub.append([transition(rubbing, seconds).force])
    return np.array(matrix), np.array(push), np.array(rub)
