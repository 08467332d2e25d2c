"""Valid but implausible values: a mistaken unit, or a key without effect."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from avc_casadi._errors import Fault
from avc_casadi.files.device_file import DeviceFile
from avc_casadi.model.device import CURRENT_LOOP_DAMPING_RATIO
from avc_casadi.model.problem import Impedance, Problem
from avc_casadi.model.quantity import plain
from avc_casadi.model.table import shown
from avc_casadi.model.unit_text import power_at_handle

# Usual values of desktop devices, their walls and hands, in the unit of the key; 0 is "absent" and never in doubt. For
# a rotary device they apply at its handle.
_USUAL = {
    "device.mass_kg": (0.005, 30),  # up to pedals and arms
    "device.damping_ns_per_m": (0, 100),
    "device.sample_time_s": (20e-6, 20e-3),
    "device.delay_samples": (0, 20),
    "device.coulomb_friction_n": (0, 20),
    "device.encoder_resolution_m": (1e-7, 1e-3),
    "device.position_noise_rms_m": (1e-9, 1e-4),  # a tenth of the coarsest step; trackers have more
    "device.amplifier_bandwidth_hz": (20, 20e3),
    "device.amplifier_damping_ratio": (0.2, 3),
    "device.max_force_n": (0.5, 2000),
    "device.backlash_m": (1e-6, 5e-3),
    "device.resonance.frequency_hz": (10, 2e3),
    "device.resonance.damping_ratio": (1e-3, 0.7),
    "environment.damping_ns_per_m": (0, 1e3),
    "environment.stiffness_n_per_m": (50, 1e6),
    "hands.mass_kg": (1e-3, 5),
    "hands.damping_ns_per_m": (0, 200),
    "hands.stiffness_n_per_m": (1, 1e4),
}
_SHORT_DELAY_SAMPLES = 0.02
"""A shorter delay is told apart from none by no driver."""


def plausibility(problem: Problem) -> tuple[Fault, ...]:
    """Return the key of each value far from the usual, or without effect; the problem is valid all the same."""
    radius, units = problem.device.metres_per_unit, problem.units
    # Each doubt once.
    doubts: dict[tuple[str, str], None] = {}
    for named, ends in _USUAL.items():
        scale = radius ** -power_at_handle(named)
        lowest, highest = ends if scale == 1 else (float(f"{end * scale:.2g}") for end in ends)
        for key in (named, named.replace("device.", "device.range.", 1)):
            value = _value_of(problem, key)
            if any(number != 0 and not lowest <= number <= highest for number in _numbers(value)):
                doubts[key, f"is {shown(value)}: usual {plain(lowest)} to {plain(highest)}; is the unit right?"] = None
    of_meaning = [(doubt.key, doubt.message) for doubt in _doubts(problem) if doubt.holds]
    every_doubt = (*doubts, *of_meaning)
    return tuple(Fault(problem.name, None, units.key(key), units.words(message)) for key, message in every_doubt)


def device_plausibility(file: DeviceFile) -> tuple[Fault, ...]:
    """Return the same of the values of a device file."""
    nothing = Impedance(damping_ns_per_m=0.0, stiffness_n_per_m=0.0)
    doubts = plausibility(Problem(name=file.name, device=file.device, environment=nothing))
    return tuple(doubt for doubt in doubts if doubt.key.startswith("device."))


def _value_of(problem: Problem, key: str) -> Any:
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


def _doubts(problem: Problem) -> Iterator[_Doubt]:
    """Yield what may be doubted of a problem, whether it holds or not."""
    device = problem.device
    detent = problem.detent
    hands = problem.hands
    limit_n = device.max_force_n
    encoder_at_handle = device.encoder_at == "handle"
    rigid = device.resonance is None
    for key in ("device.delay_samples", "device.range.delay_samples"):
        value = _value_of(problem, key)
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
    loose = not any((hands.stiffness_n_per_m[1], hands.damping_ns_per_m[1]))
    message = "is 0, and so is their damping: these hands cannot press"
    yield _Doubt(loose, "hands.stiffness_n_per_m", message)
    strong = detent is not None and limit_n is not None and detent.force_n > limit_n
    yield _Doubt(strong, "detent.force_n", "is more than device.max_force_n")
