"""Rows of admittance devices: a checked file, the verdict on a law, its limits, and what would help."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from shlex import quote

from avc_casadi._util.arrays import Interval
from avc_casadi._util.json_values import plain
from avc_casadi._util.units import Quantity
from avc_casadi.claims.admittance import (
    AdmittanceCertificate,
    AdmittanceRemedy,
    HandleCase,
    HandleVerdict,
)
from avc_casadi.claims.handle_port import HandlePassivity
from avc_casadi.claims.judged_for import JudgedFor
from avc_casadi.claims.mass_width import MassWidth
from avc_casadi.claims.sensor_motion import speed_at_rest
from avc_casadi.files.new_admittance import NewAdmittance
from avc_casadi.files.new_options import CONTACT
from avc_casadi.files.plausibility import plausibility
from avc_casadi.loops.handle import Handle
from avc_casadi.loops.margins import LEAST_DISK, SETTLING_BAND, SOUND_DISK
from avc_casadi.model.admittance import (
    DRIVE_DAMPING_RATIO,
    AdmittanceDevice,
    AdmittanceProblem,
    Contact,
    VirtualImpedance,
)
from avc_casadi.model.sensed import SensorProblem
from avc_casadi.model.table import shown as as_in_file
from avc_casadi.present.row import (
    Answer,
    Mark,
    Part,
    Row,
    Value,
    caution,
    commas,
    grade,
    largest_value,
    least_value,
    parts,
    row,
    span,
    stable_ends,
    verdict_mark,
)
from avc_casadi.present.rows import subject
from avc_casadi.recommendation.admittance import AdmittanceRecommendation, BetterDevice
from avc_casadi.simulation.judge import AT_REST_M_PER_S

_HANDLES: dict[Handle, str] = {
    "held": "in a hand",
    "pressed": "pressed by a hand",
    "leaning": "on a contact, without a hand",
    "released": "released",
}
"""What the handle carries, in words."""

_CHANGES: dict[str, tuple[str, Quantity]] = {
    "mass_kg": ("virtual mass", "mass"),
    "damping_ns_per_m": ("virtual damping", "damping"),
    "cutoff_hz": ("force below", "frequency"),
    "drive_bandwidth_hz": ("drive", "frequency"),
    "delay_samples": ("delay", "samples"),
    "sample_time_s": ("sample time", "time"),
    "sensor_stiffness_n_per_m": ("sensor", "stiffness"),
    "handle_mass_kg": ("handle", "mass"),
}
"""Numbers that a remedy changes: what they are called, and what they measure."""


_KNOWN_DELAY_SAMPLES = 0.5
"""A data sheet tells a delay no better than to this part of a sample."""


def device_line(device: AdmittanceDevice) -> tuple[Part, ...]:
    """Return drive, rate, delay and sensor in a line."""
    rate, delay = Value(1 / device.sample_time_s, "frequency"), Value(device.delay_samples, "samples")
    sensor = Value(device.force_sensor.stiffness_n_per_m, "stiffness")
    drive = Value(device.drive_bandwidth_hz, "frequency")
    return parts("· drive", drive, ",", rate, ", delay", delay, ", sensor", sensor)


def law_line(law: VirtualImpedance) -> tuple[Part, ...]:
    """Return a law in a line."""
    spring = ("spring", Value(law.stiffness_n_per_m, "stiffness")) if law.stiffness_n_per_m else None
    low_pass = ("force below", Value(law.cutoff_hz, "frequency")) if law.cutoff_hz else None
    mass, damping = Value(law.mass_kg, "mass"), Value(law.damping_ns_per_m, "damping")
    return commas([("virtual mass", mass), ("damping", damping), spring, low_pass])


def checked(problem: AdmittanceProblem, doubts: tuple[str, ...], shown: str, refused: str) -> Answer:
    """Return the answer of `check` of an admittance device; `refused` is why no law is recommended, if none is."""
    law, sensor = problem.law, problem.device.force_sensor
    handle = ("handle", Value(sensor.handle_mass_kg, "mass"), ", noise", Value(sensor.noise_rms_n, "force"), "rms")
    swing_hz = math.sqrt(sensor.stiffness_n_per_m / sensor.handle_mass_kg) / (2 * math.pi)
    rows = [
        row("Valid", problem.title or "yes", mark=Mark.PASS),
        row("Law", law_line(law.admittance) if law else "none: recommend proposes a virtual mass and damping"),
        row("Sensor", handle, ", swings at", Value(swing_hz, "frequency")),
        *end_rows(problem),
        *subject.notes(doubts, "Warning"),
    ]
    if refused:
        label, mark = ("No better law", Mark.CAUTION) if law else ("Not deployable", Mark.FAIL)
        rows.append(row(label, refused, mark=mark))
    if problem.source:
        rows.append(row("Source", problem.source, rank=1))
    onwards = [f"avc recommend {quote(shown)}"] if not refused else []
    if law:
        onwards = [f"avc certify {quote(shown)}"]
    data = {
        "valid": True,
        "problem": problem.name,
        "tables": problem.model_dump(mode="json", exclude_none=True),
        "doubts": [*doubts],
        "refused": refused,
    }
    title = parts(shown, device_line(problem.device))
    return Answer("check", plain(data), title, tuple(rows), tuple(onwards), problem.units)


def _too_fast(problem: AdmittanceProblem, law: VirtualImpedance | None) -> Iterator[str]:
    """Yield which frequencies of an admittance device and of a law lie above half the sample rate."""
    frequencies = {
        "device.drive_bandwidth_hz": problem.device.drive_bandwidth_hz,
        "law.admittance.cutoff_hz": None if law is None else law.cutoff_hz,
    }
    yield from above_nyquist(frequencies, problem)


def doubts_of(problem: AdmittanceProblem) -> tuple[str, ...]:
    """Return what is unusual of an admittance device, though it is valid."""
    device = problem.device
    law = None if problem.law is None else problem.law.admittance
    doubts = [*_too_fast(problem, law), *contact_doubts(problem), *value_doubts(problem)]
    if device.drive_order == 1 and device.drive_damping_ratio != DRIVE_DAMPING_RATIO:
        doubts.append("device.drive_damping_ratio has no effect on a drive of first order; set device.drive_order = 2")
    return tuple(doubts)


def above_nyquist(frequencies: Mapping[str, float | None], problem: SensorProblem) -> Iterator[str]:
    """Yield which frequencies, by key, lie above half the sample rate, where they have no meaning."""
    half_rate_hz = 0.5 / problem.device.sample_time_s
    for key, frequency_hz in frequencies.items():
        if frequency_hz is not None and frequency_hz > half_rate_hz:
            value, half = as_in_file(frequency_hz), as_in_file(half_rate_hz)
            yield f"{problem.units.key(key)} is {value}, above half the sample rate, {half} Hz; is the unit right?"


def contact_doubts(problem: SensorProblem) -> Iterator[str]:
    """Yield that a handle touches nothing."""
    if not problem.contact.touches:
        key = problem.units.key("contact.stiffness_n_per_m")
        yield f"{key} is 0: the handle touches nothing; a stiff contact would limit the law"


def value_doubts(problem: SensorProblem) -> Iterator[str]:
    """Yield what is unusual of the values, at the handle."""
    yield from (f"{doubt.key} {doubt.message}" for doubt in plausibility(problem))


def end_rows(problem: SensorProblem) -> list[Row]:
    """Return the hands and the contact that a handle is judged with; assumed hands are marked."""
    assumed = problem.assumes_hands
    remedy = "; state [hands] of your user" if assumed else ""
    line = ("assumed:" if assumed else None, _hands_line(problem), "; released in addition", remedy)
    hands = row("Hands", line, mark=caution(assumed))
    return [hands, row("Contact", _contact_line(problem.contact))]


def untold(problem: SensorProblem) -> list[Row]:
    """Return a caution where hands are assumed, where the handle touches nothing, and where values may be slips."""
    rows = subject.unusual(problem)
    if problem.assumes_hands:
        rows.append(row("Hands", "assumed:", _hands_line(problem), "; state [hands] of your user", mark=Mark.CAUTION))
    if not problem.contact.touches:
        why = "none stated: a handle that touches something stiff is not judged; state [contact]"
        rows.append(row("Contact", why, mark=Mark.CAUTION))
    return rows


def _contact_line(contact: Contact) -> tuple[Part, ...]:
    if not contact.touches:
        return ("none",)
    return commas([span(contact.stiffness_n_per_m, "stiffness"), span(contact.damping_ns_per_m, "damping")])


def mark_of(result: HandleVerdict) -> Mark:
    """Return the mark of a verdict on a law of a device with a force sensor: a caution where it is thin or rings."""
    return verdict_mark(result.passed, result.disk_margin >= SOUND_DISK and not result.rings)


def certificate(result: AdmittanceCertificate, shown: str = "") -> Answer:
    """Return the answer of `certify` of an admittance law."""
    problem = result.problem
    shown = shown or problem.typed_name
    rows = [
        row("Deployable", f"{'yes' if result.passed else 'no'}: {result.reason}", mark=mark_of(result)),
        margins(result, result.problem),
        damping_of(result),
        row("Least stable", worst_case(result.worst)),
        *_limits(result),
        passivity(result.passivity),
        _noise(result),
    ]
    if result.disk_margin < SOUND_DISK and result.remedies is not None:
        rows.append(row("Would help", _remedies(result.remedies)))
    rows += subject.notes(_too_fast(problem, result.law), "Values")
    rows += untold(problem)
    rows += [case_row(case) for case in result.cases]
    return Answer(
        kind="certify-admittance",
        data=result.document(),
        title=parts(shown, " ", law_line(result.law), device_line(problem.device)),
        rows=tuple(rows),
        commands=(f"avc recommend {quote(shown)}", f"avc zwidth {quote(shown)} --plot region.png"),
        units=problem.units,
        complaint="" if result.passed else f"avc: {shown}: this law is not deployable",
    )


def recommendation(result: AdmittanceRecommendation, shown: str = "", written: str | None = None) -> Answer:
    """Return the answer of `recommend` for an admittance device."""
    problem, judged = result.problem, result.certificate
    shown = shown or problem.typed_name
    mark = grade(judged is None or not judged.rings, Mark.CAUTION) if result.passed else Mark.FAIL
    rows = [row("Deployable", f"{'yes' if result.passed else 'no'}: {result.reason}", mark=mark)]
    if judged is not None:
        felt = Value(judged.law.mass_kg + problem.device.force_sensor.handle_mass_kg, "mass")
        rows += [
            row("Law", law_line(judged.law)),
            row("Effort", Value(result.effort_ns_per_m, "damping"), "at 1 Hz; mass felt, handle included:", felt),
            margins(judged, judged.problem),
            damping_of(judged),
            row("Least stable", worst_case(judged.worst)),
            stiffest(judged, problem.contact),
            _noise(judged),
            *untold(problem),
        ]
    if result.least_mass_kg is not None:
        rows.append(
            row("Least mass", _least(result.least_mass_kg, "mass"), "with a sound margin, at the file's damping")
        )
    if result.least_damping_ns_per_m is not None:
        least = _least(result.least_damping_ns_per_m, "damping")
        rows.append(row("Least damping", least, "with a sound margin, at the file's mass"))
    rows += [row("Would help", _better(better)) for better in result.helps]
    onwards = after_recommendation(shown, written, passed=result.passed)
    return Answer(
        kind="recommend-admittance",
        data=result.document(),
        title=parts(shown, device_line(problem.device)),
        rows=tuple(rows),
        commands=(onwards, f"avc zwidth {quote(written or shown)} --plot region.png"),
        units=problem.units,
        complaint="" if result.passed else f"avc: {shown}: no law to run",
    )


def after_recommendation(shown: str, written: str | None, *, passed: bool) -> str:
    """Return what to type after `recommend`: judge the file that it wrote, write it, or look at the problem's."""
    if written:
        return f"avc certify {quote(written)}"
    return f"avc recommend {quote(shown)} --out law.toml" if passed else f"avc certify {quote(shown)}"


