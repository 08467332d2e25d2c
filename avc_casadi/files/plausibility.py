"""Valid but implausible values: a mistaken unit, or a key without effect."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from avc_casadi._errors import Fault
from avc_casadi.files.device_file import DeviceFile
from avc_casadi.model.admittance import ForceSensor
from avc_casadi.model.device import CURRENT_LOOP_DAMPING_RATIO, Device
from avc_casadi.model.joint import NoDevice
from avc_casadi.model.problem import Impedance, Problem
from avc_casadi.model.quantity import plain
from avc_casadi.model.sensed import SensorDevice, SensorProblem
from avc_casadi.model.table import shown
from avc_casadi.model.unit_text import power_at_handle

DESKTOP = "devices of the catalogue and data sheets of desktop devices, with room to both sides"
ARMS = "the same, up to pedals and arms"
HAND = "what a hand, arm or foot does in publications, with room to both sides"
SENSORS = "data sheets of force sensors; a soft mount or a spring in series is softer, and is doubted"
JUDGED = "a judgement of ours: no source states it"


@dataclass(frozen=True)
class Usual:
    """The usual size of a value, whatever its sign, in the unit of its key; at the handle of a device that turns.

    0 is "absent" and never in doubt. `source` says where the limits come from.
    """

    lowest: float
    highest: float
    source: str


_OF_DEVICE = {
    "mass_kg": Usual(0.005, 30, ARMS),
    "damping_ns_per_m": Usual(0, 100, ARMS),
    "sample_time_s": Usual(20e-6, 20e-3, DESKTOP),
    "delay_samples": Usual(0, 20, DESKTOP),
    "coulomb_friction_n": Usual(0, 20, ARMS),
    "encoder_resolution_m": Usual(1e-7, 1e-3, DESKTOP),
    "position_noise_rms_m": Usual(1e-9, 1e-4, JUDGED),  # a tenth of the coarsest step; trackers have more
    "amplifier_bandwidth_hz": Usual(20, 20e3, DESKTOP),
    "amplifier_damping_ratio": Usual(0.2, 3, JUDGED),
    "max_force_n": Usual(0.5, 2000, ARMS),
    "backlash_m": Usual(1e-6, 5e-3, JUDGED),
    "resonance.frequency_hz": Usual(10, 2e3, DESKTOP),
    "resonance.damping_ratio": Usual(1e-3, 0.7, JUDGED),
}
_OF_SENSOR_DEVICE = {
    "device.drive_bandwidth_hz": Usual(0.5, 2e3, JUDGED),
    "device.max_speed_m_per_s": Usual(0.01, 10, JUDGED),
    # Of 1e3 to 1e6 N/mm, where a number in N/mm stands for N/m, the lower part is doubted.
    "device.force_sensor.stiffness_n_per_m": Usual(5e3, 1e8, SENSORS),
    "device.range.sensor_stiffness_n_per_m": Usual(5e3, 1e8, SENSORS),
    "device.force_sensor.damping_ratio": Usual(1e-3, 1, JUDGED),
    "device.force_sensor.handle_mass_kg": Usual(0.005, 20, JUDGED),
    "device.range.handle_mass_kg": Usual(0.005, 20, JUDGED),
    "device.force_sensor.noise_rms_n": Usual(1e-5, 5, SENSORS),
    "device.force_sensor.resolution_n": Usual(1e-5, 5, SENSORS),
    "device.force_sensor.max_force_n": Usual(1, 2e4, SENSORS),
    "law.admittance.mass_kg": Usual(0.05, 200, HAND),
    "law.admittance.damping_ns_per_m": Usual(0.1, 5e3, HAND),
    "law.admittance.stiffness_n_per_m": Usual(1, 1e5, JUDGED),
    "law.force_feedback.gain": Usual(0.01, 50, JUDGED),
    "contact.stiffness_n_per_m": Usual(50, 1e8, JUDGED),
}
_OF_LAW = {
    "law.stiffness_n_per_m": Usual(1, 2e5, DESKTOP),
    "law.damping_ns_per_m": Usual(1e-3, 1e3, DESKTOP),
    "law.local_damping_ns_per_m": Usual(1e-3, 1e3, DESKTOP),
    "law.integral_n_per_m_s": Usual(0.1, 1e7, JUDGED),
    "law.virtual_mass_kg": Usual(1e-4, 30, ARMS),
    "law.dead_zone_m": Usual(1e-6, 0.02, JUDGED),
    "law.integral_limit_n": Usual(0.01, 2000, ARMS),
    "law.friction_compensation.force_n": Usual(1e-3, 20, ARMS),
    "law.friction_compensation.velocity_m_per_s": Usual(1e-4, 1, JUDGED),
    "law.velocity.samples": Usual(1, 64, JUDGED),  # limits are looked for up to as many
    "law.velocity.cutoff_hz": Usual(1, 1e4, JUDGED),
    "law.velocity.bandwidth_hz": Usual(1, 1e4, JUDGED),
    "law.rate_divider": Usual(1, 100, JUDGED),
}
_STEP = Usual(20e-6, 0.1, "engines from 10 Hz to the rate of a device")
_OF_OTHER_ENDS = {
    "simulation.tool_mass_kg": Usual(1e-3, 100, HAND),
    "simulation.tool_damping_ns_per_m": Usual(0, 1e3, JUDGED),
    "simulation.position_scale": Usual(0.01, 100, JUDGED),
    "simulation.force_scale": Usual(0.01, 100, JUDGED),
    "simulation.stiffness_n_per_m": Usual(1, 1e6, JUDGED),
    "follower.delay_s": Usual(0, 1, JUDGED),
    "follower.return_delay_s": Usual(0, 1, JUDGED),
    "follower.position_scale": Usual(0.01, 100, JUDGED),
    "follower.force_scale": Usual(0.01, 100, JUDGED),
    "follower.stiffness_n_per_m": Usual(1, 1e6, JUDGED),
}
_OF_SURROUNDINGS = {
    "environment.damping_ns_per_m": Usual(0, 1e3, DESKTOP),
    "environment.stiffness_n_per_m": Usual(50, 1e6, DESKTOP),
    "hands.mass_kg": Usual(1e-3, 5, HAND),
    "hands.damping_ns_per_m": Usual(0, 200, HAND),
    "hands.stiffness_n_per_m": Usual(1, 1e4, HAND),
}
USUAL: dict[str, Usual] = {
    **{f"{table}.{key}": usual for table in ("device", "follower") for key, usual in _OF_DEVICE.items()},
    **_OF_SENSOR_DEVICE,
    **_OF_SURROUNDINGS,
    "simulation.step_s": _STEP,
    **_OF_OTHER_ENDS,
    **_OF_LAW,
}
"""Usual values by key, for every kind of file; `range` of a device has those of the device."""

_OF_JOINT = {
    "simulation.step_s": _STEP,
    "simulation.tool_mass_kg": Usual(0, math.inf, "a joint of a robot has no handle, and no usual size"),
}
_SHORT_DELAY_SAMPLES = 0.02
"""A shorter delay is told apart from none by no driver."""
_WIDEST_RANGE = 1e4
"""Ratio of the ends of a range above which one of them is likely in another unit; hands differ by less."""
_OVERCOMPENSATED = 2.0
"""Friction compensation over the declared friction above which one of the two is likely wrong."""


def plausibility(problem: Problem | SensorProblem) -> tuple[Fault, ...]:
    """Return the key of each value far from the usual, or without effect; the problem is valid all the same."""
    # Each doubt once.
    doubts: dict[tuple[str, str], None] = {}
    for named, usual in _usual_in(problem).items():
        ends = _at_handle(named, usual, problem)
        table, _, key = named.partition(".")
        for place in (named, f"{table}.range.{key}") if table in {"device", "follower"} else (named,):
            message = _doubt_of(_value_of(problem, place), *ends)
            if message:
                doubts[place, message] = None
    of_meaning = [(doubt.key, doubt.message) for doubt in _doubts(problem) if doubt.holds]
    every_doubt = (*doubts, *of_meaning)
    units = problem.units
    return tuple(Fault(problem.name, None, units.key(key), units.words(message)) for key, message in every_doubt)


def device_plausibility(file: DeviceFile) -> tuple[Fault, ...]:
    """Return the same of the values of a device file."""
    # Not validated: a slow device has no room for the usual frequencies of a problem.
    no_wall = Impedance(damping_ns_per_m=0.0, stiffness_n_per_m=0.0)
    alone = Problem.model_construct(name=file.name, device=file.device, environment=no_wall)
    return tuple(doubt for doubt in plausibility(alone) if doubt.key.startswith("device."))


def _usual_in(problem: Problem | SensorProblem) -> dict[str, Usual]:
    """Return the usual values in a kind of file."""
    return _OF_JOINT if isinstance(problem.device, NoDevice) else USUAL


def _at_handle(key: str, usual: Usual, problem: Problem | SensorProblem) -> tuple[float, float]:
    """Return the usual ends of a key in the units of a device: of what turns, at the radius of its handle."""
    follower = getattr(problem, "follower", None)
    device = follower if follower is not None and key.startswith("follower.") else problem.device
    scale = device.metres_per_unit ** -power_at_handle(key)
    if scale == 1:
        return usual.lowest, usual.highest
    return float(f"{usual.lowest * scale:.2g}"), float(f"{usual.highest * scale:.2g}")


def _doubt_of(value: Any, lowest: float, highest: float) -> str:
    """Return what is unusual of a number, or of the ends of a range; empty where nothing is."""
    sizes = [abs(number) for number in _numbers(value) if number]
    stated = value[0] if isinstance(value, tuple) and len(set(value)) == 1 else value
    if any(not lowest <= size <= highest for size in sizes):
        return f"is {shown(stated)}: usual {plain(lowest)} to {plain(highest)}; is the unit right?"
    if len(sizes) == 2 and sizes[1] > _WIDEST_RANGE * sizes[0]:
        return f"is {shown(stated)}, whose ends differ by a factor of {sizes[1] / sizes[0]:.2g}; is the unit right?"
    return ""


def _value_of(problem: Problem | SensorProblem, key: str) -> Any:
    """Return the value of a dotted key, or None where a table of it is absent."""
    node: Any = problem
    for part in key.split("."):
        node = getattr(node, part, None)
    return node


def _numbers(value: Any) -> tuple[float, ...]:
    """Return a value, or the ends of a range, as numbers."""
    if value is None:
        return ()
    return value if isinstance(value, tuple) else (value,)


@dataclass(frozen=True)
class _Doubt:
    """Whether values contradict or have no effect, the key of one of them, and why."""

    holds: bool
    key: str
    message: str


def _doubts(problem: Problem | SensorProblem) -> Iterator[_Doubt]:
    """Yield what may be doubted of a problem, whether it holds or not."""
    device = problem.device
    if isinstance(device, Device):
        yield from _doubts_of_device(device)
        yield from _doubts_of_law(problem.law, device)
    if isinstance(device, SensorDevice):
        yield from _doubts_of_sensor(device.force_sensor)
    hands = problem.hands
    loose = not any((hands.stiffness_n_per_m[1], hands.damping_ns_per_m[1]))
    message = "is 0, and so is their damping: these hands cannot press"
    yield _Doubt(loose, "hands.stiffness_n_per_m", message)
    if isinstance(problem, Problem) and problem.detent is not None:
        strong = problem.detent.force_n > (problem.device.max_force_n or math.inf)
        yield _Doubt(strong, "detent.force_n", "is more than device.max_force_n")


def _doubts_of_sensor(sensor: ForceSensor) -> Iterator[_Doubt]:
    """Yield a noise or a step of a force sensor that its limit would hide."""
    most_n = sensor.max_force_n or math.inf
    message = "is at least device.force_sensor.max_force_n: the sensor reads nothing but this"
    yield _Doubt(sensor.noise_rms_n >= most_n, "device.force_sensor.noise_rms_n", message)
    yield _Doubt(sensor.resolution_n >= most_n, "device.force_sensor.resolution_n", message)


def above_half_rate(cutoff_hz: float, period_s: float) -> str:
    """Return what is doubted of the cutoff of a low pass at half the rate of its law or above; empty below."""
    half_rate_hz = 0.5 / period_s
    if cutoff_hz < half_rate_hz:
        return ""
    return f"is {shown(cutoff_hz)}, not below half the sample rate, {plain(half_rate_hz)} Hz; is the unit right?"


def _cutoffs(law: Any) -> Iterator[tuple[str, float]]:
    """Yield the cutoffs of the low passes of a law, by their keys."""
    places = [("velocity", getattr(law, "velocity", None))]
    places += [(f"filters[{place}]", item) for place, item in enumerate(getattr(law, "filters", ()))]
    for place, table in places:
        cutoff_hz = getattr(table, "cutoff_hz", None)
        if cutoff_hz is not None:
            yield f"law.{place}.cutoff_hz", cutoff_hz


def _doubts_of_law(law: Any, device: Device) -> Iterator[_Doubt]:
    """Yield low passes that hardly filter, and a friction compensation far above the friction."""
    for key, cutoff_hz in _cutoffs(law):
        message = above_half_rate(cutoff_hz, law.period_s(device.sample_time_s))
        yield _Doubt(bool(message), key, message)
    compensation = getattr(law, "friction_compensation", None)
    if compensation is not None and device.coulomb_friction_n:
        far_above = compensation.force_n > _OVERCOMPENSATED * device.coulomb_friction_n
        message = f"is {shown(compensation.force_n)}, and device.coulomb_friction_n {shown(device.coulomb_friction_n)}"
        yield _Doubt(far_above, "law.friction_compensation.force_n", f"{message}: it drives the device by itself")


def _doubts_of_device(device: Device) -> Iterator[_Doubt]:
    """Yield values of a device that contradict each other or have no effect."""
    limit_n = device.max_force_n
    encoder_at_handle = device.encoder_at == "handle"
    rigid = device.resonance is None
    for key in ("device.delay_samples", "device.range.delay_samples"):
        value = device.delay_samples if key == "device.delay_samples" else device.range.delay_samples
        short = 0 < max(_numbers(value), default=0.0) < _SHORT_DELAY_SAMPLES
        yield _Doubt(short, key, f"is {shown(value)}, less than one sample; is it in seconds? The unit is samples")
    message = 'is "handle", which has no effect without device.resonance'
    yield _Doubt(encoder_at_handle and rigid, "device.encoder_at", message)
    unlimited = device.amplifier_order == 2 and device.amplifier_bandwidth_hz is None
    message = "is 2, which has no effect without device.amplifier_bandwidth_hz"
    yield _Doubt(unlimited, "device.amplifier_order", message)
    is_lag = device.amplifier_order == 1
    given = device.amplifier_damping_ratio != CURRENT_LOOP_DAMPING_RATIO
    ranged = device.range.amplifier_damping_ratio is not None
    message = "has an ideal amplifier; for a current loop set device.amplifier_order = 2"
    yield _Doubt(given and is_lag, "device.amplifier_damping_ratio", message)
    yield _Doubt(ranged and is_lag, "device.range.amplifier_damping_ratio", message)
    beyond = device.backlash_m > 0 and encoder_at_handle and not rigid
    message = "is play between motor and encoder, and has no effect with an encoder at the handle"
    yield _Doubt(beyond, "device.backlash_m", message)
    stuck = limit_n is not None and device.coulomb_friction_n >= limit_n
    message = "is at least device.max_force_n: the actuator cannot move the device"
    yield _Doubt(stuck, "device.coulomb_friction_n", message)
