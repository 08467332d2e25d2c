"""Rows of measurements: an excitation, an identification, a diagnosis."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from shlex import quote
from typing import Any

from avc_casadi._util.text import number
from avc_casadi._util.units import Units
from avc_casadi.diagnose.causes import Diagnosis
from avc_casadi.identification.device import Identification
from avc_casadi.present.row import Answer, Mark, Row, Value, doubted, fill, listed, marked, parts, row
from avc_casadi.present.rows import subject

_LIMITS = {"Force": "force_n", "Speed": "speed_m_per_s", "Travel": "travel_m"}


def plan(data: Mapping[str, Any], units: Units, shown: str, port: str) -> Answer:
    """Return the plan of `excite`."""
    found = data["plan"]
    corners = "worst of its ranges" if found["devices"] > 1 else "declared device"
    signal = f"{found['signal']}, {{lowest_hz}} to {{highest_hz}}, peak {{peak_force_n}}; bounded by {{held_back_by}}"
    rows = [row("Signal", fill(signal, found))]
    for label, key in _LIMITS.items():
        allowed = fill(f"of {{{key}}} allowed, {corners}", found["limits"])
        rows.append(row(label, fill(f"{{{key}}}", found["forecast"]["worst"]), allowed))
    centring = "spring {spring_n_per_m}, damper {damper_ns_per_m}: hands off"
    rows.append(row("Centred by", fill(centring, found["centring"])))
    title = parts(shown, " ", fill(f"{found['signal']} of {{seconds:time}} on {port}", found))
    return Answer("excite", data, title, tuple(rows), units=units)


def log(data: Mapping[str, Any], units: Units, title: str, file: str = "", onwards: Sequence[str] = ()) -> Answer:
    """Return the answer of `excite`: the log that was played."""
    found = data["log"]
    lost = f"{found['lost']} lost, seen as gaps" if found["lost"] else "none lost"
    rows = [
        row("Played", found["end"], mark=marked(found["whole"])),
        row("Recorded", fill(f"{subject.plural(found['records'], 'record')} in {{seconds:time}}, {lost}", found)),
        row("At most", fill("{peak_force_n}, {peak_speed_m_per_s}, {peak_travel_m}", found)),
        *subject.written(file),
    ]
    return Answer("excite", data, (title,), tuple(rows), tuple(onwards), units)


def identification(
    data: Mapping[str, Any], found: Identification, units: Units, logs: Sequence[str], files: Sequence[str]
) -> Answer:
    """Return the answer of `identify`: a row for each value of the device."""
    known = {"seconds": found.seconds, "rate_hz": 1 / found.sample_time_s}
    title = parts(
        ", ".join(logs),
        " ",
        fill(f"{{seconds:time}} in {subject.plural(found.records, 'record')} at {{rate_hz}}", known),
    )
    rows: list[Row] = []
    for key, one in found.estimates.items():
        # As many digits as the interval supports.
        half, size = (one.high - one.low) / 2, max(abs(one.low), abs(one.high))
        digits = min(max(3, 1 + math.ceil(math.log10(size / half))), 15) if 0 < half < size else 3
        value, low, high = (Value(end, one.quantity, digits) for end in (one.value, one.low, one.high))
        values = (value, "(", low, "to", high, ")") if one.identified else (low, "to", high, "; not identified")
        mark = doubted(not one.identified)
        rows.append(row(units.key(key), values, mark=mark, rank=0 if len(rows) < 9 else 1))
    rows.append(row("Model", ", ".join(found.rungs)))
    rows += subject.notes(found.notes, mark=Mark.CAUTION)
    rows += subject.written(*files)
    rows.append(row("Not known", ", ".join(map(units.key, found.unknown)), rank=1))
    for trial in found.trials:
        error = f"error {{change:share}} on stretches held out, {trial.standard_errors:.2g} std errors"
        text = f"{'taken' if trial.taken else 'not taken'}: {error}{'; ' if trial.why else ''}{trial.why}"
        rows.append(row(f"Rung {trial.rung}", fill(text, vars(trial)), rank=1))
    onwards = [f"avc check {quote(one)}" for one in files if one.endswith(".toml")]
    onwards.append(f"avc identify {' '.join(logs)} -v")
    return Answer("identify", data, title, tuple(rows), tuple(onwards), units)


def diagnosis(data: Mapping[str, Any], found: Sequence[Diagnosis], command: str, files: Sequence[str]) -> Answer:
    """Return the answer of `diagnose`: the rows of one log, or a row for each of several."""
    beside = subject.written(*files)
    units = found[0].declared.device.units
    if len(found) > 1:
        rows = [row(one.log.name, one.conclusion, mark=_verdict(one)) for one in found[:10]]
        rows += [row("Others", subject.plural(len(found) - 10, "log"))] if len(found) > 10 else []
        return Answer("diagnose", data, (f"{len(found)} logs",), (*rows, *beside), (command,), units)
    (one,) = found
    swing, law, fit = one.swing, one.law, one.fit
    rows = [row("Verdict", one.conclusion, mark=_verdict(one))]
    for cure in one.remedies[:3]:
        text = f"{cure.key.replace('_', ' ')} {{value:{cure.quantity}}} in place of {{before:{cure.quantity}}}"
        rows.append(row("Remedy", fill(text, vars(cure))))
    rows += [row("Next log", one.decides)] if one.decides else []
    if swing.kind != "none":
        size = "{peak_to_peak_m}, {force_peak_to_peak_n}, in contact {contact_share}"
        rows.append(row("Oscillation", fill(f"{swing.kind} {{frequency_hz}}: {size}", vars(swing))))
    if one.log.missed_share:
        rows.append(row("Ticks", Value(one.log.missed_share, "share"), "missing", mark=Mark.CAUTION))
    if law is not None:
        known = {**vars(law), "misfit": max(law.misfit, 1e-3)}
        rows.append(row("Force", fill("k {stiffness_n_per_m}, b {damping_ns_per_m}; residual {misfit:share}", known)))
    if fit is not None and law is not None:
        ends = " to ".join(dict.fromkeys(number(end, 3) for end in one.declared.delay_samples))
        late = f"± {number(fit.delay_error, 1)}; {'declared' if one.declared.known else 'assumed'} {ends}"
        rows.append(row("Delay", Value(fit.best.delay + law.lag, "samples"), late))
        hand = () if fit.best.hand is None else zip(fit.best.hand.values(0).values(), subject.HAND, strict=True)
        rows.append(row("Hand", listed(Value.of(key, value) for value, key in hand) or "none"))
        if fit.best.stops is not None:
            rows.append(row("Stops", listed(Value(each, "length") for each in fit.best.stops)))
    rows += [*beside, *subject.notes(one.notes, "Assumed", Mark.NONE, 1)]
    title = parts(one.log.name, " ", Value(one.log.position_m.size * one.log.period_s, "time"))
    return Answer("diagnose", data, title, tuple(rows), (command,), units)


def _verdict(one: Diagnosis) -> Mark:
    return Mark.PASS if one.verdict == "nothing wrong" else Mark.FAIL if one.cause else Mark.CAUTION
