"""Unmodelled effects of a device: less mass, missed samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from avc_casadi.model.corners import device_corners, device_with
from avc_casadi.model.effects import JitterEffect
from avc_casadi.model.quantity import DiskMargin, Force, MassShare, Share
from avc_casadi.model.table import Table

if TYPE_CHECKING:
    from avc_casadi.model.device import Device
    from avc_casadi.model.effects import Effect


class Robustness(Table):
    """Margins beyond [device] and its ranges, and unmodelled effects with each of which all hands must settle."""

    mass_share: MassShare | None = None
    dropped_share: Share | None = None
    disk_margin: DiskMargin | None = None
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


def unmodelled(device: Device, asked: Robustness) -> tuple[Unmodelled, ...]:
    """Return the required effects, one at a time; for a device without mass, dropped samples alone."""
    found = []
    known = device_with(device, {})
    if asked.mass_share is not None and device.mass_kg > 0:
        lowest = min(one.mass_kg for one in device_corners(device, ("mass_kg",)))
        lighter = device_with(device, {"mass_kg": (1 - asked.mass_share) * lowest})
        found.append(Unmodelled("mass_share", asked.mass_share, lighter))
    if asked.dropped_share:
        drops = JitterEffect(rms_s=0.0, dropped_share=asked.dropped_share)
        found.append(Unmodelled("dropped_share", asked.dropped_share, known, (drops,)))
    return tuple(found)
