"""A device that is commanded a force, with a force sensor before its handle: force feedback makes it lighter.

    m dv/dt = f - b v - u,   u = (law of the position) - g f'

f is the force of the sensor, f' the same behind a low pass, u the commanded force, positive against +x as of any law.
Below the low pass a hand moves m/(1 + g), meets the damper b/(1 + g), and a spring k of the law as k/(1 + g).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Literal, Self

from pydantic import BeforeValidator
from scipy.linalg import block_diag

from avc_casadi.model import quantity as q
from avc_casadi.model import table as t
from avc_casadi.model.admittance import (
    AdmittanceDevice,
    AdmittanceProblem,
    ForceSensor,
    HandledProblem,
)
from avc_casadi.model.control_law import ControlLaw, LawNumber, TicksVelocity
from avc_casadi.model.corners import device_ranges, device_with
from avc_casadi.model.device import Device, DeviceRange
from avc_casadi.model.law import Law

_Gain = Annotated[float, BeforeValidator(q.Quantity("", 1e-6, 1e3))]
_GAIN = ("force_feedback", "gain")
_CUTOFF = ("force_feedback", "cutoff_hz")
_LOWEST_CUTOFF_HZ = 1e-3
"""Where a search of cutoffs ends: a lower one hardly feels a force at all."""


class SensedRange(DeviceRange):
    """Ranges of the device's values."""

    delay_samples: q.Pair[q.LoopDelaySamples] | None = None


class SensedDevice(Device):
    """A device that is commanded a force, and the force sensor that it carries.

    A resonance lies between the motor and what carries the sensor. Friction, backlash and the steps of the encoder are
    no part of a linear claim.
    """

    drive: Literal["force"] = "force"
    delay_samples: q.LoopDelaySamples = 0
    force_sensor: ForceSensor
    range: SensedRange = SensedRange()

    def faults(self) -> Iterator[t.Finding]:
        """Yield the faults of any device, and no mass to drive."""
        yield from super().faults()
        if self.mass_kg == 0 and self.resonance is None:
            yield ("mass_kg",), "is 0; allowed: above 0, the mass before the sensor"

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """The declared ranges by key."""
        return device_ranges(self)

    def with_values(self, **values: float) -> Self:
        """Return the device without ranges, with other values of some keys of `[device.range]`, which are valid."""
        changed = device_with(self, values)
        assert isinstance(changed, type(self))  # noqa: S101 - a copy of it
        return changed

    @property
    def beyond_transmission_kg(self) -> float:
        """Its mass between a transmission that gives way and the sensor; 0 where motor and sensor move as one."""
        return 0.0 if self.resonance is None else self.mass_kg * self.resonance.mass_ratio


class ForceFeedback(t.Table):
    """The force of the sensor, added to the motor's: a gain behind a low pass of first order where one is given."""

    gain: _Gain
    cutoff_hz: q.Hertz | None = None

    def law(self, sample_time_s: float) -> Law:
        """Return the law from the sensor's force to the commanded one, -g (1 - p)/(1 - p/z), p = exp(-2 pi f T)."""
        pole = 0.0 if self.cutoff_hz is None else math.exp(-2 * math.pi * self.cutoff_hz * sample_time_s)
        feedback = Law.low_pass(pole, sample_time_s) if pole else Law.gain(1.0, sample_time_s)
        return feedback.times(-self.gain)


