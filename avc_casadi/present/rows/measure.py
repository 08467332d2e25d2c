"""Rows of measurements: an excitation, an identification, a diagnosis."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from shlex import quote
from typing import TYPE_CHECKING, Any

from avc_casadi._util.text import number
from avc_casadi.present.row import (
    Answer,
    Mark,
    Quantity,
    Row,
    Value,
    doubted,
    listed,
    marked,
    parts,
    row,
    span,
    written,
)
from avc_casadi.present.rows.subject import HAND, notes, plural

if TYPE_CHECKING:
    from avc_casadi._util.units import Units
    from avc_casadi.diagnose.causes import Diagnosis
    from avc_casadi.identification.device import Identification

_MOVED: tuple[tuple[str, str, Quantity], ...] = (
    ("Force", "force_n", "force"),
    ("Speed", "speed_m_per_s", "speed"),
    ("Travel", "travel_m", "length"),
)
# Values of a device on the first screen.
_MOST_VALUES = 9


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


def log(data: Mapping[str, Any], units: Units, title: str, file: str = "", onwards: Sequence[str] = ()) -> Answer:
    """Return the answer of `excite`: the log that was played."""
    found = data["log"]
    lost = f"{found['lost']} lost, seen as gaps" if found["lost"] else "none lost"
    rows = [
        row("Played", found["end"], mark=marked(found["whole"])),
        row("Recorded", f"{plural(found['records'], 'record')} in", Value(found["seconds"], "time"), f", {lost}"),
        row("At most", listed(Value(found[f"peak_{key}"], of) for _, key, of in _MOVED)),
        *written(file),
    ]
    return Answer("excite", data, (title,), tuple(rows), tuple(onwards), units)


def identification(
    data: Mapping[str, Any], found: Identification, units: Units, logs: Sequence[str], files: Sequence[str]
) -> Answer:
    """Return the answer of `identify`: a row for each value of the device."""
    records, rate = f"in {plural(found.records, 'record')} at", Value(1 / found.sample_time_s, "frequency")
    title = parts(", ".join(logs), " ", Value(found.seconds, "time"), records, rate)
    rows: list[Row] = []
    for key, one in found.estimates.items():
        # As many digits as the interval supports.
        half, size = (one.high - one.low) / 2, max(abs(one.low), abs(one.high))
        digits = min(max(3, 1 + math.ceil(math.log10(size / half))), 15) if 0 < half < size else 3
        value, low, high = (Value(end, one.quantity, digits) for end in (one.value, one.low, one.high))
        values = (value, "(", low, "to", high, ")") if one.identified else (low, "to", high, "; not identified")
        mark = doubted(not one.identified)
        rows.append(row(units.key(key), values, mark=mark, rank=0 if len(rows) < _MOST_VALUES else 1))
    rows.append(row("Model", ", ".join(found.rungs)))
    rows += notes(found.notes, mark=Mark.CAUTION)
    rows += written(*files)
    rows.append(row("Not known", ", ".join(map(units.key, found.unknown)), rank=1))
    for trial in found.trials:
        share, errors = Value(trial.change, "share"), f"on stretches held out, {trial.standard_errors:.2g} std errors"
        taken = "taken: error" if trial.taken else "not taken: error"
        rows.append(row(f"Rung {trial.rung}", taken, share, errors, f"; {trial.why}" if trial.why else "", rank=1))
    onwards = [f"avc check {quote(one)}" for one in files if one.endswith(".toml")]
    onwards.append(f"avc identify {' '.join(logs)} -v")
    return Answer("identify", data, title, tuple(rows), tuple(onwards), units)


def diagnosis(data: Mapping[str, Any], found: Sequence[Diagnosis], command: str, files: Sequence[str]) -> Answer:
    """Return the answer of `diagnose`: the rows of one log, or a row for each of several."""
    beside = written(*files)
    units = found[0].declared.device.units
    if len(found) > 1:
        rows = [row(one.log.name, one.conclusion, mark=_verdict(one)) for one in found[:10]]
        rows += [row("Others", plural(len(found) - 10, "log"))] if len(found) > 10 else []
        return Answer("diagnose", data, (f"{len(found)} logs",), (*rows, *beside), (command,), units)
    (one,) = found
    swing, law, fit = one.swing, one.law, one.fit
    rows = [row("Verdict", one.conclusion, mark=_verdict(one))]
    for cure in one.remedies[:3]:
        values = Value(cure.value, cure.quantity), Value(cure.before, cure.quantity)
        rows.append(row("Remedy", cure.key.replace("_", " "), values[0], "in place of", values[1]))
    rows += [row("Next log", one.decides)] if one.decides else []
    if swing.kind != "none":
        size = Value(swing.peak_to_peak_m, "length"), ",", Value(swing.force_peak_to_peak_n, "force")
        contact = ", in contact", Value(swing.contact_share, "share")
        rows.append(row("Oscillation", swing.kind, Value(swing.frequency_hz, "frequency"), ":", size, contact))
    if one.log.missed_share:
        rows.append(row("Ticks", Value(one.log.missed_share, "share"), "missing", mark=Mark.CAUTION))
    if law is not None:
        k, b = Value(law.stiffness_n_per_m, "stiffness"), Value(law.damping_ns_per_m, "damping")
        rows.append(row("Force", "k", k, ", b", b, "; residual", Value(max(law.misfit, 1e-3), "share")))
    if fit is not None and law is not None:
        ends = " to ".join(dict.fromkeys(number(end, 3) for end in one.declared.delay_samples))
        late = f"± {number(fit.delay_error, 1)}; {'declared' if one.declared.known else 'assumed'} {ends}"
        rows.append(row("Delay", Value(fit.best.delay + law.lag, "samples"), late))
        hand = () if fit.best.hand is None else zip(fit.best.hand.values(0).values(), HAND, strict=True)
        rows.append(row("Hand", listed(Value(value, of) for value, (_, of) in hand) or "none"))
        if fit.best.stops is not None:
            rows.append(row("Stops", listed(Value(each, "length") for each in fit.best.stops)))
    rows += [*beside, *notes(one.notes, "Assumed", Mark.NONE, 1)]
    title = parts(one.log.name, " ", Value(one.log.position_m.size * one.log.period_s, "time"))
    return Answer("diagnose", data, title, tuple(rows), (command,), units)


def _verdict(one: Diagnosis) -> Mark:
    return Mark.PASS if one.verdict == "nothing wrong" else Mark.FAIL if one.cause else Mark.CAUTION
