"""Excitation plans: a multisine or a chirp, as strong as the limits allow on every corner of the ranges.

The signal is in the integer arithmetic of the device (`signal`). Before any motion a plan is simulated
for the device and for every corner of its ranges, with linear mechanics, amplifier, delay and dry friction, the ramps,
the centring and the force limit; the encoder's steps are left out, with a margin of one step for them.

A plan is the same on every processor, and a small change of the device changes it little: the last bits of a matrix
product decide nothing. Phases come from a fixed number of smooth steps, the strength from an interpolation of the
forecast's peaks, and numbers that become whole ones do not change over at a natural value (`HAIR`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi._util.text import number
from avc_casadi._util.units import MotionKind, Units, units_for
from avc_casadi.identification.signal import FULL, HAIR, KNOTS, WHOLE, Integers, Kind, Signal, low_crest_phases, ramp
from avc_casadi.model.corners import LINEAR_KEYS, device_corners, device_with
from avc_casadi.model.device import Device
from avc_casadi.model.plant import device_plant, transitions

SILENCE_S = 1.0
"""Time without a message from the host after which the device stops."""


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
        return {
            "force_n": self.max_force_n,
            "speed_m_per_s": self.max_speed_m_per_s,
            "travel_m": self.max_travel_m,
        }


@dataclass(frozen=True, eq=False)
class Forecast:
    """Largest magnitudes, each of shape (devices, scales)."""

    force_n: FloatArray
    """Signal with centring."""
    speed_m_per_s: FloatArray
    """Over the window, with a step of the encoder."""
    travel_m: FloatArray
    """To either side, with a step of the encoder."""
    stroke_m: FloatArray
    """From end to end, without the encoder."""


@dataclass(frozen=True)
class ExcitationFigures:
    """Figures of a played excitation: how it ended, what was recorded and lost, and the largest values."""

    port: str
    end: str
    whole: bool
    records: int
    lost: int
    seconds: float
    peak_force_n: float
    peak_speed_m_per_s: float
    peak_travel_m: float


def corners_of(device: Device) -> list[Device]:
    """Return the device itself, then the corners of its ranges of mechanics, delay and friction."""
    whole = device_with(device, {})
    corners = device_corners(device, (*LINEAR_KEYS, "coulomb_friction_n"))
    return [whole, *(corner for corner in corners if corner != whole)]


_TICKS_PER_REPORT = 500
"""Ticks of a simulation between two reports of its progress."""


def forecast(
    plan: Plan, devices: Sequence[Device], scales: Sequence[float] | FloatArray = (1.0,), progress: Progress = SILENT
) -> Forecast:
    """Return the largest force, speed and stroke of a plan on each device at each scale of its signal, simulated.

    Devices have one structure; arrays have shape (devices, scales).
    """
    scales = np.asarray(scales)
    signal = plan.signal.units(plan.ticks) * (plan.max_force_n / FULL)
    fade = ramp(plan.ticks, plan.ramp_ticks) / WHOLE
    parts = _parts(devices)
    late = np.stack([part.late for part in parts])
    rubs = np.array([[device.coulomb_friction_n] for device in devices])
    sensor = 2 if devices[0].resonance is not None and devices[0].encoder_at == "handle" else 0
    shape = len(devices), scales.size
    state = np.zeros((*shape, parts[0].matrix.shape[-1]))
    commands = np.zeros((int(late.max()) + 2, *shape))
    rows = np.arange(len(devices))
    past = np.zeros((plan.window, *shape))
    largest_force = np.zeros(shape)
    largest_speed = np.zeros(shape)
    highest = np.zeros(shape)
    lowest = np.zeros(shape)
    window_s = plan.window * plan.sample_time_s
    for tick in range(plan.ticks):
        if tick % _TICKS_PER_REPORT == 0:
            progress.advance(tick, plan.ticks, "ticks simulated")
        away = state[..., sensor]
        speed = (away - past[tick % plan.window]) / window_s
        past[tick % plan.window] = away
        force = (signal[tick] * scales - plan.spring_n_per_m * away - plan.damper_ns_per_m * speed) * fade[tick]
        largest_force = np.maximum(largest_force, np.abs(force))
        largest_speed = np.maximum(largest_speed, np.abs(speed))
        highest = np.maximum(highest, away)
        lowest = np.minimum(lowest, away)
        commands[tick % len(commands)] = np.clip(force, -plan.max_force_n, plan.max_force_n)
        acting = commands[(tick - late) % len(commands), rows]
        for part, acts in zip(parts, acting, strict=True):
            state = state @ part.matrix + part.push * acts[..., None]
            state = state + part.rub * np.clip(state[..., 1] / -part.rub[..., 1], -rubs, rubs)[..., None]
    return Forecast(
        force_n=largest_force,
        speed_m_per_s=largest_speed + plan.metres_per_count / window_s,
        travel_m=np.maximum(highest, -lowest) + plan.metres_per_count,
        stroke_m=highest - lowest,
    )


@dataclass(frozen=True, eq=False)
class _Part:
    """A share of a sample over which force and friction are constant, of each device."""

    late: Integers
    """Age of the force that acts, ticks, shape (devices,)."""
    matrix: FloatArray
    """Transition of a row of states, shape (devices, states, states)."""
    push: FloatArray
    """Effect of the force, shape (devices, 1, states)."""
    rub: FloatArray
    """Effect of dry friction, shape (devices, 1, states)."""


_LEAST_PART = 1e-12
"""Shortest part of a sample that is simulated, in samples: one of no length has no friction to divide by."""


def _parts(devices: Sequence[Device]) -> list[_Part]:
    """Return the parts of a sample: one ends where the newer force arrives, and another in the middle, for friction."""
    whole = np.array([int(device.delay_samples) for device in devices])
    arrival = np.array([device.delay_samples for device in devices]) - whole
    halves = [_part(devices, np.full(whole.size, 0.5), whole)] * 2
    if not arrival.any():
        return halves
    first, second = np.minimum(arrival, 0.5), np.maximum(arrival, 0.5)
    return [
        _part(devices, first, whole + 1),
        _part(devices, second - first, np.where(arrival > 0.5, whole + 1, whole)),
        _part(devices, 1 - second, whole),
    ]


def _part(devices: Sequence[Device], shares: FloatArray, late: Integers) -> _Part:
    """Return the transitions of devices over a share of a sample each: by state, motor force and friction.

    `late` is how many samples old the acting force is.
    """
    plants = [device_plant(device).linear() for device in devices]
    rubbed = [replace(plant, force=plant.friction) for plant in plants]
    periods_s = np.array([device.sample_time_s for device in devices])
    seconds = (np.maximum(shares, _LEAST_PART) * periods_s).tolist()
    steps = transitions(list(zip(plants, seconds, strict=True)))
    rubs = transitions(list(zip(rubbed, seconds, strict=True)))
    return _Part(
        late,
        matrix=np.array([step.matrix.T for step in steps]),
        push=np.array([[-step.force] for step in steps]),
        rub=np.array([[step.force] for step in rubs]),
    )


_MARGIN = 0.85
"""Share of the limits of speed and travel that a forecast may reach, and of the force limit that the signal may."""
_FORCE_MARGIN = 0.99
"""Share of the force limit that signal and centring may reach together; rounded amplitudes take 0.1 per cent of it."""
_LEAST_SCALE = 0.02
"""Least share of the largest force that is of use: its tones still have tens of the units in which they are rounded."""
_COARSE_SCALES = 12
"""Scales of the signal that are simulated at once over the whole range."""
_FINE_SCALES = 16
"""Scales that are simulated at once within one step of the coarse ones to either side."""
_FEWEST_STEPS = 13.0
"""Encoder steps from end to end by which every device must move: `avc identify` needs 12, and rounding may take one."""
_LEAST_OVER_FRICTION = 1.2
"""Least share of the dry friction that the signal must reach."""
SECONDS = 10.0
"""Usual duration of an excitation."""


@dataclass(frozen=True, eq=False)
class Excitation:
    """A plan and its forecast: the declared device first, then the corners of its ranges."""

    plan: Plan
    devices: tuple[Device, ...]
    forecast: Forecast

    @property
    def nearest_limit(self) -> str:
        """The limit that the worst device of the ranges comes nearest: force_n, speed_m_per_s or travel_m."""
        shares = _shares_of_limits(self.plan, self.forecast, np.ones(1))
        return max(shares, key=lambda key: float(shares[key][0]))


def _shares_of_limits(plan: Plan, after: Forecast, scales: FloatArray) -> dict[str, FloatArray]:
    """Return the largest shares that any device reaches of what it may reach, by limit, each of shape (scales,)."""
    alone = scales * plan.peak_force_n / (_MARGIN * plan.max_force_n)
    together = after.force_n.max(axis=0) / (_FORCE_MARGIN * plan.max_force_n)
    return {
        "force_n": np.maximum(alone, together),
        "speed_m_per_s": after.speed_m_per_s.max(axis=0) / (_MARGIN * plan.max_speed_m_per_s),
        "travel_m": after.travel_m.max(axis=0) / (_MARGIN * plan.max_travel_m),
    }


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
    """Plan an excitation that takes no device of the ranges beyond the limits."""
    limits = _Limits.of(device, seconds, force_n, speed_m_per_s, travel_m)
    devices = corners_of(device)
    plan = _without_signal(device, devices, kind, seconds, limits)
    plan = _scale_to_limits(replace(plan, signal=_signal(plan, devices)), devices, progress)
    after = forecast(plan, devices, progress=progress)
    steps = float((after.stroke_m[:, 0] / plan.metres_per_count).min())
    friction = max(device.coulomb_friction_n for device in devices)
    if steps < _FEWEST_STEPS or plan.peak_force_n < _LEAST_OVER_FRICTION * friction:
        raise InputError.of(
            f"allow a force of {number(plan.peak_force_n)} only, which moves a device of the ranges by {number(steps)} "
            f"encoder steps (its friction: up to {number(friction)}), too little; allow more force, speed or travel, "
            "or narrow the ranges",
            key="limits",
        )
    return Excitation(plan, tuple(devices), after)


_MOST_OF_FIRMWARE = 10.0
"""The firmware's largest speed and travel, in the device's own units: m/s and m, or rad/s and rad."""
_USUAL_SPEED_M_PER_S = 0.3
"""Usual speed limit, at the handle."""
_USUAL_TRAVEL_M = 0.02
"""Usual travel limit to either side, at the handle."""
_SECONDS = (2.0, 120.0)
"""Allowed durations."""
_FORCES_N = (1e-6, 1e6)
"""Allowed force limits, within the device's own."""
_SPEEDS_M_PER_S = (1e-3, 5.0)
"""Allowed speed limits, at the handle."""
_TRAVELS_M = (1e-4, 1.0)
"""Allowed travel limits, at the handle."""


