"""What would allow a stiffer wall: the same search on a device with one property changed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from avc_casadi.loop import with_let_go
from avc_casadi.stability import stiffest_wall

if TYPE_CHECKING:
    from avc_casadi.loop import Hand, StylusHand
    from avc_casadi.problem import Device, Problem


@dataclass(frozen=True)
class Help:
    """One change of the device.

    Attributes:
        change: in words.
        stiffest_wall_n_per_m: the stiffest wall that is then stable with every hand and let go.
    """

    change: str
    stiffest_wall_n_per_m: float


def what_would_help(problem: Problem, extreme: Hand | StylusHand) -> tuple[Help, ...]:
    """Try each change on its own; the most helpful first.

    Args:
        problem: the device as it is.
        extreme: the corners of its hands.
    """
    device = problem.device
    changes: dict[str, dict[str, Any]] = {
        "half the sample time": {"sample_time_s": device.sample_time_s / 2},
        "twice the damping of the device": _twice(device, "damping_ns_per_m"),
        "twice the mass of the device": _twice(device, "mass_kg"),
    }
    if device.delay_samples:
        changes["no delay"] = {"delay_samples": 0, "range": {"delay_samples": None}}
    people = with_let_go(extreme)
    found = [
        Help(change, float(stiffest_wall(problem.changed(device=keys).device, people).stiffness_n_per_m))
        for change, keys in changes.items()
        if keys.get("damping_ns_per_m") != 0 and keys.get("mass_kg") != 0
    ]
    return tuple(sorted(found, key=lambda one: -one.stiffest_wall_n_per_m))


def _twice(device: Device, key: str) -> dict[str, Any]:
    """Double a value, and the range within which it is known."""
    interval = getattr(device.range, key)
    return {
        key: 2 * getattr(device, key),
        "range": {key: None if interval is None else tuple(2 * end for end in interval)},
    }
