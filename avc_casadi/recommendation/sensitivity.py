"""Sensitivity of the stiffness limit: devices with one property changed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from avc_casadi.loops.walls import stiffest_wall
from avc_casadi.model.hands import with_released

if TYPE_CHECKING:
    from avc_casadi.model.device import Device
    from avc_casadi.model.hands import Hand, StylusHand
    from avc_casadi.model.problem import Problem


@dataclass(frozen=True)
class Help:
    """One change of the device.

    Attributes:
        change: in words.
        stiffest_wall_n_per_m: the stiffest wall that is then stable with every hand and released; 0 where none is.
    """

    change: str
    stiffest_wall_n_per_m: float


def linear_changes(problem: Problem) -> dict[str, Problem]:
    """Return improvements that linear stability captures, one at a time, with the changed problem."""
    device = problem.device
    keys: dict[str, dict[str, Any]] = {"half the sample time": {"sample_time_s": device.sample_time_s / 2}}
    if device.damping_ns_per_m:
        keys["twice the damping of the device"] = _times(2, device, "damping_ns_per_m")
    if device.mass_kg:
        keys["twice the mass of the device"] = _times(2, device, "mass_kg")
    if device.delay_samples:
        keys["no delay"] = {"delay_samples": 0, "range": {"delay_samples": None}}
    if device.amplifier_bandwidth_hz is not None:
        lags = {"amplifier_bandwidth_hz": None, "amplifier_damping_ratio": None}
        keys["an amplifier without lag"] = {"amplifier_bandwidth_hz": None, "amplifier_order": 1, "range": lags}
    if device.resonance is not None:
        nothing = dict.fromkeys(type(device.resonance).model_fields)
        keys["no resonance"] = {"resonance": None, "encoder_at": "motor", "range": {"resonance": nothing}}
    return {change: problem.changed(device=values) for change, values in keys.items()}


def what_would_help(problem: Problem, extreme: Hand | StylusHand) -> tuple[Help, ...]:
    """Return the limit of a plain spring and damper after each change, most effective first."""
    if problem.environment.stiffness_n_per_m == 0:
        return ()
    people = with_released(extreme)
    found = [
        Help(change, float(stiffest_wall(other.device, people).stiffness_n_per_m))
        for change, other in linear_changes(problem).items()
    ]
    return _ranked(found)


def _ranked(found: list[Help]) -> tuple[Help, ...]:
    return tuple(sorted(found, key=lambda one: -one.stiffest_wall_n_per_m))


def _times(share: float, device: Device, key: str) -> dict[str, Any]:
    """Return a value and its declared range, multiplied."""
    interval = getattr(device.range, key)
    return {
        key: share * getattr(device, key),
        "range": {key: None if interval is None else tuple(share * end for end in interval)},
    }
