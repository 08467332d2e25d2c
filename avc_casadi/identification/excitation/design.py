"""Excitation plans: a D-optimal multisine, a chirp, a sweep at constant speed, a release; each checked beforehand."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi._util.text import number
from avc_casadi.identification.excitation.information import Centring, Room, best_power
from avc_casadi.identification.excitation.plan import Forecast, Kind, Plan, corners_of, forecast, speed_window
from avc_casadi.identification.excitation.signal import FULL, KNOTS, Signal, crest_factor, low_crest_phases
from avc_casadi.model.device import Device
from avc_casadi.model.sampled_plant import device_plant

KINDS: Mapping[Kind, str] = {
    "multisine": "sines of which the sum tells the most of mass, damping, friction and delay",
    "chirp": "one sine whose frequency grows by a constant factor, as strong as the limits allow",
    "sweep": "the same at a constant speed of the device",
    "release": "pulled slowly against a spring and released, to either side",
}
"""Kinds of excitation, with a line for each."""

SECONDS, SPEED_M_PER_S, TRAVEL_M = 10.0, 0.3, 0.02
"""Defaults; of a rotary device at its handle."""
# Limits of the firmware, in the device's own units: lower for a knob than for a slide at the hand.
_FIRMWARE_MOST = 10.0
_FORCE_SHARE = 0.5  # of the device's limit, by default
_USUAL_ENCODER_M = 2e-6
_TONES = 48
_PERIOD_S = 4.0
# Shifts of the tones against each other within a period, in turns, and the number that spreads them evenly.
_DETUNED, _GOLDEN = 0.03, 0.6180339887
# A peak is resolved to 1 per cent with so many points in a period of the fastest tone.
_SEEN = 24.0
_RAMP_S = 0.3
_LOWEST_HZ, _HIGHEST_HZ, _HIGHEST_SHARE = 0.5, 300.0, 0.3
_MARGIN = 0.85  # of the limits that a forecast may reach
_CENTRING_HZ, _CENTRING_RATIO, _LAG_RAD = 1.0, 0.5, 0.3
_SPRING_SHARE = 0.5  # of the force, at the end of the travel
_PULLED, _RELEASED_HZ, _RELEASE_S = 0.6, 5.0, 4.0
_SCALES = np.geomspace(0.02, 1.0, 12)
_FINER = 6
_PEAK = 2.2  # of speed and travel over their root mean squares, before a forecast
_MOVES_STEPS, _MOVES_FRICTION = 10.0, 1.2


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
        UnsupportedError: no weights of the multisine are found.
    """
    reach = device.metres_per_unit
    speed_m_per_s = min(SPEED_M_PER_S / reach, _FIRMWARE_MOST) if speed_m_per_s is None else speed_m_per_s
    travel_m = TRAVEL_M / reach if travel_m is None else travel_m
    _check(device, kind, seconds, force_n, speed_m_per_s, travel_m)
    most_n = force_n or _FORCE_SHARE * (device.max_force_n or math.inf)
    devices = corners_of(device)
    step_m = device.encoder_resolution_m or _USUAL_ENCODER_M / reach
    window = speed_window(step_m, device.sample_time_s, speed_m_per_s)
    centring = _centring(devices, most_n, travel_m, kind, window)
    ticks = round(seconds / device.sample_time_s)
    empty = Plan(
        kind=kind,
        sample_time_s=device.sample_time_s,
        metres_per_count=step_m,
        ticks=ticks,
        ramp_ticks=max(1, min(round(_RAMP_S / device.sample_time_s), ticks // 4, 0xFFFF)),
        max_force_n=most_n,
        max_speed_m_per_s=speed_m_per_s,
        max_travel_m=travel_m,
        spring_n_per_m=centring.spring_n_per_m,
        damper_ns_per_m=centring.damper_ns_per_m,
        window=window,
        signal=Signal((0,), (0,), (0,)),
        motion=device.motion,
    )
    signal = _signal(empty, devices, centring, progress)
    return _scaled(replace(empty, signal=signal), devices, progress)


def peak_force_n(plan: Plan) -> float:
    """Return the largest force of a plan's signal alone."""
    return float(np.abs(plan.signal.units(plan.ticks)).max()) / FULL * plan.max_force_n


def check_plan(plan: Plan, device: Device) -> Forecast:
    """Refuse a plan that takes a device of the ranges beyond the limits.

    Returns:
        Its forecast on the device as declared and at every corner.

    Raises:
        InputError: a limit is exceeded on some device.
    """
    return _checked(plan, corners_of(device))


def _checked(plan: Plan, devices: Sequence[Device], progress: Progress = SILENT) -> Forecast:
    found = forecast(plan, devices, progress=progress)
    faults = _broken(plan, devices, found)
    if faults:
        raise InputError(faults)
    return found


def _broken(plan: Plan, devices: Sequence[Device], found: Forecast) -> list[Fault]:
    faults = []
    for key, reached, most in (
        ("force_n", found.force_n, plan.max_force_n),
        ("speed_m_per_s", found.speed_m_per_s, plan.max_speed_m_per_s),
        ("travel_m", found.travel_m, plan.max_travel_m),
    ):
        worst = int(np.argmax(reached[:, 0]))
        value = float(reached[worst, 0])
        if not value <= most:
            one = devices[worst]
            faults.append(
                Fault(
                    "",
                    None,
                    key,
                    f"would reach {number(value)} on a device of the ranges ({number(one.mass_kg)}, "
                    f"{number(one.damping_ns_per_m)}, {number(one.coulomb_friction_n)} of "
                    f"friction); allowed: {number(most)}",
                )
            )
    return faults


def _check(
    device: Device, kind: str, seconds: float, force_n: float | None, speed_m_per_s: float, travel_m: float
) -> None:
    faults = []
    reach = device.metres_per_unit
    if kind not in KINDS:
        faults.append(Fault("", None, "signal", f"is {kind!r}; allowed: {', '.join(KINDS)}"))
    for key, value, low, high in (
        ("seconds", seconds, 2.0, 120.0),
        ("speed_m_per_s", speed_m_per_s, 1e-3 / reach, min(5.0 / reach, _FIRMWARE_MOST)),
        ("travel_m", travel_m, 1e-4 / reach, min(1.0 / reach, _FIRMWARE_MOST)),
    ):
        if not low <= value <= high:
            faults.append(Fault("", None, key, f"is {value:g}; allowed: {low:g} to {high:g}"))
    most = device.max_force_n or math.inf
    if force_n is not None and not 0 < force_n <= most:
        faults.append(
            Fault(
                "",
                None,
                "force_n",
                f"is {force_n:g}; allowed: above 0, at most {most:g}, the device's",
            )
        )
    if force_n is None and device.max_force_n is None:
        faults.append(
            Fault(
                "",
                None,
                "force_n",
                "is not given and the device states no max_force_n; allowed: give one",
            )
        )
    if device.mass_kg <= 0:
        faults.append(Fault("", None, "device.mass_kg", "is 0; allowed: above 0, a guess with a range will do"))
    if faults:
        raise InputError(faults)


def _centring(devices: Sequence[Device], force_n: float, travel_m: float, kind: Kind, window: int) -> Centring:
    """Return the centring: a spring stiff enough against friction, and a damper for the lightest device."""
    mass = devices[0].mass_kg
    lightest = min(one.mass_kg for one in devices)
    if kind == "release":
        spring = min(force_n / (_PULLED * travel_m), lightest * (2 * np.pi * _RELEASED_HZ) ** 2)
        # No more than compensates the delay: the device oscillates with its own damping.
        late = max(one.delay_samples for one in devices) + 1.5
        return Centring(float(spring), float(spring * late * devices[0].sample_time_s))
    friction = max(one.coulomb_friction_n for one in devices)
    most = _SPRING_SHARE * force_n / travel_m
    # The delay adds little phase lag at the natural frequency of the lightest device on the spring.
    late_s = (max(one.delay_samples for one in devices) + 1.5 + window / 2) * devices[0].sample_time_s
    most = min(most, lightest * (_LAG_RAD / late_s) ** 2)
    spring = min(max(mass * (2 * np.pi * _CENTRING_HZ) ** 2, 2 * friction / travel_m), most)
    return Centring(float(spring), float(2 * _CENTRING_RATIO * np.sqrt(spring * lightest)))


def _signal(empty: Plan, devices: Sequence[Device], centring: Centring, progress: Progress) -> Signal:
    period = empty.sample_time_s
    low = max(_LOWEST_HZ, 2 / empty.seconds)
    high = min(_HIGHEST_HZ, _HIGHEST_SHARE / period)
    if empty.kind == "multisine":
        return _multisine(empty, devices, centring, (low, high), progress)
    if empty.kind == "release":
        repeats = max(1, round(empty.seconds / _RELEASE_S))
        return Signal.of([repeats / empty.seconds], [1.0], [0.0], period, shape="release")
    if empty.kind == "sweep":
        low, high = _sweep_band(empty, devices, centring, low, high)
    growth = (high / low) ** (1 / empty.ticks) - 1
    at = low * (high / low) ** np.linspace(0, 1, KNOTS)
    travel, speed = _allowed(empty, devices, centring, at)
    lift = speed if empty.kind == "sweep" else np.minimum(np.minimum(speed, travel), empty.max_force_n)
    return Signal.of([low], [1.0], [0.0], period, growth_per_tick=growth, knots=lift / lift.max())


def _sweep_band(
    plan: Plan, devices: Sequence[Device], centring: Centring, low: float, high: float
) -> tuple[float, float]:
    """Return the band in which a constant speed stays below the travel limit and the force limit."""
    grid = np.geomspace(low, high, 200)
    travel, speed = _allowed(plan, devices, centring, grid)
    good = (speed <= travel) & (speed <= _MARGIN * plan.max_force_n)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]])))
    # Between two edges; a resonance may cut the band.
    first, past = max(zip(edges[::2], edges[1::2], strict=True), key=lambda run: run[1] - run[0], default=(0, 1))
    if grid[past - 1] < 2 * grid[first]:
        raise InputError.of(
            f"leave no octave for a sweep at {number(plan.max_speed_m_per_s)}; allowed: less "
            f"--speed-m-per-s, more --force-n or --travel-m",
            key="limits",
        )
    return float(grid[first]), float(grid[past - 1])