def drafted(new: NewAdmittance, shown: str) -> Answer:
    """Return the answer of `new` of an admittance device: what is assumed, unknown and unlikely."""
    problem, units = new.problem(), new.units
    unknown = new.unknown()
    costs = (f"{units.key(option.key_beside_device)}: {option.cost}" for option in unknown)
    # A contact that is not typed is assumed, and is told as such.
    of_assumed_contact = () if CONTACT.key in new.typed else tuple(contact_doubts(problem))
    doubts = [doubt for doubt in doubts_of(problem) if doubt not in of_assumed_contact]
    assumed = {units.key(key): value for key, value in new.assumed().items()}
    rows = [
        row("Hands", f"{new.held}:", _hands_line(problem)),
        row("Contact", _contact_line(problem.contact)),
        *([row("Assumed", ", ".join(f"{key} {value}" for key, value in assumed.items()))] if assumed else []),
        *subject.notes(costs, "Not known"),
        *subject.notes(doubts, "Warning"),
    ]
    tables = problem.model_dump(mode="json", exclude_none=True)
    not_known = {units.key(option.key): option.cost for option in unknown}
    data = {"file": shown, "tables": tables, "held": new.held, "assumed": assumed, "not_known": not_known}
    title = parts(shown, device_line(problem.device))
    command = f"avc recommend {quote(shown)} --out law.toml"
    return Answer("new-admittance", plain({**data, "doubts": [*doubts]}), title, tuple(rows), (command,), units)


