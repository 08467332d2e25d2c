"""Valid but implausible values: a mistaken unit, or a key without effect."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from avc_casadi._errors import Fault
from avc_casadi.model.device import CURRENT_LOOP_DAMPING_RATIO
from avc_casadi.model.problem import LONGEST_USUAL_S
from avc_casadi.model.quantity import plain, power_at_handle

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem


# Usual values of desktop devices, their walls and hands; 0 is "absent" and never in doubt. For a rotary device they
# apply at its handle.
_USUAL = {
    "device.mass_kg": (0.005, 5),
    "device.damping_ns_per_m": (0, 100),
    "device.sample_time_s": (20e-6, LONGEST_USUAL_S),
    "device.delay_samples": (0, 20),
    "device.coulomb_friction_n": (0, 20),
    "device.encoder_resolution_m": (1e-7, 1e-3),
    "device.position_noise_rms_m": (1e-9, 1e-4),  # a tenth of the coarsest step; trackers have more
    "device.amplifier_bandwidth_hz": (20, 20e3),
    "device.amplifier_damping_ratio": (0.2, 3),
    "device.max_force_n": (0.5, 500),
    "device.backlash_m": (1e-6, 5e-3),
    "device.resonance.frequency_hz": (10, 2e3),
    "device.resonance.damping_ratio": (1e-3, 0.7),
    "environment.damping_ns_per_m": (0, 1e3),
    "environment.stiffness_n_per_m": (50, 1e6),
    "hands.mass_kg": (1e-3, 5),
    "hands.damping_ns_per_m": (0, 200),
    "hands.stiffness_n_per_m": (1, 1e4),
}

# A fraction of a sample that no driver tells apart from none.
_LEAST_DELAY = 0.02


def plausibility(problem: Problem) -> tuple[Fault, ...]:
    """Return the key of each value far from the usual, or without effect; the problem is valid all the same."""
    radius, units = problem.device.metres_per_unit, problem.units
    found: dict[tuple[str, str], None] = {}
    for named, ends in _USUAL.items():
        scale = radius ** -power_at_handle(named)
        lowest, highest = ends if scale == 1 else (float(f"{end * scale:.2g}") for end in ends)
        for key in (named, named.replace("device.", "device.range.", 1)):
            value = _at(problem, key)
            if any(number != 0 and not lowest <= number <= highest for number in _numbers(value)):
                usual = f"{plain(lowest)} to {plain(highest)}"
                found[key, f"is {_written(value)}: usual {usual}; is the unit right?"] = None
    every = (*found, *_seconds(problem), *_idle(problem), *_beyond(problem))
    return tuple(Fault(problem.name, None, units.key(key), units.words(message)) for key, message in every)


def _at(problem: Problem, key: str) -> Any:
    node: Any = problem
    for part in key.split("."):
        node = getattr(node, part, None)
    return node


def _numbers(value: Any) -> tuple[float, ...]:
    return () if value is None else value if isinstance(value, tuple) else (value,)


def _written(value: float | tuple[float, ...]) -> str:
    return f"[{', '.join(map(plain, value))}]" if isinstance(value, tuple) else plain(value)


def _seconds(problem: Problem) -> Iterator[tuple[str, str]]:
    """Yield delays so far below a sample that they may be in seconds."""
    for key in ("device.delay_samples", "device.range.delay_samples"):
        value = _at(problem, key)
        longest = max(_numbers(value), default=0.0)
        if 0 < longest < _LEAST_DELAY:
            samples = longest / problem.device.sample_time_s
            told = f"{plain(longest)} s are {samples:.3g} sample{'' if samples == 1 else 's'}"
            yield key, f"is {_written(value)}, a part of a sample; are seconds meant? {told}"


def _idle(problem: Problem) -> Iterator[tuple[str, str]]:
    device = problem.device
    if device.encoder_at == "handle" and device.resonance is None:
        yield "device.encoder_at", 'is "handle", which says nothing without device.resonance: motor and handle are one'
    if device.amplifier_order == 2 and device.amplifier_bandwidth_hz is None:
        yield "device.amplifier_order", "is 2, which says nothing without device.amplifier_bandwidth_hz"
    current_loop = device.amplifier_order == 2
    for key, said in (
        ("device.amplifier_damping_ratio", device.amplifier_damping_ratio != CURRENT_LOOP_DAMPING_RATIO),
        ("device.range.amplifier_damping_ratio", device.range.amplifier_damping_ratio is not None),
    ):
        if said and not current_loop:
            yield key, "says nothing of a lag: a current loop, which has one, is device.amplifier_order = 2"
    if device.backlash_m > 0 and device.encoder_at == "handle" and device.resonance is not None:
        seen = "between motor and encoder; an encoder at the handle stands beyond it, and nothing here simulates it"
        yield "device.backlash_m", f"is play {seen}"


def _beyond(problem: Problem) -> Iterator[tuple[str, str]]:
    limit, detent, friction = problem.device.max_force_n, problem.detent, problem.device.coulomb_friction_n
    if limit is not None and friction >= limit:
        message = f"is {plain(friction)}, and device.max_force_n {plain(limit)}: nothing that it gives moves it"
        yield "device.coulomb_friction_n", message
    if not any((problem.hands.stiffness_n_per_m[1], problem.hands.damping_ns_per_m[1])):
        yield "hands.stiffness_n_per_m", "is 0, as is their damping: no hand presses, and all settle"
    if detent is not None and limit is not None and detent.force_n > limit:
        yield "detent.force_n", f"is {plain(detent.force_n)}, more than device.max_force_n, {plain(limit)}"
