"""Valid but implausible values: a mistaken unit, or a key without effect."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from avc_casadi._errors import Fault
from avc_casadi._util.units import FORCE, KG, METRE, N_PER_M, NEWTON, NS_PER_M, Wording, in_its_units, spoken_key
from avc_casadi.model.device import CURRENT_LOOP_DAMPING_RATIO
from avc_casadi.model.problem import LONGEST_USUAL_S
from avc_casadi.model.quantity import plain, power_at_handle

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem


@dataclass(frozen=True)
class _Usual:
    lowest: float
    highest: float
    unit: str | Wording


# Usual values of desktop devices, their walls and hands; 0 is "absent" and never in doubt. For a rotary device they
# apply at its handle.
_USUAL = {
    "device.mass_kg": _Usual(0.005, 5, KG),
    "device.damping_ns_per_m": _Usual(0, 100, NS_PER_M),
    "device.sample_time_s": _Usual(20e-6, LONGEST_USUAL_S, "s"),
    "device.delay_samples": _Usual(0, 20, "samples"),
    "device.coulomb_friction_n": _Usual(0, 20, NEWTON),
    "device.encoder_resolution_m": _Usual(1e-7, 1e-3, METRE),
    "device.position_noise_rms_m": _Usual(1e-9, 1e-4, METRE),  # a tenth of the coarsest step; trackers have more
    "device.amplifier_bandwidth_hz": _Usual(20, 20e3, "Hz"),
    "device.amplifier_damping_ratio": _Usual(0.2, 3, ""),
    "device.max_force_n": _Usual(0.5, 500, NEWTON),
    "device.backlash_m": _Usual(1e-6, 5e-3, METRE),
    "device.resonance.frequency_hz": _Usual(10, 2e3, "Hz"),
    "device.resonance.damping_ratio": _Usual(1e-3, 0.7, ""),
    "environment.damping_ns_per_m": _Usual(0, 1e3, NS_PER_M),
    "environment.stiffness_n_per_m": _Usual(50, 1e6, N_PER_M),
    "hands.mass_kg": _Usual(1e-3, 5, KG),
    "hands.damping_ns_per_m": _Usual(0, 200, NS_PER_M),
    "hands.stiffness_n_per_m": _Usual(1, 1e4, N_PER_M),
}

# A fraction of a sample that no driver tells apart from none.
_LEAST_DELAY = 0.02


@in_its_units
def plausibility(problem: Problem) -> tuple[Fault, ...]:
    """Return the values far from the usual, and those without effect; the problem is valid all the same.

    Args:
        problem: a validated problem.

    Returns:
        Key and sentence of each; empty where nothing is in doubt.
    """
    radius = problem.device.metres_per_unit
    found = [
        (key, f"is {_written(value)}: usual {plain(usual.lowest)} to {plain(usual.highest)} {usual.unit}".rstrip())
        for named, usual in ((name, _turned(name, one, radius)) for name, one in _USUAL.items())
        for key in (named, named.replace("device.", "device.range.", 1))
        for value in [_at(problem, key)]
        if any(number != 0 and not usual.lowest <= number <= usual.highest for number in _numbers(value))
    ]
    found = list(dict.fromkeys((key, f"{message}; is the unit right?") for key, message in found))
    every = (
        *found,
        *_seconds(problem),
        *_idle(problem),
        *_beyond(problem),
    )
    return tuple(Fault(problem.name, None, spoken_key(key), message) for key, message in every)


def _turned(key: str, usual: _Usual, radius_m: float) -> _Usual:
    """Return a usual value at the handle in rotary units, to two digits."""
    scale = radius_m ** -power_at_handle(key)
    if scale == 1:
        return usual
    return _Usual(float(f"{usual.lowest * scale:.2g}"), float(f"{usual.highest * scale:.2g}"), usual.unit)


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
        told = (
            f"is {plain(friction)}, and {spoken_key('device.max_force_n')} {plain(limit)}: no {FORCE} that it gives "
            "moves it"
        )
        yield "device.coulomb_friction_n", told
    if not any((problem.hands.stiffness_n_per_m[1], problem.hands.damping_ns_per_m[1])):
        yield "hands.stiffness_n_per_m", "is 0, as is their damping: no hand presses, and all settle"
    if detent is not None and limit is not None and detent.force_n > limit:
        yield (
            "detent.force_n",
            f"is {plain(detent.force_n)}, more than {spoken_key('device.max_force_n')}, {plain(limit)}",
        )