def _hands_line(problem: SensorProblem) -> tuple[Part, ...]:
    hands = problem.hands
    mass, damping = span(hands.mass_kg, "mass"), span(hands.damping_ns_per_m, "damping")
    return commas([mass, damping, span(hands.stiffness_n_per_m, "stiffness")])


def exported(problem: AdmittanceProblem, precision: str, files: tuple[str, ...], shown: str) -> Answer:
    """Return the answer of `export` for an admittance device."""
    law = None if problem.law is None else problem.law.admittance
    scope = JudgedFor.of_admittance(problem)
    rate = Value(1 / problem.device.sample_time_s, "frequency")
    out = "velocity" if problem.device.drive == "velocity" else "change of the position"
    rows = [
        row("Law", None if law is None else law_line(law)),
        row("C", f"{precision} precision,", rate, f", position and force in, {out} out"),
        row("Faults", "the header says which readings are refused, and what motion they allow"),
        subject.judged_for(scope),
    ]
    data = {"problem": problem.name, "precision": precision, "files": [*files], "judged_for": scope}
    title = parts(shown, device_line(problem.device))
    return Answer("export-admittance", plain(data), title, tuple(rows), (), problem.units)


def _least(value: float, of: Quantity) -> tuple[Part, ...]:
    return (least_value(value, of),) if value else ("any",)