class SensedLaw(ControlLaw):
    """The table [law] of a device with a force sensor: what acts on the position, and the force feedback.

    The device has no wall: every piece acts on both sides of position 0. Filters are those of the position's part.
    """

    force_feedback: ForceFeedback | None = None

    @property
    def acts(self) -> bool:
        """Whether it gives any force."""
        return self.force_feedback is not None or super().acts

    def faults(self) -> Iterator[t.Finding]:
        """Yield the faults of any law, and the pieces that are not linear, which are not judged with a sensor."""
        yield from super().faults()
        pieces = {
            ("dead_zone_m",): bool(self.dead_zone_m),
            ("integral_limit_n",): self.integral_limit_n is not None,
            ("friction_compensation",): self.friction_compensation is not None,
            ("rate_divider",): self.rate_divider > 1,
            ("velocity", "kind"): isinstance(self.velocity, TicksVelocity),
        }
        for path, stated in pieces.items():
            if stated:
                yield path, "is not judged on a device with a force sensor; leave it out"

    def law(self, sample_time_s: float) -> Law:
        """Return the law of position and force that the loops see."""
        position = super().law(sample_time_s)
        force = (self.force_feedback or ForceFeedback(gain=0.0)).law(sample_time_s)
        return Law(
            a=block_diag(position.a, force.a),
            b=block_diag(position.b, force.b),
            c=block_diag(position.c, force.c).sum(axis=0, keepdims=True),
            d=block_diag(position.d, force.d).sum(axis=0, keepdims=True),
            sample_time_s=sample_time_s,
        )

    @property
    def gain(self) -> float:
        """The gain of the force feedback."""
        return 0.0 if self.force_feedback is None else self.force_feedback.gain

    @property
    def gain_number(self) -> LawNumber:
        """The gain as a number whose stable values are looked for; about 1 where there is none."""
        return LawNumber(_GAIN, self.gain or 1.0, linear=True)

    def numbers(self, sample_time_s: float, lightest_kg: float | None = None) -> list[LawNumber]:
        """Return its numbers that are not 0, the gain of the force first."""
        numbers = super().numbers(sample_time_s, lightest_kg)
        if self.force_feedback is None:
            return numbers
        cutoff_hz = self.force_feedback.cutoff_hz
        feedback = [self.gain_number] if self.gain else []
        low_pass = (
            [LawNumber(_CUTOFF, cutoff_hz, min(_LOWEST_CUTOFF_HZ, cutoff_hz), unlimited_below=True)]
            if self.gain and cutoff_hz
            else []
        )
        return [*feedback, *numbers, *low_pass]


class ForceFeedbackProblem(HandledProblem):
    """A device with a force sensor that is commanded a force, with its law, its hands and what its handle may touch.

    Example:
        >>> device = {"mass_kg": 4.0, "damping_ns_per_m": 8.0, "sample_time_s": 5e-4}
        >>> sensor = {"stiffness_n_per_m": 2e4, "damping_ratio": 0.2, "handle_mass_kg": 0.3}
        >>> law = {"damping_ns_per_m": 20.0, "force_feedback": {"gain": 1.0, "cutoff_hz": 200.0}}
        >>> rail = avc.ForceFeedbackProblem(device=device | {"force_sensor": sensor}, law=law, name="rail")
        >>> rail.apparent_mass_kg
        2.0
    """

    device: SensedDevice
    law: SensedLaw | None = None

    def faults(self) -> Iterator[t.Finding]:
        """Yield what of the law the device cannot run or bear."""
        if self.law is not None:
            faults = self.law.faults_beside(self.device, self.lightest_kg)
            yield from ((("law", *path), fault) for path, fault in faults)

    @property
    def lightest_kg(self) -> float:
        """The least mass of the device."""
        return min(self.device.range.mass_kg or (self.device.mass_kg,))

    @property
    def apparent_mass_kg(self) -> float:
        """What of the device's mass a slow hand moves, m/(1 + g), without the handle."""
        return self.device.mass_kg / (1 + (self.law.gain if self.law else 0.0))

    def __repr__(self) -> str:
        unit, gain = self.units.unit, self.law.gain if self.law else 0.0
        mass = f"{self.device.mass_kg:g} {unit('kg')}"
        return f"ForceFeedbackProblem({self.name!r}: {mass}, force feedback of {gain:g})"

    __str__ = __repr__


SensorDevice = AdmittanceDevice | SensedDevice
"""A device with a force sensor before its handle."""
SensorProblem = AdmittanceProblem | ForceFeedbackProblem
"""A problem of such a device."""
