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
from avc_casadi.identification.excitation.signal import FULL, KNOTS, Signal, crest_factor, low_crest_phases
from avc_casadi.model.device import Device
from avc_casadi.model.sampled_plant import device_plant

KINDS: tuple[Kind, ...] = ("multisine", "chirp")
"""Kinds of excitation."""

SECONDS, SPEED_M_PER_S, TRAVEL_M = 10.0, 0.3, 0.02
"""Defaults; of a rotary device at its handle."""
# Limit of speed and travel in the firmware, in the device's own units; share of the limits that a forecast may reach;
# encoder of a device that declares none.
_FIRMWARE_MOST, _MARGIN, _USUAL_ENCODER_M = 10.0, 0.85, 2e-6


@dataclass(frozen=True, eq=False)
class Excitation:
    """A plan and its forecast.

    Attributes:
        plan: for the device.
        devices: the declared one first, then the corners of its ranges.
        forecast: of each, shape (devices, 1).
        crest: crest factor of the signal.
    """

    plan: Plan
    devices: tuple[Device, ...]
    forecast: Forecast
    crest: float

    @property
    def peak_force_n(self) -> float:
        """Largest force of the signal alone."""
        return peak_force_n(self.plan)

    @property
    def held_back_by(self) -> str:
        """The limit that the worst device of the ranges comes nearest: force_n, speed_m_per_s or travel_m."""
        plan, found = self.plan, self.forecast
        near = {
            "force_n": float(found.force_n.max()) / plan.max_force_n,
            "speed_m_per_s": float(found.speed_m_per_s.max()) / plan.max_speed_m_per_s,
            "travel_m": float(found.travel_m.max()) / plan.max_travel_m,
        }
        return max(near, key=lambda key: near[key])


