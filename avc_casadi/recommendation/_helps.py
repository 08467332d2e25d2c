"""What would allow a stiffer wall: the same search on a device with one property changed."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from avc_casadi._errors import UnsupportedError
from avc_casadi.design.robust import stiffest_robust
from avc_casadi.loop import with_let_go
from avc_casadi.stability import stiffest_wall
from avc_casadi.support import SILENT, Chunked, Progress

if TYPE_CHECKING:
    from avc_casadi.design.robust import Rung
    from avc_casadi.loop import Hand, StylusHand
    from avc_casadi.problem import Device, Problem


@dataclass(frozen=True)
class Help:
    """One change of the device.

    Attributes:
        change: in words.
        stiffest_wall_n_per_m: the stiffest wall that is then stable with every hand and let go; None where the search
            finds none.
    """

    change: str
    stiffest_wall_n_per_m: float | None


def changes(problem: Problem) -> dict[str, Problem]:
    """Return what could be better about a device, each on its own, with the problem that it leaves."""
    device = problem.device
    keys: dict[str, dict[str, Any]] = {"half the sample time": {"sample_time_s": device.sample_time_s / 2}}
    if device.damping_ns_per_m:
        keys["twice the damping of the device"] = _twice(device, "damping_ns_per_m")
    if device.mass_kg:
        keys["twice the mass of the device"] = _twice(device, "mass_kg")
    if device.delay_samples:
        keys["no delay"] = {"delay_samples": 0, "range": {"delay_samples": None}}
    if device.amplifier_bandwidth_hz is not None:
        keys["an amplifier without lag"] = {"amplifier_bandwidth_hz": None, "range": {"amplifier_bandwidth_hz": None}}
    if device.resonance is not None:
        nothing = dict.fromkeys(type(device.resonance).model_fields)
        keys["no resonance"] = {"resonance": None, "encoder_at": "motor", "range": {"resonance": nothing}}
    return {change: problem.changed(device=values) for change, values in keys.items()}


def what_would_help(problem: Problem, extreme: Hand | StylusHand) -> tuple[Help, ...]:
    """Try each change with a plain spring and damper; the most helpful first.

    Args:
        problem: the device as it is.
        extreme: the corners of its hands.
    """
    people = with_let_go(extreme)
    found = [
        Help(change, float(stiffest_wall(other.device, people).stiffness_n_per_m))
        for change, other in changes(problem).items()
    ]
    return _ranked(found)


def what_would_help_robust(
    problem: Problem,
    near: Rung,
    workers: int = 1,
    progress: Progress = SILENT,
    executor: Executor | None = None,
) -> tuple[Help, ...]:
    """Try each change with a robust design; the most helpful first.

    Args:
        problem: the device as it is.
        near: the stiffest wall that it can give.
        workers: processes; more than one start this program anew, so that a script needs its guard.
        progress: told of the changes.
        executor: who works instead, as for `Chunked.run`.
    """
    tried = changes(problem)
    study = Chunked({}, _stiffest, [(other, near) for other in tried.values()], list, things="changes")
    walls = study.run(executor, workers=workers, progress=progress)
    return _ranked([Help(change, wall) for change, wall in zip(tried, walls, strict=True)])


def _stiffest(task: tuple[Problem, Rung]) -> float | None:
    try:
        rung = stiffest_robust(*task)
    except UnsupportedError:
        return None
    return None if rung is None else rung.stiffness_n_per_m


def _ranked(found: list[Help]) -> tuple[Help, ...]:
    return tuple(sorted(found, key=lambda one: -(one.stiffest_wall_n_per_m or 0.0)))


def _twice(device: Device, key: str) -> dict[str, Any]:
    """Double a value, and the range within which it is known."""
    interval = getattr(device.range, key)
    return {
        key: 2 * getattr(device, key),
        "range": {key: None if interval is None else tuple(2 * end for end in interval)},
    }
