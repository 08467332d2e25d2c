"""Excitation plans: a multisine or a chirp, as strong as the limits allow on every corner of the ranges.

The signal is in the integer arithmetic of the device: it sums sines whose phases are integers in turns of 2^32, so that
a few numbers describe any duration without drift, and the same bits everywhere. Before any motion a plan is simulated
for the device and for every corner of its ranges, with linear mechanics, amplifier, delay and dry friction, the ramps,
the centring and the force limit; the encoder's steps are left out, with a margin of one step for them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi._util.text import number
from avc_casadi._util.units import MotionKind, Units, units_for
from avc_casadi.model.corners import LINEAR_KEYS, device_corners, device_with
from avc_casadi.model.device import Device
from avc_casadi.model.plant import device_plant, transitions

Integers = NDArray[np.int64]

FULL = 32767
"""Units of the largest force."""
KNOTS = 33
WHOLE = 1 << 15
"""An envelope of 1."""
_TURN, _QUARTER = 1 << 32, 1 << 30


@dataclass(frozen=True)
class Signal:
    """Sines under an envelope, in the integers of the device."""

    step: tuple[int, ...]
    phase: tuple[int, ...]
    amplitude: tuple[int, ...]
    growth: int = 0
    knots: tuple[int, ...] = (WHOLE,) * KNOTS

    @classmethod
    def of(
        cls,
        frequency_hz: Sequence[float] | FloatArray,
        amplitude: Sequence[float] | FloatArray,
        phase_rad: Sequence[float] | FloatArray,
        sample_time_s: float,
        *,
        growth_per_tick: float = 0.0,
        knots: Sequence[float] | FloatArray = (1.0,) * KNOTS,
    ) -> Signal:
        """Round to the integers of the device: amplitudes as shares of the largest force, knots from 0 to 1."""
        return cls(
            step=tuple(round(float(one) * _TURN) for one in np.asarray(frequency_hz) * sample_time_s),
            phase=tuple(round(float(one) / (2 * np.pi) * 65536) % 65536 for one in phase_rad),
            amplitude=tuple(round(float(one) * FULL) for one in amplitude),
            growth=round(growth_per_tick * _TURN),
            knots=tuple(round(float(one) * WHOLE) for one in knots),
        )

    def units(self, ticks: int) -> Integers:
        """Return the signal under its envelope, in units, shape (ticks,)."""
        total = np.zeros(ticks, dtype=np.int64)
        for step, phase, amplitude in zip(self.step, self.phase, self.amplitude, strict=True):
            total += amplitude * _sine(_phases(step, phase, self.growth, ticks))
        at = np.arange(ticks, dtype=np.int64) * ((_TURN - 1) // ticks)
        knots = np.array(self.knots, dtype=np.int64)
        low, high = knots[at >> 27], knots[(at >> 27) + 1]
        envelope = low + _over((high - low) * (at >> 12 & 0x7FFF), WHOLE)
        return _over(_over(total, FULL) * envelope, WHOLE)

    def frequency_hz(self, ticks: int, sample_time_s: float) -> tuple[float, float]:
        """Return the lowest and the highest frequency played."""
        hertz = [step / _TURN / sample_time_s for step in self.step]
        return min(hertz), max(hertz) * (1.0 + self.growth / _TURN) ** ticks


def _phases(step: int, phase: int, growth: int, ticks: int) -> Integers:
    start = phase << 16
    if not growth:
        return (start + np.arange(ticks, dtype=np.uint64) * np.uint64(step)).astype(np.int64) & (_TURN - 1)
    phases = np.empty(ticks, dtype=np.int64)
    fine = step << 32
    for tick in range(ticks):
        phases[tick] = start
        whole = fine >> 32
        start = (start + whole) & (_TURN - 1)
        fine = (fine + whole * growth) & ((1 << 64) - 1)
    return phases


def _sine(phase: Integers) -> Integers:
    within = phase & (_QUARTER - 1)
    x = np.where(phase & _QUARTER, _QUARTER - within, within)
    c = (1686624950, 693528462, 85303417, 4658781)
    square = x * x >> 30
    inner = c[1] - (square * (c[2] - (square * c[3] >> 30)) >> 30)
    value = x * (c[0] - (square * inner >> 30)) >> 30
    units = (value * FULL + (_QUARTER >> 1)) >> 30
    return np.asarray(np.where(phase >> 31, -units, units), dtype=np.int64)


def _over(value: Integers, by: int) -> Integers:
    """Divide towards zero, as C does."""
    return np.asarray(np.sign(value) * (np.abs(value) // by), dtype=np.int64)


def ramp(ticks: int, ramp_ticks: int) -> Integers:
    """Return the ramp in and out that the device applies, of 2^15, shape (ticks,)."""
    tick = np.arange(1, ticks + 1, dtype=np.int64)
    near = np.minimum(tick, tick[::-1])
    return np.asarray(np.where(near < ramp_ticks, (near << 15) // ramp_ticks, WHOLE), dtype=np.int64)


def low_crest_phases(frequency_hz: FloatArray, amplitude: FloatArray, time_s: FloatArray) -> FloatArray:
    """Return phases of a multisine with a low crest factor: Schroeder's (1970), refined by norms of rising order."""
    share = amplitude**2 / np.sum(amplitude**2)
    turns = np.outer(time_s, 2 * np.pi * frequency_hz)
    cosine, sine = np.cos(turns) * np.sqrt(2 * share), np.sin(turns) * np.sqrt(2 * share)

    def norm(phase: FloatArray, order: int) -> tuple[float, FloatArray]:
        wave = sine @ np.cos(phase) + cosine @ np.sin(phase)
        size = np.abs(wave)
        top = float(size.max())
        relative = (size / top) ** (order - 1)
        mean = float(np.mean(relative * size / top))
        pull = np.sign(wave) * relative / (wave.size * mean)
        slope = (pull @ cosine) * np.cos(phase) - (pull @ sine) * np.sin(phase)
        return float(np.log(top) + np.log(mean) / order), np.asarray(slope / top, dtype=np.float64)

    phase = np.asarray(-2 * np.pi * np.cumsum(np.concatenate([[0.0], np.cumsum(share)[:-1]])), dtype=np.float64)
    for order in (4, 8, 16, 32):
        result = minimize(norm, phase, args=(order,), jac=True, method="L-BFGS-B", options={"maxiter": 60})
        phase = np.asarray(result.x, dtype=np.float64)
    return phase