def plan_excitation(
    device: Device,
    kind: Kind = "multisine",
    *,
    seconds: float = SECONDS,
    force_n: float | None = None,
    speed_m_per_s: float | None = None,
    travel_m: float | None = None,
    progress: Progress = SILENT,
) -> Excitation:
    """Plan an excitation that takes no device of the ranges beyond the limits.

    Args:
        device: as declared, with its ranges.
        kind: see `KINDS`.
        seconds: duration.
        force_n: limit, of signal and centring together; None is half of the device's own. The signal is as strong as
            this and the limits of speed and travel allow on every device of the ranges.
        speed_m_per_s: limit; None is 0.3 m/s at the hand.
        travel_m: limit, to either side of the start; None is 20 mm at the hand.
        progress: of the search and its simulations.

    Raises:
        InputError: an argument out of range, or limits too tight for a visible motion.
    """
    reach = device.metres_per_unit
    speed_m_per_s = min(SPEED_M_PER_S / reach, _FIRMWARE_MOST) if speed_m_per_s is None else speed_m_per_s
    travel_m = TRAVEL_M / reach if travel_m is None else travel_m
    _check(device, kind, seconds, force_n, speed_m_per_s, travel_m)
    most_n = force_n or 0.5 * (device.max_force_n or math.inf)
    devices = corners_of(device)
    step_m = device.encoder_resolution_m or _USUAL_ENCODER_M / reach
    window = speed_window(step_m, device.sample_time_s, speed_m_per_s)
    spring, damper = _centring(devices, most_n, travel_m, window)
    ticks = round(seconds / device.sample_time_s)
    empty = Plan(
        kind=kind,
        sample_time_s=device.sample_time_s,
        metres_per_count=step_m,
        ticks=ticks,
        ramp_ticks=max(1, min(round(0.3 / device.sample_time_s), ticks // 4, 0xFFFF)),
        max_force_n=most_n,
        max_speed_m_per_s=speed_m_per_s,
        max_travel_m=travel_m,
        spring_n_per_m=spring,
        damper_ns_per_m=damper,
        window=window,
        signal=Signal((0,), (0,), (0,)),
        motion=device.motion,
    )
    return _scaled(replace(empty, signal=_signal(empty, devices)), devices, progress)


def peak_force_n(plan: Plan) -> float:
    """Return the largest force of a plan's signal alone."""
    return float(np.abs(plan.signal.units(plan.ticks)).max()) / FULL * plan.max_force_n


def check_plan(plan: Plan, device: Device) -> Forecast:
    """Return the forecast at every corner; an InputError names the limits that would be exceeded."""
    return _checked(plan, corners_of(device))


def _checked(plan: Plan, devices: Sequence[Device], progress: Progress = SILENT) -> Forecast:
    found = forecast(plan, devices, progress=progress)
    faults = []
    for key, reached, most in (
        ("force_n", found.force_n, plan.max_force_n),
        ("speed_m_per_s", found.speed_m_per_s, plan.max_speed_m_per_s),
        ("travel_m", found.travel_m, plan.max_travel_m),
    ):
        worst = int(np.argmax(reached[:, 0]))
        if not reached[worst, 0] <= most:
            one = devices[worst]
            said = (
                f"would reach {number(float(reached[worst, 0]))} on a device of the ranges (mass "
                f"{number(one.mass_kg)}, damping {number(one.damping_ns_per_m)}, friction "
                f"{number(one.coulomb_friction_n)}); allowed: {number(most)}"
            )
            faults.append(Fault("", None, key, said))
    if faults:
        raise InputError(faults)
    return found


def _check(
    device: Device, kind: str, seconds: float, force_n: float | None, speed_m_per_s: float, travel_m: float
) -> None:
    reach, most = device.metres_per_unit, device.max_force_n or math.inf
    faults = []
    if kind not in KINDS:
        faults.append(Fault("", None, "signal", f"is {kind!r}; allowed: {', '.join(KINDS)}"))
    for key, value, low, high in (
        ("seconds", seconds, 2.0, 120.0),
        ("speed_m_per_s", speed_m_per_s, 1e-3 / reach, min(5.0 / reach, _FIRMWARE_MOST)),
        ("travel_m", travel_m, 1e-4 / reach, min(1.0 / reach, _FIRMWARE_MOST)),
    ):
        if not low <= value <= high:
            faults.append(Fault("", None, key, f"is {value:g}; allowed: {low:g} to {high:g}"))
    if force_n is not None and not 0 < force_n <= most:
        faults.append(Fault("", None, "force_n", f"is {force_n:g}; allowed: above 0, at most {most:g}, the device's"))
    if force_n is None and device.max_force_n is None:
        faults.append(Fault("", None, "force_n", "is not given, nor is device.max_force_n; allowed: give one"))
    if device.mass_kg <= 0:
        faults.append(Fault("", None, "device.mass_kg", "is 0; allowed: above 0, a guess with a range will do"))
    if faults:
        raise InputError(faults)


def _centring(devices: Sequence[Device], force_n: float, travel_m: float, window: int) -> tuple[float, float]:
    """Return spring and damper of the centring: stiff enough against friction, slow enough beside the delay."""
    mass = devices[0].mass_kg
    lightest = min(one.mass_kg for one in devices)
    friction = max(one.coulomb_friction_n for one in devices)
    # The delay adds a phase lag of 0.3 rad at most at the natural frequency of the lightest device on the spring.
    late_s = (max(one.delay_samples for one in devices) + 1.5 + window / 2) * devices[0].sample_time_s
    most = min(0.5 * force_n / travel_m, lightest * (0.3 / late_s) ** 2)
    spring = min(max(mass * (2 * np.pi) ** 2, 2 * friction / travel_m), most)
    return float(spring), float(np.sqrt(spring * lightest))


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
    found = [np.full(frequency_hz.size, plan.max_force_n)]
    for device in devices:
        linear = device_plant(device).linear()
        eye = np.eye(linear.states)
        alone = np.array([np.linalg.solve(one * eye - linear.matrix, -linear.force)[0] for one in s])
        alone = alone * np.exp(-s * plan.sample_time_s * (0.5 + device.delay_samples))
        moves = np.abs(alone / (1 + (plan.spring_n_per_m + plan.damper_ns_per_m * s) * alone))
        rubs = 4 / np.pi * device.coulomb_friction_n
        limits = (plan.max_travel_m / moves, plan.max_speed_m_per_s / (moves * np.abs(s)))
        found += [_MARGIN * one + rubs for one in limits]
    return np.asarray(np.min(found, axis=0))


def _scaled(plan: Plan, devices: Sequence[Device], progress: Progress) -> Excitation:
    """Return the plan scaled to the largest peak that keeps every device off the limits."""
    full = float(np.abs(plan.signal.units(plan.ticks)).max()) / FULL
    scales = np.geomspace(0.02, 1.0, 12) * _MARGIN / full
    best = _largest(plan, devices, scales, progress)
    finer = np.geomspace(best, min(best * scales[1] / scales[0], scales[-1]), 6)
    best = _largest(plan, devices, finer, progress)
    louder = tuple(min(FULL, round(one * best)) for one in plan.signal.amplitude)
    made = replace(plan, signal=replace(plan.signal, amplitude=louder))
    after = _checked(made, devices, progress)
    steps = float((after.travel_m[:, 0] / made.metres_per_count).min())
    peak, friction = peak_force_n(made), max(one.coulomb_friction_n for one in devices)
    if steps < 10 or peak < 1.2 * friction:
        raise InputError.of(
            f"leave a force of {number(peak)}, which moves a device of the ranges by {number(steps)} encoder steps "
            f"only (its friction: up to {number(friction)}); allowed: more force, speed or travel, or narrower ranges",
            key="limits",
        )
    return Excitation(made, tuple(devices), after, crest_factor(made.signal.units(made.ticks).astype(np.float64)))


def _largest(plan: Plan, devices: Sequence[Device], scales: FloatArray, progress: Progress) -> float:
    """Return the largest of rising scales below the first that takes a device to a limit."""
    found = forecast(plan, devices, scales, progress)
    good = (
        (found.force_n <= plan.max_force_n)
        & (found.speed_m_per_s <= _MARGIN * plan.max_speed_m_per_s)
        & (found.travel_m <= _MARGIN * plan.max_travel_m)
    ).all(axis=0)
    holds = np.flatnonzero(np.cumprod(good))
    if not holds.size:
        raise InputError.of(
            f"would be exceeded with a force of {number(0.02 * plan.max_force_n)} already by a device of the ranges "
            f"(speed {number(plan.max_speed_m_per_s)}, travel {number(plan.max_travel_m)}); allowed: wider limits or "
            "narrower ranges",
            key="limits",
        )
    return float(scales[holds[-1]])
