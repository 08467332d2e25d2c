"""The haptic device as declared; a verb names the keys that it does not use."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, model_serializer

from avc_casadi._errors import UnsupportedError
from avc_casadi._util.units import MotionKind, Units, units_for
from avc_casadi.model import quantity as q
from avc_casadi.model import table as t

_Pitch = Annotated[float, BeforeValidator(q.Quantity("m", 1e-6, 10, zero=False))]
_Width = Annotated[float, BeforeValidator(q.Quantity("", 1e-2, 1, zero=False))]


class Detent(t.Table):
    """Detents at equal distances: F = force sin(2 pi u/width), at u from the nearest valley, a share of the pitch."""

    force_n: q.ForceLimit
    pitch_m: _Pitch
    width: _Width = 1.0
    centre_m: q.Position = 0.0
    damping_ns_per_m: q.Damping = 0.0

    @property
    def slope_n_per_m(self) -> float:
        """The steepest slope: the stiffness in the valleys, and with the other sign at the tops."""
        return 2 * math.pi * self.force_n / (self.width * self.pitch_m)


CURRENT_LOOP_DAMPING_RATIO = 0.7


class Resonance(t.Table):
    """A structural resonance: motor and handle, two shares of the device's mass, joined by a spring."""

    frequency_hz: q.Hertz  # of the two against each other, the device free
    damping_ratio: q.DampingRatio
    mass_ratio: q.MassShare  # of the handle to the whole


class ResonanceRange(t.Table):
    """Ranges of the resonance's values."""

    frequency_hz: q.Pair[q.Hertz] | None = None
    damping_ratio: q.Pair[q.DampingRatio] | None = None
    mass_ratio: q.Pair[q.MassShare] | None = None


class HandledDevice(t.Table):
    """A device with a handle that slides or turns."""

    motion: MotionKind = "linear"
    handle_radius_m: q.Radius | None = None

    @property
    def units(self) -> Units:
        """Names and units in which its values are printed."""
        return units_for(self.motion)

    @property
    def metres_per_unit(self) -> float:
        """Hand displacement for a unit of the position: 1 for a linear device, else the radius of the handle."""
        return 1.0 if self.motion == "linear" else (self.handle_radius_m or 1.0)


class DeviceRange(t.Table):
    """Ranges of the device's values: each value [lowest, highest] about the nominal one, or None."""

    mass_kg: q.Pair[q.Mass] | None = None
    damping_ns_per_m: q.Pair[q.Damping] | None = None
    delay_samples: q.Pair[q.DelaySamples] | None = None
    coulomb_friction_n: q.Pair[q.Force] | None = None
    encoder_resolution_m: q.Pair[q.Length] | None = None
    position_noise_rms_m: q.Pair[q.Length] | None = None
    amplifier_bandwidth_hz: q.Pair[q.Hertz] | None = None
    amplifier_damping_ratio: q.Pair[q.LoopDampingRatio] | None = None
    max_force_n: q.Pair[q.ForceLimit] | None = None
    backlash_m: q.Pair[q.Length] | None = None
    resonance: ResonanceRange = ResonanceRange()


class Device(HandledDevice):
    """The haptic device; an effect with the value 0 or None is absent."""

    # A rotary device has kg.m2 in masses, N.m in forces, rad in lengths.
    mass_kg: q.Mass
    damping_ns_per_m: q.Damping
    sample_time_s: q.SampleTime = 1e-3
    delay_samples: q.DelaySamples = 0
    coulomb_friction_n: q.Force = 0.0
    encoder_resolution_m: q.Length = 0.0
    position_noise_rms_m: q.Length = 0.0
    amplifier_bandwidth_hz: q.Hertz | None = None
    amplifier_order: Literal[1, 2] = 1
    amplifier_damping_ratio: q.LoopDampingRatio = CURRENT_LOOP_DAMPING_RATIO
    max_force_n: q.ForceLimit | None = None
    backlash_m: q.Length = 0.0
    resonance: Resonance | None = None
    encoder_at: Literal["motor", "handle"] = "motor"
    held: Literal["grip", "stylus", "fingertip"] = "grip"
    range: DeviceRange = DeviceRange()

    def faults(self) -> Iterator[t.Finding]:
        """Yield a radius that is missing or means nothing, and ranges that do not hold their value."""
        yield from self._radius_faults()
        yield from _range_faults(self.range, self, ("range",))
        yield from _range_faults(self.range.resonance, self.resonance, ("range", "resonance"))
        if self.resonance is not None and self.mass_kg == 0:
            yield ("mass_kg",), "is 0, but a resonance needs a mass; it must be above 0"

    def _radius_faults(self) -> Iterator[t.Finding]:
        if self.motion == "rotary" and self.handle_radius_m is None:
            message = "is missing; give the radius at which the hand holds the device, 0.002 to 10 m"
            yield ("handle_radius_m",), message
        if self.motion == "linear" and self.handle_radius_m is not None:
            yield ("handle_radius_m",), 'applies to a rotary device only; leave it out, or set motion = "rotary"'

    @model_serializer(mode="wrap")
    def _says_what_is_not_usual(self, whole: Callable[[Any], dict[str, Any]]) -> dict[str, Any]:
        """Serialise without the keys of rotary devices for a linear one, and without the default grip."""
        kept = whole(self)
        if self.held == "grip":
            kept.pop("held", None)
        if self.motion == "linear":
            for key in ("motion", "handle_radius_m"):
                kept.pop(key, None)
        return kept


def _range_faults(ranges: t.Table, nominal: t.Table | None, path: t.Path) -> Iterator[t.Finding]:
    """Yield the ranges of a table that do not hold its nominal value, or hold a device without mass beside others."""
    for key, interval in ranges:
        if not isinstance(interval, tuple):
            continue
        value = getattr(nominal, key, None)
        if value is None:
            yield (*path, key), f"is {t.shown(interval)}, but {key} is missing; give a value of {key} inside this range"
        elif not interval[0] <= value <= interval[1]:
            yield (*path, key), f"is {t.shown(interval)}; it must contain {key} = {t.shown(value)}"
        elif key == "mass_kg" and interval[0] == 0 < interval[1]:
            yield (*path, key), f"is {t.shown(interval)}; it must begin above 0"


def whole_delay(delay_samples: float, taker: str) -> int:
    """Return the delay for a method of whole samples only; the error names what takes no others."""
    whole = int(delay_samples)
    if whole == delay_samples:
        return whole
    raise UnsupportedError(
        f"device.delay_samples is {q.plain(delay_samples)}: {taker} supports whole samples only; round the delay up to "
        f"{whole + 1}, or use the methods direct, exact or closed-form, the certificate levels L0, L1, L3 and L5, or "
        "scenes, which support fractions",
        key="device.delay_samples",
    )