@dataclass(frozen=True)
class _Limits:
    """Limits of an excitation in the units of the device."""

    force_n: float
    speed_m_per_s: float
    travel_m: float

    @classmethod
    def of(
        cls,
        device: Device,
        seconds: float,
        force_n: float | None,
        speed_m_per_s: float | None,
        travel_m: float | None,
    ) -> _Limits:
        """Return the limits given or the usual ones; refuse what the firmware or the device does not allow."""
        reach = device.metres_per_unit
        most = _MOST_OF_FIRMWARE
        speed = min(_USUAL_SPEED_M_PER_S / reach, most) if speed_m_per_s is None else speed_m_per_s
        travel = _USUAL_TRAVEL_M / reach if travel_m is None else travel_m
        most_n = device.max_force_n or math.inf
        force = 0.5 * most_n if force_n is None else force_n
        allowed = {
            "seconds": (seconds, *_SECONDS),
            "force_n": (force, _FORCES_N[0], most_n if force_n is None else min(most_n, _FORCES_N[1])),
            "speed_m_per_s": (speed, _SPEEDS_M_PER_S[0] / reach, min(_SPEEDS_M_PER_S[1] / reach, most)),
            "travel_m": (travel, _TRAVELS_M[0] / reach, min(_TRAVELS_M[1] / reach, most)),
        }
        faults = [
            Fault("", None, key, f"is {value:g}; allowed: {low:g} to {high:g}")
            for key, (value, low, high) in allowed.items()
            if not low <= value <= high
        ]
        if math.isinf(force):
            faults.append(Fault("", None, "force_n", "is missing, and so is device.max_force_n; give one of the two"))
        if device.mass_kg <= 0:
            faults.append(
                Fault("", None, "device.mass_kg", "is 0; give a value above 0, a guess with a range is enough")
            )
        if faults:
            raise InputError(faults)
        return cls(force, speed, travel)