def _better(better: BetterDevice) -> tuple[Part, ...]:
    name, of = _CHANGES[better.key]
    mass, damping = Value(better.mass_kg, "mass"), Value(better.damping_ns_per_m, "damping")
    return parts(name, Value(better.value, of), ": virtual mass", mass, ", damping", damping)


def region(result: MassWidth, shown: str = "") -> Answer:
    """Return the answer of `zwidth` for an admittance device: the masses that it can render, by damping."""
    problem = result.problem
    shown = shown or problem.typed_name
    filtered = (
        ("force below", Value(result.cutoff_hz, "frequency")) if result.cutoff_hz else ("force without a filter",)
    )
    rows = [
        row("Least damping", _known(result.least_damping_ns_per_m), "with a stable mass"),
        row("Sound from", _known(result.least_sound_damping_ns_per_m), "with a disk margin of 0.2"),
    ]
    for index in result.confirmed_rows:
        damping = Value(float(result.damping_ns_per_m[index]), "damping").text(problem.units)
        span_of_mass = stretch((float(result.sound_least_kg[index]), float(result.sound_largest_kg[index])), "mass")
        rows.append(row(f"At {damping}", span_of_mass))
    return Answer(
        kind="zwidth-admittance",
        data=result.document(),
        title=parts(shown, ": virtual masses with a disk margin of 0.2,", filtered, device_line(problem.device)),
        rows=tuple(rows),
        commands=(f"avc recommend {quote(shown)}",),
        units=problem.units,
    )


