"""Force feedback on a device with a force sensor: stable with every hand and contact, by how much, and how light.

The loop is broken where the force is commanded. Each number is the worst over what the handle may carry, as of an
admittance device (`claims.admittance`).

How light an ideal loop may make a device, without delay and low pass, and stay passive: let a motor m_1 drive a mass
m_2, which carries the sensor, through a lossless transmission k, and add g f at the motor. Moved by the sensor's f,

    v_2/f = s (m_1 s^2 + k (1 + g))/(s^2 (m_1 m_2 s^2 + k (m_1 + m_2))),

which is positive real where its zero lies below its pole: 1 + g <= (m_1 + m_2)/m_2, an apparent mass of at least m_2.
That is half of the device's mass, g <= 1, where the transmission halves it: the rule that Colgate and Hogan are cited
for (Proc. IEEE ICRA 1989). Motor and sensor on a rigid body have no such limit; delay and low pass limit them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from avc_casadi._errors import InputError
from avc_casadi._util.arrays import Interval
from avc_casadi._util.json_values import plain
from avc_casadi._util.page import worded
from avc_casadi.claims.admittance import (
    CHANGE_FACTORS,
    DELAY_SHARES,
    HandleVerdict,
    SensorAnalysis,
    Way,
    changes_that_damp,
)
from avc_casadi.claims.handle_port import passivity
from avc_casadi.claims.law_limits import BeyondLimit, LawLimits, LimitSide, NumberLaws, nearest_limit
from avc_casadi.claims.stated_law import noise_gain
from avc_casadi.files.admittance_file import AnyForceFeedback, as_force_feedback, label_of
from avc_casadi.loops.handle import leading_poles
from avc_casadi.model.control_law import LawNumber
from avc_casadi.model.law import Law
from avc_casadi.model.sensed import ForceFeedback, ForceFeedbackProblem, SensedLaw


@dataclass(frozen=True)
class IdealLimit:
    """How far an ideal loop of force feedback is passive: by the mass between transmission and sensor.

    Attributes:
        gain: the largest passive gain; infinite where motor and sensor move as one.
        apparent_mass_kg: of the device, without the handle, at that gain.
    """

    gain: float
    apparent_mass_kg: float

    @classmethod
    def of(cls, problem: ForceFeedbackProblem) -> IdealLimit:
        """Return that of a device at its nominal values."""
        least = problem.device.beyond_transmission_kg
        return cls(problem.device.mass_kg / least - 1 if least else math.inf, least)


@dataclass(frozen=True, eq=False, repr=False)
class ForceFeedbackCertificate(HandleVerdict):
    """Whether a law with force feedback may run on its device, by how much, and how light it makes it.

    Attributes:
        problem: device, hands and contact, with the law that is judged.
        gain_range: the gains of the force that are stable with the rest of the law; None where none is.
        intervals: of every other number of the law, by key, the values at which it is stable with the others kept.
        apparent_mass_kg: what of the device's mass a slow hand moves, without the handle.
        ideal_limit: up to which gain an ideal loop is passive.
        noise_n: rms of the commanded force at rest, of the noise of sensor and position.

    Example:
        >>> light = avc.certify_force_feedback("admittance/lightened")
        >>> light.stable, light.apparent_mass_kg
        (True, 2.0)
    """

    problem: ForceFeedbackProblem
    law: SensedLaw
    gain_range: Interval | None
    intervals: Mapping[str, Interval | None]
    apparent_mass_kg: float
    ideal_limit: IdealLimit
    noise_n: float

    @property
    def beyond(self) -> BeyondLimit:
        """The number of an unstable law that is beyond a limit: the gain, where the rest is stable without it."""
        gain, (low, high) = self.law.gain_number, self.gain_range or (math.inf, math.inf)
        if low == 0 and self.law.gain > high:
            return BeyondLimit(LimitSide.ABOVE, gain.key, gain.value, high)
        return nearest_limit(self.law, self.intervals, self.problem.device.sample_time_s)

    @property
    def cause(self) -> str:
        """Which number of an unstable law is beyond which limit."""
        return worded(self.beyond, self.problem.units)

    def __repr__(self) -> str:
        return f"ForceFeedbackCertificate({'deployable' if self.passed else 'not deployable'}: {self.reason})"

    def document(self) -> dict[str, Any]:
        """Return JSON values."""
        verdict = {"pass": self.passed, "stable": self.stable, "disk_margin": self.disk_margin, "reason": self.reason}
        numbers = {key: value for key, value in vars(self).items() if key not in ("problem", "law")}
        stated = {"problem": self.problem.name, "law": self.law.document(), "deployable": verdict}
        return self.problem.units.document(plain({**stated, **numbers}))


def certify_force_feedback(
    problem: AnyForceFeedback, *, law: Mapping[str, Any] | None = None
) -> ForceFeedbackCertificate:
    """Judge the law of a device with a force sensor that is commanded a force: stable with every hand and contact.

    Args:
        problem: a `ForceFeedbackProblem`, its file or name.
        law: keys of `[law]` in place of those of the problem.

    Raises:
        InputError: a value that is refused, or no law.

    Example:
        >>> avc.certify_force_feedback("admittance/lightened", law={"force_feedback": {"gain": 20.0}}).passed
        False
    """
    stated = as_force_feedback(problem)
    if law:
        stated = stated.changed(law=dict(law))
    if stated.law is None:
        allowed = "allowed: [law] with force_feedback = { gain, cutoff_hz }, a spring or a damper"
        raise InputError.of(f"is missing; {allowed}", file=label_of(problem), key="law")
    judged_law = stated.law
    analysis = SensorAnalysis(stated)
    limits = LawLimits(analysis.family, measure=leading_poles)
    period = analysis.period_s
    table = _with_feedback(judged_law)

    def interval(number: LawNumber) -> Interval | None:
        return limits.interval(number, NumberLaws(table, number, lambda changed: [changed.law(period)]))

    numbers = judged_law.numbers(period, stated.lightest_kg)
    certificate = ForceFeedbackCertificate(
        cases=tuple(analysis.case(judged_law, side) for side in analysis.family.sides),
        stiffest_contact_n_per_m=analysis.stiffest_contact_n_per_m(judged_law),
        passivity=passivity(analysis.family.sides[0].devices, judged_law.law(period)),
        damped_by=None,
        problem=stated,
        law=judged_law,
        gain_range=interval(judged_law.gain_number),
        intervals={number.key: interval(number) for number in numbers if number.path != judged_law.gain_number.path},
        apparent_mass_kg=stated.apparent_mass_kg,
        ideal_limit=IdealLimit.of(stated),
        noise_n=command_noise_n(stated, judged_law),
    )
    damped = changes_that_damp(analysis, judged_law, _ways(stated)) if certificate.passed and certificate.rings else ()
    return replace(certificate, damped_by=damped)


def _with_feedback(law: SensedLaw) -> SensedLaw:
    """Return a law with a gain of the force, of which stable values are looked for: 0 where it has no feedback."""
    return law if law.force_feedback else law.model_copy(update={"force_feedback": ForceFeedback(gain=0.0)})


_WAYS = {
    "law.force_feedback.gain": (-1,),
    "law.damping_ns_per_m": (1, -1),
    "law.force_feedback.cutoff_hz": (1, -1),
    "device.amplifier_bandwidth_hz": (1,),
    "device.force_sensor.stiffness_n_per_m": (1, -1),
    "device.force_sensor.damping_ratio": (1,),
    "device.force_sensor.handle_mass_kg": (1, -1),
}
"""Numbers of law and device whose changes may damp a law that rings: upwards, downwards."""
_MOST_SENSOR_DAMPING = 1.0
"""Largest damping ratio of a handle on its sensor that is looked at."""


def _ways(problem: ForceFeedbackProblem) -> Iterator[Way]:
    """Yield the changes of a law with force feedback and of its device."""

    def of_key(key: str) -> Callable[[float], tuple[Any, ForceFeedbackProblem]]:
        def made(value: float) -> tuple[Any, ForceFeedbackProblem]:
            changed = with_value_of(problem, key, value)
            return changed.law, changed

        return made

    for key, directions in _WAYS.items():
        value = value_of(problem, key) or 0.0
        # A law without a damper gets one of the size of the device's own.
        if not value and key == "law.damping_ns_per_m":
            value = problem.device.damping_ns_per_m
        for direction in directions if value else ():
            values = (value * CHANGE_FACTORS**direction).tolist()
            if key.endswith("damping_ratio"):
                values = [ratio for ratio in values if ratio <= _MOST_SENSOR_DAMPING]
            yield Way(key, value, tuple(values), of_key(key))
    delays = tuple(problem.device.delay_samples * share for share in DELAY_SHARES if problem.device.delay_samples)
    yield Way("device.delay_samples", None, delays, of_key("device.delay_samples"))
    yield Way("device.sample_time_s", None, (problem.device.sample_time_s / 2,), of_key("device.sample_time_s"))


def value_of(problem: Any, key: str) -> float | None:
    """Return the value of a dotted key; None where a table on the way is missing."""
    value = problem
    for name in key.split("."):
        value = None if value is None else getattr(value, name)
    return None if value is None else float(value)


def with_value_of(problem: Any, key: str, value: float) -> Any:
    """Return a table with another value of a dotted key, and a declared range of it moved by the same factor."""
    name, _, rest = key.partition(".")
    before = getattr(problem, name)
    if rest:
        return problem.model_copy(update={name: with_value_of(before, rest, value)})
    update: dict[str, Any] = {name: value}
    declared = getattr(getattr(problem, "range", None), name, None)
    if declared is not None:
        moved = tuple(end * value / before for end in declared)
        update["range"] = problem.range.model_copy(update={name: moved})
    return problem.model_copy(update=update)


def command_noise_n(problem: ForceFeedbackProblem, law: SensedLaw) -> float:
    """Return the rms of the commanded force at rest, N, from noise and steps of force sensor and encoder.

    A step q counts as noise of q/sqrt(12); both pass the law by its noise gain and add as squares.
    """
    device, sensor = problem.device, problem.device.force_sensor
    whole = law.law(device.sample_time_s)
    noises = (
        (device.position_noise_rms_m, device.encoder_resolution_m),
        (sensor.noise_rms_n, sensor.resolution_n),
    )
    total = 0.0
    for column, (noise, step) in enumerate(noises):
        if noise or step:
            of_one = slice(column, column + 1)
            part = Law(whole.a, whole.b[..., of_one], whole.c, whole.d[..., of_one], whole.sample_time_s)
            total = math.hypot(total, math.hypot(noise, step / math.sqrt(12)) * noise_gain(part))
    return total