_UNDECLARED_STEP_M = 2e-6
"""Step of an encoder that is not declared, at the handle."""
_STEP_SHARE = 0.1
"""Largest share of the speed limit that a step of the encoder makes over the window of a velocity."""
_LONGEST_WINDOW = 32
"""Longest window of the firmware, ticks."""
_LARGEST_LAG_RAD = 0.3
"""Largest phase of the delay at the natural frequency of the lightest device on the centring spring."""
_RAMP_S = 0.3
"""Duration of the ramps in and out."""


def _without_signal(device: Device, devices: Sequence[Device], kind: Kind, seconds: float, limits: _Limits) -> Plan:
    """Return the plan with its window, spring, damper and ramps, before it has a signal."""
    period = device.sample_time_s
    force = limits.force_n
    travel = limits.travel_m
    step_m = device.encoder_resolution_m or _UNDECLARED_STEP_M / device.metres_per_unit
    # A step of the encoder is at most a share of the speed limit over the window of a velocity.
    fewest = step_m / (_STEP_SHARE * limits.speed_m_per_s * period)
    window = min(max(1, math.ceil(fewest * (1 - HAIR))), _LONGEST_WINDOW)
    # The delay of the force, of its hold and of the velocity over its window.
    lightest = min(corner.mass_kg for corner in devices)
    late_s = (max(corner.delay_samples for corner in devices) + 1.5 + window / 2) * period
    friction = max(corner.coulomb_friction_n for corner in devices)
    stiffest = min(0.5 * force / travel, lightest * (_LARGEST_LAG_RAD / late_s) ** 2)
    spring = float(min(max(device.mass_kg * (2 * np.pi) ** 2, 2 * friction / travel), stiffest))
    ticks = _whole(seconds / period)
    return Plan(
        kind=kind,
        sample_time_s=period,
        metres_per_count=step_m,
        ticks=ticks,
        ramp_ticks=max(1, min(_whole(_RAMP_S / period), ticks // 4, 0xFFFF)),
        max_force_n=force,
        max_speed_m_per_s=limits.speed_m_per_s,
        max_travel_m=travel,
        spring_n_per_m=spring,
        damper_ns_per_m=float(np.sqrt(spring * lightest)),
        window=window,
        signal=Signal((0,), (0,), (0,)),
        motion=device.motion,
    )


def _whole(value: float) -> int:
    """Round to a whole number, a half and what is a hair below it upwards."""
    return math.floor(value * (1 + HAIR) + 0.5)


_LOWEST_HZ = 0.5
_HIGHEST_HZ = 300.0
_HIGHEST_SHARE = 0.3
"""Highest frequency as a share of the sampling rate."""
_LONGEST_PERIOD_S = 4.0
"""Longest period of a multisine; a longer excitation repeats it."""
_TONES = 48
"""Tones of a multisine, fewer where lines coincide."""
_SHIFT = 0.03
"""Largest shift of a line, in lines."""
_GOLDEN = 0.6180339887
"""The golden ratio less 1, whose multiples scatter evenly."""
_POINTS_PER_PERIOD = 24
"""Points in a period of the fastest tone: they resolve a peak to 1 per cent."""


def _signal(plan: Plan, devices: Sequence[Device]) -> Signal:
    """Return the signal of a plan, chirp or multisine: its size over frequency is what force, speed and travel allow.

    The tones of a multisine have phases that keep its peak low.
    """
    period = plan.sample_time_s
    low = max(_LOWEST_HZ, 2 / plan.seconds)
    high = min(_HIGHEST_HZ, _HIGHEST_SHARE / period)
    if plan.kind == "chirp":
        growth = (high / low) ** (1 / plan.ticks) - 1
        lift = _largest_force_n(plan, devices, low * (high / low) ** np.linspace(0, 1, KNOTS))
        return Signal.of([low], [1.0], [0.0], period, growth_per_tick=growth, knots=lift / lift.max())
    period_s = min(_LONGEST_PERIOD_S, plan.seconds)
    lines = np.unique([float(_whole(line)) for line in np.geomspace(low, high, _TONES) * period_s])
    lines = lines[lines >= 1]
    if plan.seconds > period_s:
        # Shifted lines: in repeats to the encoder's step the rounding would be the same each time.
        lines += _SHIFT * (2 * np.modf(np.arange(1, lines.size + 1) * _GOLDEN)[0] - 1)
    frequency = lines / period_s
    size = _largest_force_n(plan, devices, frequency)
    step_s = max(period, 1 / (_POINTS_PER_PERIOD * float(frequency[-1])))
    time = step_s * np.arange(_whole(plan.seconds / step_s), dtype=np.float64)
    speed = 2j * np.pi * frequency * _position_per_force(plan, devices[0], frequency)
    phase = low_crest_phases(frequency, size, time, speed)
    wave = np.sin(np.outer(time, 2 * np.pi * frequency) + phase) @ size
    return Signal.of(frequency, size / np.abs(wave).max(), phase, period)


def _position_per_force(plan: Plan, device: Device, frequency_hz: FloatArray) -> ComplexArray:
    """Return how a device moves for a force of the signal, beside spring and damper, without friction."""
    s = 2j * np.pi * frequency_hz
    linear = device_plant(device).linear()
    matrices = s[:, None, None] * np.eye(linear.states) - linear.matrix
    alone = -np.linalg.solve(matrices, linear.force[:, None])[:, 0, 0]
    alone = alone * np.exp(-s * plan.sample_time_s * (0.5 + device.delay_samples))
    return np.asarray(alone / (1 + (plan.spring_n_per_m + plan.damper_ns_per_m * s) * alone), dtype=np.complex128)


def _largest_force_n(plan: Plan, devices: Sequence[Device], frequency_hz: FloatArray) -> FloatArray:
    """Return the force of a sine that force, speed and travel limit allow on the most compliant device."""
    forces = [np.full(frequency_hz.size, plan.max_force_n)]
    for device in devices:
        moves = np.abs(_position_per_force(plan, device, frequency_hz))
        limits = plan.max_travel_m / moves, plan.max_speed_m_per_s / (moves * 2 * np.pi * frequency_hz)
        forces += [_MARGIN * limit + 4 / np.pi * device.coulomb_friction_n for limit in limits]
    return np.asarray(np.min(forces, axis=0))


def _scale_to_limits(plan: Plan, devices: Sequence[Device], progress: Progress) -> Plan:
    """Return the plan scaled until a device reaches a limit.

    The largest share of a limit that is reached, of all devices, is a continuous function of the scale, and rises. Its
    logarithm is interpolated over that of the scale, between scales over the whole range, then between those near the
    crossing. So the scale is a continuous function of the device. It is within 0.1 per cent of the crossing.
    """
    whole = _MARGIN * plan.max_force_n / plan.peak_force_n
    scales = np.geomspace(_LEAST_SCALE, 1.0, _COARSE_SCALES) * whole
    reached = _share_of_limits(plan, devices, scales, progress)
    if reached[0] > 1:
        raise InputError.of(
            f"(speed {number(plan.max_speed_m_per_s)}, travel {number(plan.max_travel_m)}) are exceeded by a device "
            f"of the ranges with a force of {number(_LEAST_SCALE * plan.max_force_n)} already; raise the limits, or "
            "narrow the ranges",
            key="limits",
        )
    ratio = scales[1] / scales[0]
    scales = _crossing(scales, reached) * np.geomspace(1 / ratio, ratio, _FINE_SCALES)
    scale = _crossing(scales, _share_of_limits(plan, devices, scales, progress))
    amplitude = tuple(min(FULL, round(units * scale)) for units in plan.signal.amplitude)
    return replace(plan, signal=replace(plan.signal, amplitude=amplitude))


def _share_of_limits(plan: Plan, devices: Sequence[Device], scales: FloatArray, progress: Progress) -> FloatArray:
    """Return the largest share that any device reaches of any limit, shape (scales,)."""
    shares = _shares_of_limits(plan, forecast(plan, devices, scales, progress), scales)
    return np.asarray(np.max(list(shares.values()), axis=0))


def _crossing(scales: FloatArray, reached: FloatArray) -> float:
    """Return the scale at which a share of 1 is first reached, or the nearest scale."""
    rising = np.log(np.maximum.accumulate(reached))
    return float(np.exp(np.interp(0.0, rising, np.log(scales))))