def _known(damping: float) -> tuple[Part, ...]:
    return (Value(damping, "damping"),) if math.isfinite(damping) else ("no damping",)


def worst_case(case: HandleCase) -> tuple[Part, ...]:
    """Return what the handle carries where a loop is the worst."""
    if case.handle == "released":
        return ("released",)
    contact = ("contact of", Value(case.contact["stiffness_n_per_m"], "stiffness"))
    if case.handle == "leaning":
        return parts(contact, ", without a hand")
    hand = subject.hand(case.hand)
    touches = case.handle == "pressed" and case.contact["stiffness_n_per_m"] > 0
    return parts(hand, ", pressed against a", contact) if touches else hand


def margins(result: HandleVerdict, problem: SensorProblem) -> Row:
    """Return the smallest margin of each kind, where the loop is broken at the commanded velocity."""
    least = [case.margins for case in result.cases]
    disk = result.disk_margin
    delay_samples = min(margins.delay_samples for margins in least)
    # Where a range of the delay is declared, the margin is beyond its worst end.
    late = problem.device.range.delay_samples is None and delay_samples < _KNOWN_DELAY_SAMPLES
    mark = Mark.FAIL if disk < LEAST_DISK else grade(disk >= SOUND_DISK and not late, Mark.CAUTION)
    named = (
        ("gain", Value(min(margins.gain for margins in least), "gain")),
        ("phase", Value(_finite(min(margins.phase_deg for margins in least)), "phase")),
        ("delay", Value(_finite(delay_samples), "samples")),
        ("disk", Value(disk, "number", 2)),
    )
    remedy = "; if the delay may be longer, state device.range.delay_samples" if late else ""
    return row("Margins", commas(named), remedy, mark=mark)


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def damping(cases: tuple[HandleCase, ...]) -> Row:
    """Return the least damping ratio of swings that a law can damp, and that of the handle on its sensor if lower."""
    of_law = min(cases, key=lambda case: case.law_damping_ratio)
    least = min(cases, key=lambda case: case.damping_ratio)
    if least.damping_ratio >= 1:
        return row("Damping ratio", "no oscillation")
    swing = _swing(of_law.law_damping_ratio, of_law.law_damping_ratio_hz, of_law)
    if least.damping_ratio == of_law.law_damping_ratio:
        return row("Damping ratio", swing)
    on_sensor = _swing(least.damping_ratio, least.damping_ratio_hz, least)
    if of_law.law_damping_ratio >= 1:
        swing = ("no oscillation of the law",)
    return row("Damping ratio", swing, "; handle on its sensor", on_sensor)


def _swing(ratio: float, frequency_hz: float, case: HandleCase) -> tuple[Part, ...]:
    return parts(Value(ratio, "number", 2), "at", Value(frequency_hz, "frequency"), f"({_HANDLES[case.handle]})")


def measured_change(key: str) -> tuple[str, Quantity]:
    """Return what a number that a remedy changes is called, and what it measures."""
    return _CHANGES[key]


def damping_of(result: HandleVerdict, measured: Callable[[str], tuple[str, Quantity]] = measured_change) -> Row:
    """Return the least damping ratio of any case; of a law that rings how long a swing lasts, and what would help."""
    if not result.rings:
        return damping(result.cases)
    least = result.least_damped
    ratio, hz = least.law_damping_ratio, least.law_damping_ratio_hz
    # A swing of ratio zeta, seen at w_d = w sqrt(1 - zeta^2), fades by exp(-zeta w t).
    decay_per_s = 2 * math.pi * hz * ratio / math.sqrt(1 - ratio**2)
    swing = (*_swing(ratio, hz, least), ", settles in")
    remedy: tuple[Part, ...] = ()
    if result.damped_by is not None:
        remedy = ("no single change of law, device, delay or sensor by a factor of 30 damps this swing",)
    if result.damped_by:
        remedy = commas((_damped_by(change, *measured(change.key)) for change in result.damped_by), ";")
    lasts = Value(-math.log(SETTLING_BAND) / decay_per_s, "time")
    return row(
        "Damping ratio", swing, lasts, ": lightly damped;" if remedy else ": lightly damped", remedy, mark=Mark.CAUTION
    )