def _allowed(
    plan: Plan, devices: Sequence[Device], centring: Centring, frequency_hz: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the force of a sine at the travel limit and at the speed limit, each for the most compliant device."""
    s = 2j * np.pi * frequency_hz
    found = []
    for device in devices:
        linear = device_plant(device).linear()
        eye = np.eye(linear.states)
        alone = np.array([np.linalg.solve(one * eye - linear.matrix, -linear.force)[0] for one in s])
        alone = alone * np.exp(-s * plan.sample_time_s * (0.5 + device.delay_samples))
        moves = np.abs(alone / (1 + (centring.spring_n_per_m + centring.damper_ns_per_m * s) * alone))
        rubs = 4 / np.pi * device.coulomb_friction_n
        limits = (plan.max_travel_m / moves, plan.max_speed_m_per_s / (moves * np.abs(s)))
        found.append([_MARGIN * one + rubs for one in limits])
    travel, speed = np.min(found, axis=0)
    return travel, speed


def _multisine(
    plan: Plan, devices: Sequence[Device], centring: Centring, band_hz: tuple[float, float], progress: Progress
) -> Signal:
    period_s = min(_PERIOD_S, plan.seconds)
    lines = np.unique(np.round(np.geomspace(*band_hz, _TONES) * period_s))
    lines = lines[lines >= 1]
    if plan.seconds > period_s:
        # In repeats to the encoder's step the rounding is the same each time.
        lines += _DETUNED * (2 * np.modf(np.arange(1, lines.size + 1) * _GOLDEN)[0] - 1)
    frequency = lines / period_s
    step_s = max(plan.sample_time_s, 1 / (_SEEN * frequency[-1]))
    time = np.asarray(np.arange(0, plan.seconds, step_s), dtype=np.float64)
    # Delay changes the information little.
    unlike = list(
        {(one.mass_kg, one.damping_ns_per_m, one.coulomb_friction_n): one for one in reversed(devices)}.values()
    )
    # The crest factor is known only with the phases: twice is enough.
    crest, phase, power = 1.8, np.zeros(frequency.size), np.zeros(frequency.size)
    for _ in range(2):
        room = Room(
            _MARGIN * plan.max_force_n / crest,
            _MARGIN * plan.max_speed_m_per_s / _PEAK,
            _MARGIN * plan.max_travel_m / _PEAK,
        )
        power = best_power(unlike, frequency, centring, room, plan.ticks, progress)
        phase = low_crest_phases(frequency, power, time)
        wave = np.sin(np.outer(time, 2 * np.pi * frequency) + phase) @ np.sqrt(2 * power)
        crest = crest_factor(wave)
    share = np.sqrt(2 * power) / np.abs(wave).max()
    return Signal.of(frequency, share, phase, plan.sample_time_s)


def _scaled(plan: Plan, devices: Sequence[Device], progress: Progress) -> Excitation:
    """Return the plan scaled to the largest peak that keeps every device off the limits."""
    full = float(np.abs(plan.signal.units(plan.ticks)).max()) / FULL
    scales = _SCALES * _MARGIN / full
    best = _largest(plan, devices, scales, progress)
    finer = np.geomspace(best, min(best * scales[1] / scales[0], scales[-1]), _FINER)
    best = _largest(plan, devices, finer, progress)
    made = replace(plan, signal=_louder(plan.signal, best))
    after = _checked(made, devices, progress)
    _moves(made, devices, after)
    return Excitation(made, tuple(devices), after, crest_factor(made.signal.units(made.ticks).astype(np.float64)))


def _largest(plan: Plan, devices: Sequence[Device], scales: FloatArray, progress: Progress) -> float:
    """Return the largest of rising scales that keeps every device off the limits."""
    found = forecast(plan, devices, scales, progress)
    good = (
        (found.force_n <= plan.max_force_n)
        & (found.speed_m_per_s <= _MARGIN * plan.max_speed_m_per_s)
        & (found.travel_m <= _MARGIN * plan.max_travel_m)
    ).all(axis=0)
    holds = np.flatnonzero(np.cumprod(good))
    if not holds.size:
        raise InputError.of(
            f"would be exceeded with {number(_SCALES[0] * plan.max_force_n)} already by a device of the "
            f"ranges ({number(plan.max_speed_m_per_s)}, {number(plan.max_travel_m)}); allowed: wider "
            "limits or narrower ranges",
            key="limits",
        )
    return float(scales[holds[-1]])


def _louder(signal: Signal, by: float) -> Signal:
    return replace(signal, amplitude=tuple(min(FULL, round(one * by)) for one in signal.amplitude))


def _moves(plan: Plan, devices: Sequence[Device], found: Forecast) -> None:
    """Refuse a plan without a visible motion."""
    steps = float((found.travel_m[:, 0] / plan.metres_per_count).min())
    peak = peak_force_n(plan)
    friction = max(one.coulomb_friction_n for one in devices)
    if steps < _MOVES_STEPS or peak < _MOVES_FRICTION * friction:
        raise InputError.of(
            f"leave {number(peak)}, which moves a device of the ranges by {number(steps)} encoder steps only "
            f"(its friction: up to {number(friction)}); allowed: more --force-n, "
            f"--speed-m-per-s, --travel-m, or narrower ranges",
            key="limits",
        )
