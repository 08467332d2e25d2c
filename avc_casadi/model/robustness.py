"""What a device may be beyond its file: lighter, with samples that are missed, with one more resonance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from avc_casadi.model.corners import device_corners, device_with
from avc_casadi.model.effects import JitterEffect, StructureEffect
from avc_casadi.model.quantity import Hertz, MassShare, Share, Table

if TYPE_CHECKING:
    from avc_casadi.model.device import Device
    from avc_casadi.model.effects import Effect


class Robustness(Table):
    """What the coupling must withstand beyond [device] and its ranges: with each of them all hands must settle.

    Attributes:
        mass_share: the device is lighter by this share of its lowest mass; None: not asked for.
        dropped_share: the computer misses this share of the samples; None: not asked for.
        mode_hz: 0.3 of the mass swing at this frequency beside the motor, damped by 0.02; None: not asked for.
    """

    mass_share: MassShare | None = None
    dropped_share: Share | None = None
    mode_hz: Hertz | None = None


USUAL = Robustness(mass_share=0.2, dropped_share=1e-3, mode_hz=400.0)
"""What is told of every coupling, asked for or not."""


@dataclass(frozen=True)
class Unmodelled:
    """One way in which a device differs from its file.

    Attributes:
        key: of `Robustness`.
        value: its number.
        device: without ranges.
        effects: what a scene has beside what the device declares.
    """

    key: str
    value: float
    device: Device
    effects: tuple[Effect, ...] = ()


def unmodelled(device: Device, asked: Robustness) -> tuple[Unmodelled, ...]:
    """Return what is asked for, one difference at a time; of a device without mass, dropped samples alone.

    Args:
        device: with its ranges.
        asked: what is to be withstood.
    """
    found = []
    known = device_with(device, {})
    if asked.mass_share is not None and device.mass_kg > 0:
        lowest = min(one.mass_kg for one in device_corners(device, ("mass_kg",)))
        lighter = device_with(device, {"mass_kg": (1 - asked.mass_share) * lowest})
        found.append(Unmodelled("mass_share", asked.mass_share, lighter))
    if asked.dropped_share:
        drops = JitterEffect(rms_s=0.0, dropped_share=asked.dropped_share)
        found.append(Unmodelled("dropped_share", asked.dropped_share, known, (drops,)))
    if asked.mode_hz is not None and device.mass_kg > 0:
        part = StructureEffect(frequency_hz=asked.mode_hz)
        found.append(Unmodelled("mode_hz", asked.mode_hz, known, (part,)))
    return tuple(found)
