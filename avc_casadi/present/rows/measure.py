"""Rows of measurements: an excitation, an identification, a diagnosis."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from shlex import quote
from typing import TYPE_CHECKING, Any

from avc_casadi._util.text import number
from avc_casadi.identification.diagnosis.causes import CAUSES
from avc_casadi.identification.diagnosis.told import remedy_text
from avc_casadi.present.row import Answer, Mark, Part, Quantity, Row, Value, listed, marked, parts, row, span
from avc_casadi.present.rows.subject import HAND, notes, plural

if TYPE_CHECKING:
    from avc_casadi._util.units import Units
    from avc_casadi.identification.diagnosis.model import Diagnosis, Remedy
    from avc_casadi.identification.model import Estimate, Identification

_MOVED: tuple[tuple[str, str, Quantity], ...] = (
    ("Force", "force_n", "force"),
    ("Speed", "speed_m_per_s", "speed"),
    ("Travel", "travel_m", "length"),
)
# Rows of a diagnosis: remedies, best first, and logs; values of a device on the first screen.
_MOST_REMEDIES, _MOST_LOGS, _MOST_VALUES = 3, 10, 9
# Share of an oscillation from which the force limit bounds it; a misfit that is not significant.
_CUT, _LEAST_MISFIT = 0.02, 1e-3


def plan(data: Mapping[str, Any], units: Units, shown: str, port: str) -> Answer:
    """Return the plan of `excite`."""
    found = data["plan"]
    corners = "worst of its ranges" if found["devices"] > 1 else "declared device"
    band = span((found["lowest_hz"], found["highest_hz"]), "frequency")
    centring = found["centring"]
    spring, damper = Value(centring["spring_n_per_m"], "stiffness"), Value(centring["damper_ns_per_m"], "damping")
    peak = (", peak", Value(found["peak_force_n"], "force"), f"; bounded by {found['held_back_by']}")
    rows = [row("Signal", f"{found['signal']},", band, peak)]
    for label, key, of in _MOVED:
        worst, allowed = Value(found["forecast"]["worst"][key], of), Value(found["limits"][key], of)
        rows.append(row(label, worst, "of", allowed, f"allowed, {corners}"))
    rows.append(row("Centred by", "spring", spring, ", damper", damper, ": hands off"))
    title = parts(shown, f"  {found['signal']} of", Value(found["seconds"], "time"), f"on {port}")
    return Answer("excite", data, title, tuple(rows), units=units)


def log(data: Mapping[str, Any], units: Units, title: str, written: str = "", onwards: Sequence[str] = ()) -> Answer:
    """Return the answer of `excite`: the log that was played."""
    found = data["log"]
    lost = f"{found['lost']} lost, seen as gaps" if found["lost"] else "none lost"
    rows = [
        row("Played", found["end"], mark=marked(found["whole"])),
        row("Recorded", f"{plural(found['records'], 'record')} in", Value(found["seconds"], "time"), f", {lost}"),
        row("At most", listed(Value(found[f"peak_{key}"], of) for _, key, of in _MOVED)),
        *([row("Written", written)] if written else []),
    ]
    return Answer("excite", data, (title,), tuple(rows), tuple(onwards), units)


def identification(
    data: Mapping[str, Any], found: Identification, units: Units, logs: Sequence[str], written: Sequence[str]
) -> Answer:
    """Return the answer of `identify`: a row for each value of the device."""
    records = f"in {plural(found.records, 'record')} at"
    title = parts(
        ", ".join(logs),
        " ",
        Value(found.seconds, "time"),
        records,
        Value(1 / found.sample_time_s, "frequency"),
    )
    rows: list[Row] = []
    for key, one in found.estimates.items():
        values = (_between(one), "; not identified") if not one.identified else (_value(one), f"({_ends(one, units)})")
        mark = Mark.NONE if one.identified else Mark.CAUTION
        rows.append(row(units.key(key), values, mark=mark, rank=0 if len(rows) < _MOST_VALUES else 1))
    rows.append(row("Model", ", ".join(found.rungs)))
    rows += notes(found.notes, mark=Mark.CAUTION)
    if written:
        rows.append(row("Written", ", ".join(written), mark=Mark.PASS))
    rows += [row(f"{units.key(key)} is told by", log, rank=1) for key, log in found.unknown.items()]
    for trial in found.trials:
        share, errors = Value(trial.change, "share"), f"on stretches held out, {trial.standard_errors:.2g} std errors"
        taken = "taken: error" if trial.taken else "not taken: error"
        rows.append(row(f"Rung {trial.rung}", taken, share, errors, f"; {trial.why}" if trial.why else "", rank=1))
    onwards = [f"avc check {quote(written[0])}"] if written and found.device is not None else []
    onwards.append(f"avc identify {' '.join(logs)} -v")
    return Answer("identify", data, title, tuple(rows), tuple(onwards), units)


def _digits(one: Estimate) -> int:
    """Return the digits that the interval supports."""
    half, size = (one.high - one.low) / 2, max(abs(one.low), abs(one.high))
    return min(max(3, 1 + math.ceil(math.log10(size / half))), 15) if 0 < half < size else 3


def _value(one: Estimate, number: float | None = None) -> Value:
    return Value(one.value if number is None else number, one.quantity, _digits(one))


def _between(one: Estimate) -> tuple[Part, ...]:
    return (_value(one, one.low), "to", _value(one, one.high))


def _ends(one: Estimate, units: Units) -> str:
    low, high = (_value(one, end).text(units) for end in (one.low, one.high))
    if low.partition(" ")[2] == high.partition(" ")[2]:
        low = low.partition(" ")[0]
    return f"{low} to {high}"


def diagnosis(
    data: Mapping[str, Any], found: Sequence[Diagnosis], units: Units, command: str, written: Sequence[str]
) -> Answer:
    """Return the answer of `diagnose`: the rows of one log, or a row for each of several."""
    beside = [row("Written", ", ".join(written))] if written else []
    if len(found) > 1:
        rows = [row(one.source, _conclusion(one), mark=_verdict(one)) for one in found[:_MOST_LOGS]]
        rows += [row("Others", plural(len(found) - _MOST_LOGS, "log"))] if len(found) > _MOST_LOGS else []
        return Answer("diagnose", data, (f"{len(found)} logs",), (*rows, *beside), (command,), units)
    (one,) = found
    rows = [row("Verdict", _conclusion(one), mark=_verdict(one))]
    shares = {str(CAUSES.get(cause, "none of them")): share for cause, share in one.shares.items() if share > 0.005}
    if len(one.shares) > 1:
        rows.append(row("Supported", listed((name, Value(share, "share")) for name, share in shares.items())))
    rows += [row("Remedy", _remedy(cure, one, units)) for cure in one.cures[:_MOST_REMEDIES]]
    rows += [row("Would decide", one.decides)] if one.decides else []
    rows += [_oscillation(one), *_ticks(one), *_law(one), *_measured(one), *beside]
    rows += [*notes(one.evidence, "Evidence", Mark.NONE, 1), *notes(one.notes, "Assumed", Mark.NONE, 1)]
    title = parts(one.source, " ", Value(one.seconds, "time"))
    return Answer("diagnose", data, title, tuple(rows), (command,), units)


def _verdict(one: Diagnosis) -> Mark:
    return Mark.PASS if one.verdict == "nothing wrong" else Mark.FAIL if one.cause else Mark.CAUTION


def _conclusion(one: Diagnosis) -> tuple[Part, ...]:
    """Return the cause with its number; one without a number as concluded."""
    law, measured, least = one.law, one.measured, "; less of it is the smallest remedy"
    if one.cause == "delay" and measured is not None:
        late, meant = Value(measured.delay_samples, "samples"), Value(measured.declared_delay_samples, "samples")
        return (f"{CAUSES['delay']}:", late, "in place of", meant, ", with which the loop settles")
    if one.cause == "stiffness" and law is not None:
        return (f"{CAUSES['stiffness']}: k", Value(law.stiffness_n_per_m, "stiffness"), least)
    if one.cause == "damping" and law is not None and law.damping_ns_per_m > 0:
        return (f"{CAUSES['damping']}: b", Value(law.damping_ns_per_m, "damping"), least)
    return (one.conclusion,)


def _remedy(cure: Remedy, one: Diagnosis, units: Units) -> str:
    """Return a remedy with its number, and its effect on the loop."""
    law, measured, change = one.law, one.measured, cure.change
    if cure.key == "stiffness_n_per_m" and law is not None:
        to, of = (Value(value, "stiffness").text(units) for value in (cure.value, law.stiffness_n_per_m))
        change = f"k {to} in place of {of}"
    elif cure.key == "damping_ns_per_m" and law is not None:
        to, of = (Value(value, "damping").text(units) for value in (cure.value, law.damping_ns_per_m))
        change = f"b {to} in place of {of}"
    elif cure.key == "delay_samples" and measured is not None:
        change = f"a delay of {number(cure.value, 2)} in place of {number(measured.delay_samples, 3)} samples"
    return remedy_text(change, cure.growth_per_s)


def _oscillation(one: Diagnosis) -> Row:
    found = one.oscillation
    if not math.isfinite(found.frequency_hz):
        return row("Oscillation", "none; above 4 Hz the position moves by", Value(found.at_rest_m, "length"), "rms")
    size = (Value(found.peak_to_peak_m, "length"), ",", Value(found.force_peak_to_peak_n, "force"), "peak to peak")
    where = (", in contact", Value(found.contact_share, "share"), "of the time")
    cut = (", at the limit", Value(found.at_force_limit_share, "share")) if found.at_force_limit_share > _CUT else None
    return row("Oscillation", f"{found.looks} at", Value(found.frequency_hz, "frequency"), ":", size, where, cut)


def _ticks(one: Diagnosis) -> list[Row]:
    """Return the faults of the ticks."""
    ticks = one.ticks
    missed = (Value(ticks.missed_share, "share"), f"missing, at most {ticks.longest_gap} in a row")
    found = [
        missed if ticks.missed_share > 0 else None,
        f"a new value every {ticks.held} samples only" if ticks.held > 1 else None,
    ]
    return [row("Ticks", listed(found, ";"), mark=Mark.CAUTION)] if any(found) else []


def _law(one: Diagnosis) -> list[Row]:
    law = one.law
    if law is None:
        return []
    if not law.told:
        return [row("Law", "no spring and damper:", Value(law.misfit, "share"), "is left")]
    k, b = Value(law.stiffness_n_per_m, "stiffness"), Value(law.damping_ns_per_m, "damping")
    return [row("Law", "k", k, ", b", b, "; misfit", Value(max(law.misfit, _LEAST_MISFIT), "share"))]


def _measured(one: Diagnosis) -> list[Row]:
    found = one.measured
    if found is None:
        return []
    late = f"{number(found.delay_samples, 3)} ± {number(found.delay_error_samples, 1)} samples"
    ends = dict.fromkeys((number(found.least_declared_delay_samples, 3), number(found.declared_delay_samples, 3)))
    rows = [row("Delay", f"{late}; declared or assumed {' to '.join(ends)}")]
    if found.hand is None:
        return [*rows, row("Hand", "none: the device is released")]
    values = zip(found.hand.values(), HAND, strict=True)
    return [*rows, row("Hand", listed(Value(value, of) for value, (_, of) in values))]
