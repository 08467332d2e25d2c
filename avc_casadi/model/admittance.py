"""An admittance device: a drive follows a commanded velocity, a sensor feels the hand, the law is a virtual mass.

    M dv/dt + B v + K x = f,   in samples   v+ = (M v + T (f - K x))/(M + B T)

f is the force of the sensor behind its low pass, x the measured position of the drive, v+ the velocity that is
commanded in the same sample. What limits such a device is a stiff hand or contact, not a released one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import BeforeValidator, ModelWrapValidatorHandler, model_validator

from avc_casadi._util.arrays import Interval
from avc_casadi._util.units import Units
from avc_casadi.model import quantity as q
from avc_casadi.model import table as t
from avc_casadi.model.device import HandledDevice
from avc_casadi.model.ends import Dampings, End, IntervalOf
from avc_casadi.model.law import Law, Values
from avc_casadi.model.problem import Hands, defaults_at

ADMITTANCE_DRIVES = ("velocity", "position")
"""What `device.drive` may say; without the key the device is commanded a force, and is no admittance device."""

DRIVE_DAMPING_RATIO = 0.7
"""Damping ratio of a drive of second order, where its file gives none: a servo tuned without overshoot to speak of."""

STIFFEST_CONTACT_N_PER_M = 1e9
"""Stiffest contact of a file: ten times as stiff as steel against steel at a fingertip's size."""


_SensorStiffness = Annotated[float, BeforeValidator(q.Quantity("N/m", 1.0, STIFFEST_CONTACT_N_PER_M, zero=False))]
_HandleMass = Annotated[float, BeforeValidator(q.Quantity("kg", 1e-6, 1e4, zero=False))]
_Contacts = Annotated[Interval, BeforeValidator(IntervalOf(q.Quantity("N/m", 1e-3, STIFFEST_CONTACT_N_PER_M)))]


class ForceSensor(t.Table):
    """The sensor between drive and handle: what it is mounted on gives by its stiffness.

    Attributes:
        stiffness_n_per_m: of the sensor and what carries it.
        damping_ratio: of the handle on the sensor, the drive at rest and nobody there.
        handle_mass_kg: what moves beyond the sensor.
        noise_rms_n: rms of its noise, sample by sample.
        resolution_n: one step of its reading.
        max_force_n: where its reading saturates; None: it does not.
    """

    stiffness_n_per_m: _SensorStiffness
    damping_ratio: q.DampingRatio = 0.02
    handle_mass_kg: _HandleMass
    noise_rms_n: q.Force = 0.0
    resolution_n: q.Force = 0.0
    max_force_n: q.ForceLimit | None = None

    @property
    def damping_ns_per_m(self) -> float:
        """The damper beside its spring, b_s = 2 zeta sqrt(k_s m), m the mass beyond it."""
        return 2 * self.damping_ratio * math.sqrt(self.stiffness_n_per_m * self.handle_mass_kg)


class AdmittanceRange(t.Table):
    """Ranges of the device's values: each value [lowest, highest] about the nominal one, or None."""

    drive_bandwidth_hz: q.Pair[q.Hertz] | None = None
    delay_samples: q.Pair[q.LoopDelaySamples] | None = None
    sensor_stiffness_n_per_m: q.Pair[_SensorStiffness] | None = None
    handle_mass_kg: q.Pair[_HandleMass] | None = None