def _damped_by(remedy: AdmittanceRemedy, name: str, of: Quantity) -> tuple[Part, ...]:
    return parts(name, Value(remedy.value, of), ":", Value(remedy.damping_ratio, "number", 2))


def stretch(stable: Interval | None, of: Quantity) -> tuple[Part, ...]:
    """Return the stable interval of a number."""
    if stable is None:
        return ("none",)
    low, high = stable_ends(stable, of)
    if math.isinf(stable[1]):
        return parts(low, "and more") if stable[0] else ("any",)
    return parts(low, "to", high) if stable[0] else ("up to", high)


def _limits(result: AdmittanceCertificate) -> list[Row]:
    """Return the rows of limits, where they were looked for."""
    if not result.limited:
        return []
    return [
        row("Stable mass", stretch(result.mass_range_kg, "mass"), "at this damping"),
        row("Stable damping", stretch(result.damping_range_ns_per_m, "damping"), "at this mass"),
        stiffest(result, result.problem.contact),
    ]


def stiffest(result: HandleVerdict, contact: Contact) -> Row:
    """Return the stiffest contact, which fails where the declared one is stiffer."""
    limit, declared = result.stiffest_contact_n_per_m, contact.stiffest_contact_n_per_m
    text: tuple[Part, ...] = (largest_value(limit, "stiffness"), "with every hand and without a hand")
    if math.isinf(limit):
        text = ("no limit: stable against any contact, with every hand and without a hand",)
    elif not limit:
        text = ("none: unstable without a contact",)
    return row("Stiffest contact", text, mark=Mark.FAIL if limit < declared else Mark.NONE)


def passivity(result: HandlePassivity) -> Row:
    """Return whether a device is passive at its handle, or from which frequency it can feed a hand."""
    if not result.released_stable:
        return row("Passive", "no: unstable when the device is released")
    if result.passive:
        return row("Passive", "yes, up to half the sample rate")
    return row(
        "Passive", "no: from", Value(result.from_hz, "frequency"), "on the device can give energy to an unknown hand"
    )


def _noise(result: AdmittanceCertificate) -> Row:
    """Return what noise and one step of the sensor do to a handle at rest; a caution where it would not be at rest."""
    at_rest_m_per_s = AT_REST_M_PER_S / result.problem.device.metres_per_unit
    moves = speed_at_rest(result.noise_m_per_s, result.drift_m_per_s) > at_rest_m_per_s
    drifts: tuple[Part, ...] = ()
    if result.drift_m_per_s:
        drifts = (
            "; with an error of one sensor step the handle drifts at",
            Value(_finite(result.drift_m_per_s), "speed"),
        )
    sensor = result.problem.device.force_sensor
    if not sensor.noise_rms_n and not sensor.resolution_n:
        return row("Sensor noise", "not stated: noise_rms_n and resolution_n of the force sensor")
    if math.isinf(result.noise_m_per_s):
        return row("Sensor noise", "grows without end: the law is unstable")
    noise = Value(result.noise_m_per_s, "speed")
    return row("Sensor noise", noise, "rms at rest, with the worst hand or contact", drifts, mark=caution(moves))


def _remedies(remedies: tuple[AdmittanceRemedy, ...]) -> tuple[Part, ...]:
    if not remedies:
        return ("no single change of law, drive, delay or sensor by a factor of 30 helps",)
    return commas(map(_remedy, remedies), ";")


def _remedy(remedy: AdmittanceRemedy) -> tuple[Part, ...]:
    name, of = _CHANGES[remedy.key]
    return parts(name, Value(remedy.value, of), "(disk margin", Value(remedy.disk_margin, "number", 2), ")")


def case_row(case: HandleCase) -> Row:
    """Return a case of lower rank."""
    radius = ("spectral radius", Value(case.spectral_radius, "number", 6))
    disk = ("disk margin", Value(case.margins.disk, "number", 2))
    return row(_HANDLES[case.handle].capitalize(), commas([radius, disk]), mark=caution(not case.stable), rank=1)
