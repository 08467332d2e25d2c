"""Corners of a device's declared ranges, at the worst of which every claim must hold, and unmodelled effects."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.model.device import Device, DeviceRange
from avc_casadi.model.effects import Effect, JitterEffect
from avc_casadi.model.quantity import LEAST_DELAY_SAMPLES, DiskMargin, Force, GainMargin, MassShare, Share
from avc_casadi.model.table import Table

if TYPE_CHECKING:
    from avc_casadi.model.problem import Problem


LINEAR_KEYS = (
    "mass_kg",
    "damping_ns_per_m",
    "delay_samples",
    "amplifier_bandwidth_hz",
    "amplifier_damping_ratio",
    "resonance.frequency_hz",
    "resonance.damping_ratio",
    "resonance.mass_ratio",
)
"""Keys of a device used by `SampledPlant`."""


def device_corners(device: Device, keys: Collection[str] | None = None) -> list[Device]:
    """Return the devices at the corners of the declared ranges, each without ranges."""
    ends = {key: tuple(sorted(set(interval))) for key, interval in device_ranges(device, keys).items()}
    return [device_with(device, dict(zip(ends, corner, strict=True))) for corner in product(*ends.values())]


def device_draws(device: Device, count: int, seed: int) -> list[Device]:
    """Return devices drawn uniformly within the declared ranges."""
    intervals = device_ranges(device)
    low, high = np.array(list(intervals.values())).T
    drawn = low + (high - low) * np.random.default_rng(seed).random((count, len(low)))
    return devices_with(device, dict(zip(intervals, drawn.T, strict=True)))


def device_ranges(device: Device, keys: Collection[str] | None = None) -> dict[str, tuple[float, float]]:
    """Return the declared ranges by key, such as ``resonance.frequency_hz``; of some keys, or of all."""
    found: dict[str, tuple[float, float]] = {}
    for table, ranges in (("", device.range), ("resonance.", device.range.resonance)):
        for key in type(ranges).model_fields:
            interval = getattr(ranges, key)
            wanted = keys is None or f"{table}{key}" in keys
            if wanted and isinstance(interval, tuple):
                found[f"{table}{key}"] = interval
    return found


def device_with(device: Device, values: Mapping[str, float]) -> Device:
    """Return a device without ranges, with other values of some keys; a delay that none may have is 0."""
    changed: dict[str, Any] = {"range": DeviceRange(), **{key: values[key] for key in values if "." not in key}}
    if inner := {key.removeprefix("resonance."): values[key] for key in values if "." in key}:
        changed["resonance"] = device.resonance and device.resonance.model_copy(update=inner)
    if changed.get("delay_samples", device.delay_samples) < LEAST_DELAY_SAMPLES:
        changed["delay_samples"] = 0
    return device.model_copy(update=changed)


def devices_with(device: Device, values: Mapping[str, FloatArray]) -> list[Device]:
    """Return m devices without ranges with values of some keys, each of shape (m,)."""
    rows = np.array(list(values.values())).T.tolist()
    return [device_with(device, dict(zip(values, row, strict=True))) for row in rows]


def linear_values(device: Device) -> dict[str, float]:
    """Return a device's values of `LINEAR_KEYS`, by key."""
    found: dict[str, float] = {}
    lags = device.amplifier_bandwidth_hz is None or device.amplifier_order == 1
    for key in LINEAR_KEYS:
        if key == "amplifier_damping_ratio" and lags:
            continue
        table, _, inner = key.rpartition(".")
        value = getattr(getattr(device, table) if table else device, inner, None)
        if value is not None:
            found[key] = value
    return found


# Cached: every check of a schedule needs the corners of the same few problems.
@lru_cache(maxsize=16)
def corner_problems(problem: Problem) -> tuple[Problem, ...]:
    """Return the problem at the corners of the ranges of device mass and damping, each device without ranges."""
    corners = device_corners(problem.device, ("mass_kg", "damping_ns_per_m"))
    return tuple(problem.changed(device=corner) for corner in corners)


@lru_cache(maxsize=16)
def least_damped(problem: Problem, credit_ns_per_m: float = 0.0) -> Problem:
    """Return the problem with the lowest damping that its device may have: Re Z_h grows with it."""
    lowest = min(device.damping_ns_per_m for device in device_corners(problem.device, ("damping_ns_per_m",)))
    known = {"damping_ns_per_m": lowest + credit_ns_per_m, "range": {"damping_ns_per_m": None}}
    return problem.changed(device=known)


def margin_over_range(problem: Problem) -> float:
    """Return the Re Z_h of the nominal device at which every device of its range keeps the margin, N.s/m."""
    spread = problem.device.damping_ns_per_m - least_damped(problem).device.damping_ns_per_m
    return problem.stability.margin_ns_per_m + spread


class Robustness(Table):
    """Margins beyond [device] and its ranges, and unmodelled effects with each of which all hands must settle."""

    mass_share: MassShare | None = None
    dropped_share: Share | None = None
    disk_margin: DiskMargin | None = None
    gain_margin: GainMargin = 1.22
    ripple_n: Force | None = None


USUAL = Robustness(mass_share=0.2, dropped_share=1e-3)
"""Effects reported for every coupling, required or not."""


@dataclass(frozen=True)
class Unmodelled:
    """One unmodelled effect."""

    key: str
    value: float
    device: Device
    effects: tuple[Effect, ...] = ()


def unmodelled(device: Device, required: Robustness) -> tuple[Unmodelled, ...]:
    """Return the required effects, one at a time; for a device without mass, dropped samples alone."""
    found = []
    known = device_with(device, {})
    if required.mass_share is not None and device.mass_kg > 0:
        lowest = min(one.mass_kg for one in device_corners(device, ("mass_kg",)))
        lighter = device_with(device, {"mass_kg": (1 - required.mass_share) * lowest})
        found.append(Unmodelled("mass_share", required.mass_share, lighter))
    if required.dropped_share:
        drops = JitterEffect(rms_s=0.0, dropped_share=required.dropped_share)
        found.append(Unmodelled("dropped_share", required.dropped_share, known, (drops,)))
    return tuple(found)