class AdmittanceDevice(HandledDevice):
    """A drive that follows a commanded velocity or position, whatever pushes, and the force sensor that it carries.

    Attributes:
        drive: what is commanded; a position is the sum of the velocities of the law, each times the sample time.
        drive_bandwidth_hz: of the velocity that follows the command: the corner of a lag, or the natural frequency of
            a drive of second order.
        drive_order: 1 or 2.
        drive_damping_ratio: of a drive of second order.
        delay_samples: from the reading of the sensor to the command that the drive gets, on top of the sampling.
        max_speed_m_per_s: the largest velocity that is commanded; None: no limit is declared.
    """

    drive: Literal["velocity", "position"]
    drive_bandwidth_hz: q.Hertz
    drive_order: Literal[1, 2] = 1
    drive_damping_ratio: q.LoopDampingRatio = DRIVE_DAMPING_RATIO
    sample_time_s: q.SampleTime = 1e-3
    delay_samples: q.LoopDelaySamples = 0
    max_speed_m_per_s: q.Speed | None = None
    force_sensor: ForceSensor
    range: AdmittanceRange = AdmittanceRange()

    def value(self, key: str) -> float:
        """Return the nominal value of a key of `[device.range]`."""
        if key in AdmittanceDevice.model_fields:
            return float(getattr(self, key))
        return float(getattr(self.force_sensor, key.removeprefix("sensor_")))

    def with_values(self, **values: float) -> Self:
        """Return the device without ranges, with other values of some keys of `[device.range]`, which are valid."""
        own = {key: value for key, value in values.items() if key in AdmittanceDevice.model_fields}
        sensor = {key.removeprefix("sensor_"): value for key, value in values.items() if key not in own}
        if own.get("delay_samples", 1.0) < q.LEAST_DELAY_SAMPLES:
            own["delay_samples"] = 0
        changed = {**own, "force_sensor": self.force_sensor.model_copy(update=sensor), "range": AdmittanceRange()}
        return self.model_copy(update=changed)

    @property
    def ranges(self) -> dict[str, Interval]:
        """The declared ranges by key."""
        return {key: interval for key, interval in self.range if interval is not None}

    def faults(self) -> Iterator[t.Finding]:
        """Yield a radius that is missing or means nothing, and ranges about other values."""
        if self.motion == "rotary" and self.handle_radius_m is None:
            message = "is missing; give the distance from the axis to the hand, 0.002 to 10 m"
            yield ("handle_radius_m",), message
        if self.motion == "linear" and self.handle_radius_m is not None:
            yield ("handle_radius_m",), 'applies to a rotary device only; leave it out, or set motion = "rotary"'
        if self.drive == "position" and self.drive_order == 1:
            why = 'with drive = "position", whose steps a drive of first order would follow with a jump of its velocity'
            yield ("drive_order",), f"is 1; allowed: 2 {why}"
        for key, interval in self.ranges.items():
            if not interval[0] <= self.value(key) <= interval[1]:
                stated = f"{key} = {t.shown(self.value(key))}"
                yield ("range", key), f"is {t.shown(interval)}; allowed: one that includes {stated}"


class Contact(t.Table, End):
    """The table [contact]: what the handle may touch, or be pressed against, with a hand or without.

    Attributes:
        stiffness_n_per_m: of what is touched; 0: nothing is.
        damping_ns_per_m: of the same.
    """

    kind: ClassVar[str] = "contact"
    couples: ClassVar[bool] = False
    required: ClassVar[str] = "a table with stiffness_n_per_m"

    stiffness_n_per_m: _Contacts = (0.0, 0.0)
    damping_ns_per_m: Dampings = (0.0, 0.0)

    @property
    def stiffest_contact_n_per_m(self) -> float:
        """The stiffest contact."""
        return float(self.stiffness_n_per_m[1])

    @property
    def touches(self) -> bool:
        """Whether there is something to touch."""
        return self.stiffest_contact_n_per_m > 0

    def document(self) -> dict[str, Any]:
        """Return its values."""
        return self.model_dump(mode="json")


class VirtualImpedance(t.Table):
    """The law of an admittance device: M dv/dt + B v + K x = f, f behind a low pass where one is given."""

    mass_kg: q.Mass
    damping_ns_per_m: q.Damping
    stiffness_n_per_m: q.Stiffness = 0.0
    cutoff_hz: q.Hertz | None = None

    def faults(self) -> Iterator[t.Finding]:
        """Yield a law without mass and damping, which would command an infinite velocity."""
        if self.mass_kg == 0 and self.damping_ns_per_m == 0:
            yield ("mass_kg",), "is 0, as is damping_ns_per_m; allowed: at least one of the two above 0"

    def law(self, sample_time_s: float) -> Law:
        """Return the law that the loops see."""
        return virtual_mass_law(
            self.mass_kg, self.damping_ns_per_m, sample_time_s, self.stiffness_n_per_m, self.cutoff_hz
        )

    def with_number(self, key: str, value: float) -> Self:
        """Return the law with another value of a number, which is not validated: a search tries it."""
        return self.model_copy(update={key: value})


def virtual_mass_law(
    mass_kg: Values,
    damping_ns_per_m: Values,
    sample_time_s: float,
    stiffness_n_per_m: Values = 0.0,
    cutoff_hz: float | None = None,
) -> Law:
    """Return the law from the measured position x and the sensor's force f to the commanded velocity v+.

    With p = exp(-2 pi f_c T), 0 without a filter, a sample is

        g+ = p g + (1 - p) f,   v+ = alpha v + beta (g+ - K x),   alpha = M/(M + B T),   beta = T/(M + B T).

    Numbers may be arrays, one law for each.
    """
    mass, damping, stiffness = np.broadcast_arrays(*map(np.asarray, (mass_kg, damping_ns_per_m, stiffness_n_per_m)))
    total = mass + damping * sample_time_s
    alpha, beta = mass / total, sample_time_s / total
    pole = 0.0 if cutoff_hz is None else math.exp(-2 * math.pi * cutoff_hz * sample_time_s)
    shape = mass.shape
    a, b = np.zeros((*shape, 2, 2)), np.zeros((*shape, 2, 2))
    a[..., 0, 0] = pole
    a[..., 1, 0] = beta * pole
    a[..., 1, 1] = alpha
    b[..., 0, 1] = 1 - pole
    b[..., 1, 0] = -beta * stiffness
    b[..., 1, 1] = beta * (1 - pole)
    # Without a filter its state is none of the loop's.
    kept = slice(0 if pole else 1, None)
    return Law(a[..., kept, kept], b[..., kept, :], a[..., 1:, kept], b[..., 1:, :], sample_time_s)


