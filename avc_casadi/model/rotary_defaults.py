"""Defaults of a problem with a rotary device: hands, gains and motions of a linear one at its handle.

At the radius r a mass m is an inertia m r^2, a spring k one of k r^2, and a displacement x an angle x/r: the hand, gain
box and motion of a linear problem, at that radius.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel

from avc_casadi.model.quantity import RADII_M

# Kinds of hand as in `Hands`, gains as in `GainBox`, motions as in `_Motion`: powers of the radius.
_HANDS = {
    "mass_kg": ((0.05, 0.3), 2),
    "damping_ns_per_m": ((3.0, 20.0), 2),
    "stiffness_n_per_m": ((200.0, 800.0), 2),
}
_GAINS = {"damping_ns_per_m": ((0.0, 1e4), 2), "stiffness_n_per_m": ((0.0, 1e7), 2)}
_MOTION = {"start_m": (-0.01, -1), "end_m": (0.01, -1), "speed_m_per_s": (0.07, -1)}
_SWINGS = {"amplitude_m": (0.005, -1)}
_SWINGING = {"stroke", "free"}


def with_rotary_defaults(tables: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the tables with the defaults of a rotary device filled in; others are unchanged.

    Args:
        tables: of a problem, as written or as models.
    """
    device = tables.get("device")
    radius = _of(device, "handle_radius_m")
    if _of(device, "motion") != "rotary" or isinstance(radius, bool) or not isinstance(radius, int | float):
        return tables
    if not RADII_M[0] <= radius <= RADII_M[1]:
        return tables  # the radius is the fault to report, not its consequences
    scene = _given(tables.get("scene"))
    found = {
        **tables,
        "hands": _filled(_given(tables.get("hands")), _HANDS, radius),
        "coupling": _filled(_given(tables.get("coupling")), _GAINS, radius),
    }
    if isinstance(scene, Mapping):
        found["scene"] = {**scene, "motion": rotary_motion(scene.get("motion"), radius)}
    return found


def rotary_hands(radius_m: float) -> dict[str, tuple[float, float]]:
    """Return the ranges of the usual hands on a rotary device, by key.

    Args:
        radius_m: of the grip.
    """
    found: dict[str, tuple[float, float]] = _filled({}, _HANDS, radius_m)
    return found


def rotary_gains(radius_m: float) -> dict[str, tuple[float, float]]:
    """Return the default gain box of a rotary device, by key.

    Args:
        radius_m: of its handle.
    """
    found: dict[str, tuple[float, float]] = _filled({}, _GAINS, radius_m)
    return found


def rotary_motion(motion: Any, radius_m: float) -> Any:
    """Return the motion of a hand on a rotary device, with defaults filled in.

    Args:
        motion: as written, as a model, or None.
        radius_m: of the grip.
    """
    table = _given({"kind": "press"} if motion is None else motion)
    if not isinstance(table, Mapping):
        return table
    defaults = _MOTION | (_SWINGS if table.get("kind") in _SWINGING else {})
    return _filled(table, defaults, radius_m)


def _of(table: Any, key: str) -> Any:
    return table.get(key) if isinstance(table, Mapping) else getattr(table, key, None)


def _given(table: Any) -> Any:
    """Return the given keys of a table, its kind included."""
    if not isinstance(table, BaseModel):
        return {} if table is None else table
    kind = {"kind": table.kind} if "kind" in type(table).model_fields else {}  # type: ignore[attr-defined]
    return kind | {key: getattr(table, key) for key in table.model_fields_set}


def _filled(table: Any, defaults: Mapping[str, tuple[Any, int]], radius_m: float) -> Any:
    if not isinstance(table, Mapping):
        return table
    own = {
        key: tuple(end * radius_m**power for end in value) if isinstance(value, tuple) else value * radius_m**power
        for key, (value, power) in defaults.items()
        if key not in table
    }
    return {**table, **own}
