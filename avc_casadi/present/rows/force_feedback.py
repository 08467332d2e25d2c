"""Rows of devices with a force sensor that are commanded a force: a checked file, and the verdict on a law."""

from __future__ import annotations

import math
from shlex import quote

from avc_casadi._util.json_values import plain
from avc_casadi._util.units import Quantity
from avc_casadi.claims.force_feedback import ForceFeedbackCertificate, IdealLimit
from avc_casadi.model.sensed import ForceFeedbackProblem, SensedDevice, SensedLaw
from avc_casadi.present.row import Answer, Mark, Part, Row, Value, caution, commas, grade, parts, row
from avc_casadi.present.rows import admittance, pieces, subject
from avc_casadi.recommendation.force_feedback import ForceFeedbackRecommendation, LargerGain

_CHANGES: dict[str, tuple[str, Quantity]] = {
    "device.delay_samples": ("delay", "samples"),
    "device.sample_time_s": ("sample time", "time"),
    "device.amplifier_bandwidth_hz": ("amplifier", "frequency"),
    "device.force_sensor.stiffness_n_per_m": ("sensor", "stiffness"),
    "device.force_sensor.damping_ratio": ("damping ratio of the handle on its sensor", "number"),
    "device.force_sensor.handle_mass_kg": ("handle", "mass"),
    "law.damping_ns_per_m": ("b", "damping"),
    "law.force_feedback.gain": ("gain", "number"),
    "law.force_feedback.cutoff_hz": ("force below", "frequency"),
}
"""Numbers whose change is reported: what they are called, and what they measure."""


def device_line(device: SensedDevice) -> tuple[Part, ...]:
    """Return mass, rate, delay and sensor in a line."""
    rate, delay = Value(1 / device.sample_time_s, "frequency"), Value(device.delay_samples, "samples")
    mass, sensor = Value(device.mass_kg, "mass"), Value(device.force_sensor.stiffness_n_per_m, "stiffness")
    return parts("· device", mass, ",", rate, ", delay", delay, ", sensor", sensor)


def law_line(law: SensedLaw) -> tuple[Part, ...]:
    """Return a law in a line."""
    feedback = law.force_feedback
    low_pass = ("force below", Value(feedback.cutoff_hz, "frequency")) if feedback and feedback.cutoff_hz else None
    gain = ("force feedback", Value(law.gain, "number")) if feedback else None
    return commas([gain, low_pass, pieces.named(law)])


def doubts_of(problem: ForceFeedbackProblem) -> tuple[str, ...]:
    """Return what is unusual of a device with force feedback, though it is valid."""
    law = problem.law
    frequencies = {"device.amplifier_bandwidth_hz": problem.device.amplifier_bandwidth_hz}
    if law is not None:
        velocity = law.velocity
        frequencies["law.force_feedback.cutoff_hz"] = getattr(law.force_feedback, "cutoff_hz", None)
        frequencies["law.velocity.cutoff_hz"] = getattr(velocity, "cutoff_hz", None)
        frequencies["law.velocity.bandwidth_hz"] = getattr(velocity, "bandwidth_hz", None)
    return (
        *admittance.above_nyquist(frequencies, problem),
        *admittance.contact_doubts(problem),
        *admittance.value_doubts(problem),
    )


def checked(problem: ForceFeedbackProblem, shown: str) -> Answer:
    """Return the answer of `check`."""
    doubts = doubts_of(problem)
    handle = ("handle", Value(problem.device.force_sensor.handle_mass_kg, "mass"))
    rows = [
        row("Valid", problem.title or "yes", mark=Mark.PASS),
        row("Law", law_line(problem.law) if problem.law else "none: [law] with force_feedback = { gain, cutoff_hz }"),
        row("Sensor", handle),
        *admittance.end_rows(problem),
        *subject.notes(doubts, "Warning"),
    ]
    if problem.source:
        rows.append(row("Source", problem.source, rank=1))
    tables = problem.model_dump(mode="json", exclude_none=True)
    data = {"valid": True, "problem": problem.name, "tables": tables, "refused": "", "doubts": [*doubts]}
    title = parts(shown, device_line(problem.device))
    return Answer("check", plain(data), title, tuple(rows), (f"avc certify {quote(shown)}",), problem.units)


