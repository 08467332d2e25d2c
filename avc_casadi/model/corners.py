"""Corners of a device's declared ranges, at the worst of which every claim must hold, and unmodelled effects."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from avc_casadi._util.arrays import FloatArray
from avc_casadi.model.device import Device, DeviceRange
from avc_casadi.model.effects import Effect, JitterEffect
from avc_casadi.model.quantity import LEAST_DELAY_SAMPLES, DiskMargin, Force, GainMargin, MassShare, Share
from avc_casadi.model.table import Table

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
    intervals: dict[str, tuple[float, float]] = {}
    for table, ranges in (("", device.range), ("resonance.", device.range.resonance)):
        for key in type(ranges).model_fields:
            interval = getattr(ranges, key)
            wanted = keys is None or f"{table}{key}" in keys
            if wanted and isinstance(interval, tuple):
                intervals[f"{table}{key}"] = interval
    return intervals


def device_with(device: Device, values: Mapping[str, float] | Mapping[str, FloatArray]) -> Device:
    """Return a device without ranges, with other values of some keys; a delay that none may have is 0.

    All but the delay may be arrays over hands, of which a plant is made.
    """
    changed: dict[str, Any] = {"range": DeviceRange(), **{key: values[key] for key in values if "." not in key}}
    of_resonance = {key.removeprefix("resonance."): values[key] for key in values if "." in key}
    if of_resonance:
        changed["resonance"] = device.resonance and device.resonance.model_copy(update=of_resonance)
    if changed.get("delay_samples", device.delay_samples) < LEAST_DELAY_SAMPLES:
        changed["delay_samples"] = 0
    return device.model_copy(update=changed)


def devices_with(device: Device, values: Mapping[str, FloatArray]) -> list[Device]:
    """Return m devices without ranges with values of some keys, each of shape (m,)."""
    rows = np.array(list(values.values())).T.tolist()
    return [device_with(device, dict(zip(values, row, strict=True))) for row in rows]


def linear_values(device: Device) -> dict[str, float]:
    """Return the values of a device that decide its linear loop, by key: those of `LINEAR_KEYS` that it has."""
    values: dict[str, float] = {}
    lags = device.amplifier_bandwidth_hz is None or device.amplifier_order == 1
    for key in LINEAR_KEYS:
        if key == "amplifier_damping_ratio" and lags:
            continue
        table, _, inner = key.rpartition(".")
        value = getattr(getattr(device, table) if table else device, inner, None)
        if value is not None:
            values[key] = value
    return values


class Robustness(Table):
    """Required margins: with these errors of [device] and unmodelled effects all hands must settle."""

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
    """Return devices with one effect each that [robustness] requires: a smaller mass, dropped samples.

    For a device without mass, dropped samples alone.
    """
    effects = []
    known = device_with(device, {})
    if required.mass_share is not None and device.mass_kg > 0:
        lowest = min(corner.mass_kg for corner in device_corners(device, ("mass_kg",)))
        lighter = device_with(device, {"mass_kg": (1 - required.mass_share) * lowest})
        effects.append(Unmodelled("mass_share", required.mass_share, lighter))
    if required.dropped_share:
        drops = JitterEffect(rms_s=0.0, dropped_share=required.dropped_share)
        effects.append(Unmodelled("dropped_share", required.dropped_share, known, (drops,)))
    return tuple(effects)
