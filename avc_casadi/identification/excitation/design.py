"""Excitation plans: a multisine or a chirp, as strong as the limits allow on every corner of the ranges."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi._util.text import number
from avc_casadi.identification.excitation.plan import Forecast, Kind, Plan, corners_of, forecast, speed_window
from avc_casadi.identification.excitation.signal import FULL, KNOTS, Signal, low_crest_phases
from avc_casadi.model.device import Device
from avc_casadi.model.sampled_plant import device_plant

# Default limits, of a rotary device at its handle; the firmware's largest speed and travel in the device's own units;
# share of the limits that a forecast may reach; encoder of a device that declares none.
_SPEED_M_PER_S, _TRAVEL_M, _FIRMWARE_MOST, _MARGIN, _USUAL_ENCODER_M = 0.3, 0.02, 10.0, 0.85, 2e-6


@dataclass(frozen=True, eq=False)
class Excitation:
    """A plan and its forecast: the declared device first, then the corners of its ranges."""

    plan: Plan
    devices: tuple[Device, ...]
    forecast: Forecast

    @property
    def held_back_by(self) -> str:
        """The limit that the worst device of the ranges comes nearest: force_n, speed_m_per_s or travel_m."""
        near = {key: float(getattr(self.forecast, key).max()) / most for key, most in self.plan.limits.items()}
        return max(near, key=lambda key: near[key])


def plan_excitation(
    device: Device,
    kind: Kind = "multisine",
    *,
    seconds: float = 10.0,
    force_n: float | None = None,
    speed_m_per_s: float | None = None,
    travel_m: float | None = None,
    progress: Progress = SILENT,
) -> Excitation:
    """Plan an excitation that takes no device of the ranges beyond the limits."""
    reach, period = device.metres_per_unit, device.sample_time_s
    speed = min(_SPEED_M_PER_S / reach, _FIRMWARE_MOST) if speed_m_per_s is None else speed_m_per_s
    travel = _TRAVEL_M / reach if travel_m is None else travel_m
    most_n = device.max_force_n or math.inf
    force = 0.5 * most_n if force_n is None else force_n
    faults = [
        Fault("", None, key, f"is {value:g}; allowed: {low:g} to {high:g}")
        for key, value, low, high in (
            ("seconds", seconds, 2.0, 120.0),
            ("force_n", force, 1e-6, most_n if force_n is None else min(most_n, 1e6)),
            ("speed_m_per_s", speed, 1e-3 / reach, min(5.0 / reach, _FIRMWARE_MOST)),
            ("travel_m", travel, 1e-4 / reach, min(1.0 / reach, _FIRMWARE_MOST)),
        )
        if not low <= value <= high
    ]
    if math.isinf(force):
        faults.append(Fault("", None, "force_n", "is not given, nor is device.max_force_n; allowed: give one"))
    if device.mass_kg <= 0:
        faults.append(Fault("", None, "device.mass_kg", "is 0; allowed: above 0, a guess with a range will do"))
    if faults:
        raise InputError(faults)
    devices = corners_of(device)
    step_m = device.encoder_resolution_m or _USUAL_ENCODER_M / reach
    window = speed_window(step_m, period, speed)
    # The delay turns the phase by 0.3 rad at most at the natural frequency of the lightest device on the spring.
    lightest = min(one.mass_kg for one in devices)
    late_s = (max(one.delay_samples for one in devices) + 1.5 + window / 2) * period
    friction = max(one.coulomb_friction_n for one in devices)
    stiffest = min(0.5 * force / travel, lightest * (0.3 / late_s) ** 2)
    spring = float(min(max(device.mass_kg * (2 * np.pi) ** 2, 2 * friction / travel), stiffest))
    ticks = round(seconds / period)
    plan = Plan(
        kind=kind,
        sample_time_s=period,
        metres_per_count=step_m,
        ticks=ticks,
        ramp_ticks=max(1, min(round(0.3 / period), ticks // 4, 0xFFFF)),
        max_force_n=force,
        max_speed_m_per_s=speed,
        max_travel_m=travel,
        spring_n_per_m=spring,
        damper_ns_per_m=float(np.sqrt(spring * lightest)),
        window=window,
        signal=Signal((0,), (0,), (0,)),
        motion=device.motion,
    )
    plan = _scaled(replace(plan, signal=_signal(plan, devices)), devices, progress)
    after = forecast(plan, devices, progress=progress)
    steps = float((after.travel_m[:, 0] / step_m).min())
    if steps < 10 or plan.peak_force_n < 1.2 * friction:
        raise InputError.of(
            f"leave a force of {number(plan.peak_force_n)}, which moves a device of the ranges by {number(steps)} "
            f"encoder steps only (its friction: up to {number(friction)}); allowed: more force, speed or travel, or "
            "narrower ranges",
            key="limits",
        )
    return Excitation(plan, tuple(devices), after)


def _signal(plan: Plan, devices: Sequence[Device]) -> Signal:
    """Return the signal: its size over frequency is what force, speed and travel allow of a sine."""
    period = plan.sample_time_s
    low, high = max(0.5, 2 / plan.seconds), min(300.0, 0.3 / period)
    if plan.kind == "chirp":
        growth = (high / low) ** (1 / plan.ticks) - 1
        lift = _allowed(plan, devices, low * (high / low) ** np.linspace(0, 1, KNOTS))
        return Signal.of([low], [1.0], [0.0], period, growth_per_tick=growth, knots=lift / lift.max())
    period_s = min(4.0, plan.seconds)
    lines = np.unique(np.round(np.geomspace(low, high, 48) * period_s))
    lines = lines[lines >= 1]
    if plan.seconds > period_s:
        # Shifted lines: in repeats to the encoder's step the rounding would be the same each time.
        lines += 0.03 * (2 * np.modf(np.arange(1, lines.size + 1) * 0.6180339887)[0] - 1)
    frequency = lines / period_s
    size = _allowed(plan, devices, frequency)
    # A peak is resolved to 1 per cent with 24 points in a period of the fastest tone.
    time = np.arange(0, plan.seconds, max(period, 1 / (24 * frequency[-1])), dtype=np.float64)
    phase = low_crest_phases(frequency, size, time)
    wave = np.sin(np.outer(time, 2 * np.pi * frequency) + phase) @ size
    return Signal.of(frequency, size / np.abs(wave).max(), phase, period)


def _allowed(plan: Plan, devices: Sequence[Device], frequency_hz: FloatArray) -> FloatArray:
    """Return the force of a sine that force, speed and travel limit allow on the most compliant device."""
    s = 2j * np.pi * frequency_hz
    forces = [np.full(frequency_hz.size, plan.max_force_n)]
    for device in devices:
        linear = device_plant(device).linear()
        matrices = s[:, None, None] * np.eye(linear.states) - linear.matrix
        alone = -np.linalg.solve(matrices, linear.force[:, None])[:, 0, 0]
        alone = alone * np.exp(-s * plan.sample_time_s * (0.5 + device.delay_samples))
        moves = np.abs(alone / (1 + (plan.spring_n_per_m + plan.damper_ns_per_m * s) * alone))
        limits = plan.max_travel_m / moves, plan.max_speed_m_per_s / (moves * np.abs(s))
        forces += [_MARGIN * one + 4 / np.pi * device.coulomb_friction_n for one in limits]
    return np.asarray(np.min(forces, axis=0))


def _scaled(plan: Plan, devices: Sequence[Device], progress: Progress) -> Plan:
    """Return the plan scaled to the largest of rising peaks below the first that takes a device to a limit."""
    scales = np.geomspace(0.02, 1.0, 12) * _MARGIN * plan.max_force_n / plan.peak_force_n
    best = 0.0
    for _ in range(2):
        after = forecast(plan, devices, scales, progress)
        good = after.force_n <= plan.max_force_n
        good &= after.speed_m_per_s <= _MARGIN * plan.max_speed_m_per_s
        good &= after.travel_m <= _MARGIN * plan.max_travel_m
        below = np.flatnonzero(np.cumprod(good.all(axis=0)))
        if not below.size:
            raise InputError.of(
                f"would be exceeded with a force of {number(0.02 * plan.max_force_n)} already by a device of the "
                f"ranges (speed {number(plan.max_speed_m_per_s)}, travel {number(plan.max_travel_m)}); allowed: wider "
                "limits or narrower ranges",
                key="limits",
            )
        best = float(scales[below[-1]])
        scales = np.geomspace(best, scales[min(below[-1] + 1, scales.size - 1)], 6)
    amplitude = tuple(min(FULL, round(one * best)) for one in plan.signal.amplitude)
    return replace(plan, signal=replace(plan.signal, amplitude=amplitude))