class AdmittanceLaw(t.Table):
    """The table [law] of an admittance device."""

    admittance: VirtualImpedance


class HandledProblem(t.Table):
    """A device with a force sensor, its law, its hands and what its handle may touch, as in a file.

    Attributes:
        name: catalogue name or file stem.
        title: one line for figures and reports.
        source: origin of the values; states which are assumed.
        device: with its `force_sensor`.
        law: what runs today, or None.
        hands: the range of hands at the handle; the released device is judged in addition.
        contact: what the handle may touch, with a hand or without.
    """

    name: t.Text = ""
    title: t.Text = ""
    source: t.Text = ""
    device: HandledDevice
    law: t.Table | None = None
    hands: Hands = Hands()
    contact: Contact = Contact()

    @model_validator(mode="wrap")
    @classmethod
    def _of_usual_hands(cls, tables: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        """Fill in the hands of a device that turns; they remain assumed, as those of one that slides."""
        problem = handler(cls._with_defaults(tables))
        if isinstance(tables, dict) and "hands" not in tables:
            problem.__pydantic_fields_set__.discard("hands")
        return problem

    @classmethod
    def _with_defaults(cls, tables: Any) -> Any:
        """Return tables with the usual hands of a device that turns, at its handle, where they state none."""
        device = tables.get("device") if isinstance(tables, dict) else None
        if isinstance(device, HandledDevice):
            device = device.model_dump()
        hands = tables.get("hands", {}) if isinstance(device, dict) else None
        if not isinstance(hands, dict) or device is None or device.get("motion") != "rotary":
            return tables
        radius = device.get("handle_radius_m")
        if isinstance(radius, bool) or not isinstance(radius, int | float):
            return tables
        if not q.RADII_M[0] <= radius <= q.RADII_M[1]:
            return tables  # the radius is the fault to report, not its consequences
        return {**tables, "hands": {**defaults_at(Hands, radius), **hands}}

    @property
    def typed_name(self) -> str:
        """The problem as a user types it: a name of the catalogue, or a file."""
        if not self.name:
            return "problem.toml"
        return self.name if "/" in self.name else f"{self.name}.toml"

    @property
    def assumes_hands(self) -> bool:
        """Whether its file states no hands."""
        return "hands" not in self.model_fields_set

    @property
    def end(self) -> Contact:
        """What the device meets beyond a hand."""
        return self.contact

    @property
    def end_table(self) -> str:
        """Name of the table that states the end."""
        return "contact"

    @property
    def units(self) -> Units:
        """Names and units in which its values are printed."""
        return self.device.units

    def changed(self, **tables: Any) -> Self:
        """Return the problem with some keys changed, validated as a file is: by table, a dict of keys or a value."""
        whole = self.model_dump(exclude_unset=True)
        return t.valid(type(self), _merged(whole, tables), self.typed_name, self.name)


class AdmittanceProblem(HandledProblem):
    """An admittance device with its law, its hands and what its handle may touch, as in a file.

    Attributes:
        device: with `drive = "velocity"`.
        law: what runs today, or None.

    Example:
        >>> avc.load_admittance("admittance/cobot").law.admittance.mass_kg
        12.0
    """

    device: AdmittanceDevice
    law: AdmittanceLaw | None = None

    def __repr__(self) -> str:
        device, unit = self.device, self.units.unit
        law = self.law.admittance if self.law else None
        rendered = (
            "no law" if law is None else f"{law.mass_kg:g} {unit('kg')}, {law.damping_ns_per_m:g} {unit('N.s/m')}"
        )
        return (
            f"AdmittanceProblem({self.name!r}: {rendered}; drive {device.drive_bandwidth_hz:g} Hz, "
            f"T {1e3 * device.sample_time_s:g} ms, delay {device.delay_samples})"
        )

    __str__ = __repr__


def _merged(whole: Any, change: Any) -> Any:
    """Return tables updated by keys, those in tables too; None removes one."""
    if not isinstance(change, dict) or not isinstance(whole, dict):
        return change
    merged = {**whole, **{key: _merged(whole.get(key), value) for key, value in change.items()}}
    return {key: value for key, value in merged.items() if value is not None and key != "name"}