def certificate(result: ForceFeedbackCertificate, shown: str = "") -> Answer:
    """Return the answer of `certify`."""
    problem = result.problem
    shown = shown or problem.typed_name
    rows = [
        row("Deployable", f"{'yes' if result.passed else 'no'}: {result.reason}", mark=admittance.mark_of(result)),
        admittance.margins(result, problem),
        admittance.damping_of(result, _CHANGES.__getitem__),
        row("Least stable", admittance.worst_case(result.worst)),
        _felt(result),
        *_limits(result),
        admittance.passivity(result.passivity),
        admittance.stiffest(result, problem.contact),
        row("Noise", Value(result.noise_n, "force"), "rms of the commanded force at rest"),
        *admittance.untold(problem),
        *pieces.number_limits(result.intervals),
        *(admittance.case_row(case) for case in result.cases),
    ]
    return Answer(
        kind="certify-force-feedback",
        data=result.document(),
        title=parts(shown, " ", law_line(result.law), device_line(problem.device)),
        rows=tuple(rows),
        commands=(f"avc check {quote(shown)}",),
        units=problem.units,
        complaint="" if result.passed else f"avc: {shown}: this law is not deployable",
    )


def recommendation(result: ForceFeedbackRecommendation, shown: str = "", written: str | None = None) -> Answer:
    """Return the answer of `recommend`."""
    problem, judged = result.problem, result.certificate
    shown = shown or problem.typed_name
    mark = grade(judged is None or not judged.rings, Mark.CAUTION) if result.passed else Mark.FAIL
    rows = [row("Deployable", f"{'yes' if result.passed else 'no'}: {result.reason}", mark=mark)]
    if judged is not None:
        rows += [
            row("Law", law_line(judged.law)),
            _felt(judged),
            admittance.margins(judged, problem),
            admittance.damping_of(judged, _CHANGES.__getitem__),
            row("Least stable", admittance.worst_case(judged.worst)),
            *_limits(judged),
            admittance.stiffest(judged, problem.contact),
            row("Noise", Value(judged.noise_n, "force"), "rms of the commanded force at rest"),
        ]
    rows += [*admittance.untold(problem), *(row("Would help", _helps(larger, problem)) for larger in result.helps)]
    return Answer(
        kind="recommend-force-feedback",
        data=result.document(),
        title=parts(shown, device_line(problem.device)),
        rows=tuple(rows),
        commands=(admittance.after_recommendation(shown, written, passed=result.passed),),
        units=problem.units,
        complaint="" if result.passed else f"avc: {shown}: no law to run",
    )


def _helps(larger: LargerGain, problem: ForceFeedbackProblem) -> tuple[Part, ...]:
    """Return a change, and the gain that it allows with the mass that a slow hand then moves."""
    gain, mass = Value(larger.gain, "number"), Value(problem.device.mass_kg / (1 + larger.gain), "mass")
    name, measured = _CHANGES[larger.key]
    return parts(name, Value(larger.value, measured), ": gain", gain, ", apparent mass", mass)


def _felt(result: ForceFeedbackCertificate) -> Row:
    """Return what a slow hand moves: the device's mass over 1 + g, and the handle; and the spring of the law."""
    device, law = result.problem.device, result.law
    whole = Value(result.apparent_mass_kg + device.force_sensor.handle_mass_kg, "mass")
    mass = ("apparent mass", Value(result.apparent_mass_kg, "mass"), "of", Value(device.mass_kg, "mass"))
    spring = law.stiffness_n_per_m / (1 + law.gain)
    rest = (", spring", Value(spring, "stiffness")) if spring else ()
    return row("A hand moves", whole, "with the handle:", mass, rest)


def _limits(result: ForceFeedbackCertificate) -> list[Row]:
    """Return the gains that are stable, and those that an ideal loop makes passive, of a law with force feedback."""
    if result.law.force_feedback is None:
        return []
    stable = admittance.stretch(result.gain_range, "number")
    return [
        row("Stable gain", stable, "of the force, with the rest of the law"),
        _ideal(result.ideal_limit, result.law.gain),
    ]


def _ideal(limit: IdealLimit, gain: float) -> Row:
    """Return how far an ideal loop is passive, which a motor behind a transmission limits."""
    if math.isinf(limit.gain):
        why = "no limit: nothing gives way between motor and sensor; delay and low pass limit the gain"
        return row("Ideal loop", why)
    least = ("passive up to a gain of", Value(limit.gain, "number"), ", apparent mass")
    beyond = (Value(limit.apparent_mass_kg, "mass"), ", that between transmission and sensor")
    return row("Ideal loop", least, beyond, mark=caution(gain > limit.gain))