Kind = Literal["multisine", "chirp"]


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
        return max(1, round(1.0 / self.sample_time_s))

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
    sensor = 2 if devices[0].resonance is not None and devices[0].encoder_at == "handle" else 0
    shape = len(devices), scales.size
    state = np.zeros((*shape, parts[0][0].shape[-1]))
    commands = np.zeros((int(late.max()) + 2, *shape))
    rows, past, most = np.arange(len(devices)), np.zeros((plan.window, *shape)), np.zeros((3, *shape))
    window_s = plan.window * plan.sample_time_s
    for tick in range(plan.ticks):
        if tick % 500 == 0:
            progress.advance(tick, plan.ticks, "ticks simulated")
        away = state[..., sensor]
        speed = (away - past[tick % plan.window]) / window_s
        past[tick % plan.window] = away
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
    plants = [device_plant(device).linear() for device in devices]
    seconds = [max(share, 1e-9) * one.sample_time_s for one, share in zip(devices, shares.tolist(), strict=True)]
    steps = transitions(list(zip(plants, seconds, strict=True)))
    rubs = transitions([(replace(one, force=one.friction), part) for one, part in zip(plants, seconds, strict=True)])
    matrix, push = np.array([step.matrix.T for step in steps]), np.array([[-step.force] for step in steps])
    return matrix, push, np.array([[step.force] for step in rubs])


_MARGIN = 0.85
"""Share of the limits that a forecast may reach."""


@dataclass(frozen=True, eq=False)
class Excitation:
    """A plan and its forecast: the declared device first, then the corners of its ranges."""

    plan: Plan
    devices: tuple[Device, ...]
    forecast: Forecast

    @property
    def nearest_limit(self) -> str:
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
    most = 10.0  # the firmware's largest speed and travel, in the device's own units
    speed = min(0.3 / reach, most) if speed_m_per_s is None else speed_m_per_s
    travel = 0.02 / reach if travel_m is None else travel_m
    most_n = device.max_force_n or math.inf
    force = 0.5 * most_n if force_n is None else force_n
    faults = [
        Fault("", None, key, f"is {value:g}; allowed: {low:g} to {high:g}")
        for key, value, low, high in (
            ("seconds", seconds, 2.0, 120.0),
            ("force_n", force, 1e-6, most_n if force_n is None else min(most_n, 1e6)),
            ("speed_m_per_s", speed, 1e-3 / reach, min(5.0 / reach, most)),
            ("travel_m", travel, 1e-4 / reach, min(1.0 / reach, most)),
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
    step_m = device.encoder_resolution_m or 2e-6 / reach
    # A step of the encoder is at most a tenth of the speed limit over the window of a velocity.
    fewest = step_m / (0.1 * speed * period)
    window = int(min(max(1, -(-fewest // 1)), 32))
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
    plan = _scale_to_limits(replace(plan, signal=_signal(plan, devices)), devices, progress)
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
        lift = _largest_force_n(plan, devices, low * (high / low) ** np.linspace(0, 1, KNOTS))
        return Signal.of([low], [1.0], [0.0], period, growth_per_tick=growth, knots=lift / lift.max())
    period_s = min(4.0, plan.seconds)
    lines = np.unique(np.round(np.geomspace(low, high, 48) * period_s))
    lines = lines[lines >= 1]
    if plan.seconds > period_s:
        # Shifted lines: in repeats to the encoder's step the rounding would be the same each time.
        lines += 0.03 * (2 * np.modf(np.arange(1, lines.size + 1) * 0.6180339887)[0] - 1)
    frequency = lines / period_s
    size = _largest_force_n(plan, devices, frequency)
    # A peak is resolved to 1 per cent with 24 points in a period of the fastest tone.
    time = np.arange(0, plan.seconds, max(period, 1 / (24 * frequency[-1])), dtype=np.float64)
    phase = low_crest_phases(frequency, size, time)
    wave = np.sin(np.outer(time, 2 * np.pi * frequency) + phase) @ size
    return Signal.of(frequency, size / np.abs(wave).max(), phase, period)


def _largest_force_n(plan: Plan, devices: Sequence[Device], frequency_hz: FloatArray) -> FloatArray:
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


def _scale_to_limits(plan: Plan, devices: Sequence[Device], progress: Progress) -> Plan:
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
