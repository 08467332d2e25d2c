"""Rows that show: a checked file, the catalogue, the installation, studies, and what was measured of a device."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from shlex import quote
from typing import TYPE_CHECKING, Any

from avc_casadi._util.text import number
from avc_casadi._util.units import LINEAR, Units
from avc_casadi.model.problem import Problem
from avc_casadi.present.row import (
    QUANTITIES,
    Answer,
    Mark,
    Part,
    Parts,
    Row,
    Value,
    caution,
    commas,
    fill,
    grade,
    parts,
    quantity_of,
    row,
    span,
)
from avc_casadi.present.rows import subject
from avc_casadi.recommendation.preconditions import asked_of_others, not_judged

if TYPE_CHECKING:
    from avc_casadi.diagnose.causes import Diagnosis
    from avc_casadi.identification.device import Identification


def problem(data: Mapping[str, Any], stated: Problem, shown: str = "") -> Answer:
    """Return the answer of `check` of a problem: what it asks for, its other end, what is unusual."""
    rows = [row("Valid", stated.title or "yes", mark=Mark.PASS)]
    if stated.simulation is not None:
        rows += [*_engine(stated), *subject.not_used(data["not_used"])]
    elif stated.follower is not None:
        rows += [*_follower(stated), *subject.not_used(data["not_used"])]
    else:
        rows += _wall(data, stated)
    rows += subject.notes((f"{one['key']} {one['message']}" for one in data["warnings"]), "Warning")
    if stated.source:
        rows.append(row("Source", stated.source, rank=1))
    # Where nothing is deployable whatever the gains, its row says so.
    none = any(one["key"] == "avc recommend" for one in data["warnings"])
    onwards = [] if none else ["recommend {} --out coupling.json"]
    return subject.answer("check", data, stated, shown, rows, *onwards)


def _wall(data: Mapping[str, Any], stated: Problem) -> list[Row]:
    band, stability = "{frequencies:9}, {lowest_hz} to {highest_hz}; Nyquist {nyquist_hz}", stated.stability
    rows = [
        row("Asked for", f"structure {stated.coupling.structure}, model {stability.model}, scope {stability.scope}"),
        row("Frequencies", fill(band, data)),
        subject.passive_limit(data["passive_limit_n_per_m"]),
    ]
    if data["declared"]:
        rows.append(row("Declared", ", ".join(map(stated.units.key, data["declared"]))))
    unused = [f"{what}: no recommendation is judged with it" for what in not_judged(data["not_used"])]
    rows += subject.notes(unused, "Not used")
    return rows + subject.notes(asked_of_others(data["not_used"]), "Not used", Mark.NONE)


def _engine(stated: Problem) -> list[Row]:
    """Return what the headline does not hold: what the tool touches, and what the exchange means."""
    tool = stated.simulation
    assert tool is not None  # noqa: S101 - asked of problems with one
    what: tuple[Part, ...] = ("none: the spring leads to a place that the engine sets",)
    if tool.tool_mass_kg is not None:
        low, high = tool.contact_stiffness_n_per_m
        ends = () if tool.constraint else (low,) if tool.rigid else (low, high)
        springs = ("springs from" if tool.rigid else "springs of", span(ends, "stiffness")) if ends else None
        touches = commas(["rigid objects" if tool.rigid else None, springs], "and")
        what = parts(span(tool.tool_mass_kg, "mass"), ", damping", span(tool.tool_damping_ns_per_m, "damping"))
        what = parts(what, "; touches", touches)
    gets = subject.EXCHANGES[tool.exchange].format(step="the engine's step")
    return [row("Tool", what), row("Exchange", f"{tool.exchange}: the device gets {gets}")]


def _follower(stated: Problem) -> list[Row]:
    """Return what the headline does not hold: link, what is sent back, what the follower touches."""
    far = stated.follower
    assert far is not None  # noqa: S101 - asked of problems with one
    there, back = (span(one, "time") for one in (far.delay_s, far.return_delay_s or far.delay_s))
    lost = fill("; {jitter:share} of jitter, {lost_share} of the messages lost", vars(far))
    sent = f", {far.force} is sent back" if far.architecture == "position-force" else ""
    end = ("a rigid object",) if far.rigid else ("a spring of", Value(far.contact_stiffness_n_per_m[1], "stiffness"))
    return [
        row("Link", there, "there,", back, "back", lost),
        row("Architecture", f"{far.architecture}{sent}"),
        row("Touches", "nothing, up to", end),
    ]


def device(data: Mapping[str, Any], units: Units, shown: str) -> Answer:
    """Return the answer of `check` of a device file: a value each with its range and source."""
    sources, ranges = data["sources"], data["device"].get("range", {})
    rows = [row("Valid", data["title"] or "yes", mark=Mark.PASS)]
    values = {key: value for key, value in data["device"].items() if key != "range"}
    for key, value in values.items():
        ends = ranges.get(key)
        between = ("(", _value(key, ends[0]), "to", _value(key, ends[1]), ")") if isinstance(ends, list) else None
        origin = f", {sources[key]['grade']}" if key in sources else ""
        rows.append(row(units.key(key), _value(key, value), between, origin, rank=0 if len(rows) < 10 else 1))
    if gaps := [gap for gap in data["gaps"] if units.inner(gap) not in values]:
        rows.append(row("Not known", ", ".join(map(units.key, gaps)), mark=Mark.CAUTION))
    rows += [row(units.key(key), f"{one['grade']}, {one['source']}", rank=1) for key, one in sources.items()]
    rows.append(row("Use", f'device = "{shown}" in a problem file'))
    return Answer("check", data, (f"{data['name']}   device file",), tuple(rows), units=units)


def _value(key: str, value: Any) -> tuple[Part, ...]:
    if isinstance(value, Mapping):
        return commas((name.replace("_", " "), _value(name, one)) for name, one in value.items())
    if isinstance(value, bool) or not isinstance(value, int | float):
        return (str(value),)
    return (f"{value:g} m" if key.endswith("radius_m") else Value(value, quantity_of(key)),)


def catalogue(data: Mapping[str, Any], folder: str) -> Answer:
    """Return the answer of `list`."""
    rows = [row(one["name"], one["title"]) for one in data["problems"]]
    rows += [row(f"devices/{one['name']}", one["title"]) for one in data["devices"]]
    title = f"problems, files of {folder}, and devices of the catalogue"
    return Answer("list", data, (title,), tuple(rows), ("avc check figure5", "avc run figure5"), whole=True)


def installation(data: Mapping[str, Any], ports: Sequence[Row]) -> Answer:
    """Return the answer of `doctor`: working solvers, packages, compilers, ports."""
    solvers, programs = data["solvers"], data["programs"]
    text = ", ".join(f"{name} {'solves' if solves else 'does NOT solve'}" for name, solves in solvers.items())
    emulator = "installed" if data["emulator"] else "absent; pip install 'avc-casadi[emulator]'"
    rows = [
        row("Solvers", text, mark=grade(all(solvers.values()))),
        row("Packages", ", ".join(f"{name} {version}" for name, version in data["packages"].items())),
        row("Programs", ", ".join(name if place else f"{name} absent" for name, place in programs.items())),
        row("Emulator", emulator, mark=grade(data["emulator"], Mark.CAUTION)),
        *ports,
    ]
    bad = ", ".join(name for name, solves in solvers.items() if not solves)
    complaint = f"avc: {bad} does not solve; install casadi again: pip install --force-reinstall casadi" if bad else ""
    title = (f"{data['executable']} on {data['platform']}",)
    return Answer("doctor", data, title, tuple(rows), complaint=complaint)


def ports(found: Sequence[Mapping[str, Any]], *, asked: bool) -> list[Row]:
    """Return the serial ports, a row each; with ``asked`` the device behind each."""
    rows = []
    for port in found:
        own = f"serial number {port['serial_number']}" if port["serial_number"] else ""
        no_right = "no right to open it: add yourself to its group (dialout)"
        text = [port["description"], own, "may be opened" if port["accessible"] else no_right]
        if behind := port["avc_device"] if asked else None:
            number = behind["unique_id"] or "without a number"
            text.append(f"avc device {number}, coupling {behind['coupling_id'] or 'none'}")
        elif asked:
            text.append("no avc device")
        mark = grade(port["accessible"], Mark.CAUTION)
        rows.append(row(port["device"], ", ".join(filter(None, text)), mark=mark))
    return rows or [row("Serial ports", "none")]


def accuracy(data: Mapping[str, Any]) -> Answer:
    """Return the answer of `accuracy`: time and error of each solver."""
    rows = []
    for one in data["solvers"]:
        by = " ".join(filter(None, [one["solver"], one["tolerance"] and f"{one['tolerance']:g}"]))
        error = "excess error {excess_error:2} median, {largest_excess_error:2} at most; optimal at {optimal_share}"
        text = fill(f"{by}{':' if by else ''} {{seconds_per_frequency:time}} a frequency; {error}", one)
        notable = f"{', fastest of its accuracy' if one['pareto'] else ''}{', default' if one['default'] else ''}"
        rows.append(row(one["method"], text, notable, rank=0 if notable else 1))
    title = (f"{data['problem']}   error of |Z_h| beyond the optimum of `exact`, relative to |Z_h_ds|",)
    return Answer("accuracy", data, title, tuple(rows))


def table1(data: Mapping[str, Any]) -> Answer:
    """Return the answer of `table1`: the paper's table with simulated hands of both sets."""
    hands, rows = data["hands"], []
    for name, found in (("A", data["rows"]), ("B", data["rows_set_b"])):
        for one in found:
            paper, text = one["paper"] or {}, f"{one['coupling']}: not tried"
            if one["stable"] is not None:
                of = f"{{stable:9}} of {hands} (95 % {{stable_low:share}} to {{stable_high:share}})"
                text = f"{one['coupling']}: stable {of}"
            text += f", paper {paper['stable']}" if "stable" in paper else ""
            text += "" if one["asymptotic"] is None else ", {asymptotic:9} without friction"
            text += "" if one["apparent_stiffness_n_per_m"] is None else ", felt {apparent_stiffness_n_per_m}"
            text += "" if one["matched"] is None else ", nearer {matched:9}"
            text += "" if one["unable"] is None else ", unable {unable:9}"
            text += "" if paper.get("matched") is None else f" (paper {paper['matched']}/{paper['unable']})"
            wall = Value(one["stiffness_n_per_m"], "stiffness").text(LINEAR)
            rows.append(row(f"Set {name}, {one['ve']}, {wall}", fill(text, one)))
    title = f"Table 1 of the paper with {hands} simulated hands, seed {data['seed']}; of 10 people in the paper"
    rows += [
        row("Set A", "mass 0.05 to 0.3 kg, damping 3 to 20 N.s/m, stiffness 200 to 800 N/m"),
        row("Set B", "five-parameter stylus hands within measured ranges"),
        row("Stable", "residual speed below 5 mm/s in press, tap and hold"),
        row("Nearer", "to the continuous wall than the schedule, by a Weber fraction of 0.1; unable: no difference"),
    ]
    return Answer("table1", data, (title,), tuple(rows), whole=True)


def plan(data: Mapping[str, Any], units: Units, shown: str, port: str) -> Answer:
    """Return the plan of `excite`."""
    found = data["plan"]
    corners = "worst of its ranges" if found["devices"] > 1 else "declared device"
    signal = f"{found['signal']}, {{lowest_hz}} to {{highest_hz}}, peak {{peak_force_n}}; bounded by {{held_back_by}}"
    rows = [row("Signal", fill(signal, found))]
    for label, key in (("Force", "force_n"), ("Speed", "speed_m_per_s"), ("Travel", "travel_m")):
        allowed = fill(f"of {{{key}}} allowed, {corners}", found["limits"])
        rows.append(row(label, fill(f"{{{key}}}", found["forecast"]), allowed))
    centring = "spring {spring_n_per_m}, damper {damper_ns_per_m}: hands off"
    rows.append(row("Centred by", fill(centring, found)))
    title = parts(shown, " ", fill(f"{found['signal']} of {{seconds:time}} on {port}", found))
    return Answer("excite", data, title, tuple(rows), units=units)


def log(data: Mapping[str, Any], units: Units, title: str, onwards: Sequence[str] = ()) -> Answer:
    """Return the answer of `excite`: the log that was played."""
    found = data["log"]
    lost = f"{found['lost']} lost, seen as gaps" if found["lost"] else "none lost"
    rows = [
        row("Played", found["end"], mark=grade(found["whole"])),
        row("Recorded", fill(f"{subject.plural(found['records'], 'record')} in {{seconds:time}}, {lost}", found)),
        row("At most", fill("{peak_force_n}, {peak_speed_m_per_s}, {peak_travel_m}", found)),
    ]
    return Answer("excite", data, (title,), tuple(rows), tuple(onwards), units)


def identification(data: Mapping[str, Any], found: Identification, units: Units, logs: Sequence[str]) -> Answer:
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
        best = 0.0 if abs(one.value) < 1e-3 * half else one.value
        value, low, high = (Value(end, one.quantity, digits) for end in (best, one.low, one.high))
        values = (value, "(", low, "to", high, ")") if one.identified else (low, "to", high, "; not identified")
        mark = caution(not one.identified)
        rows.append(row(units.key(key), values, mark=mark, rank=0 if len(rows) < 9 else 1))
    rows.append(row("Model", ", ".join(found.rungs)))
    rows += subject.notes(found.notes, mark=Mark.CAUTION)
    rows.append(row("Not known", ", ".join(map(units.key, found.unknown)), rank=1))
    for trial in found.trials:
        error = f"error {{change:share}} on stretches held out, {trial.standard_errors:.2g} std errors"
        text = f"{'taken' if trial.taken else 'not taken'}: {error}{'; ' if trial.why else ''}{trial.why}"
        rows.append(row(f"Rung {trial.rung}", fill(text, vars(trial)), rank=1))
    onwards = (f"avc check {quote(data['out'])}",) if data["out"] else ()
    return Answer("identify", data, title, tuple(rows), onwards, units)


def diagnosis(data: Mapping[str, Any], found: Sequence[Diagnosis]) -> Answer:
    """Return the answer of `diagnose`: the rows of one log, or a row for each of several."""
    units, marks = found[0].design.device.units, {"nothing wrong": Mark.PASS, "named": Mark.FAIL}
    if len(found) > 1:
        rows = [row(one.log.name, one.conclusion, mark=marks.get(one.verdict, Mark.CAUTION)) for one in found[:10]]
        rows += [row("Others", subject.plural(len(found) - 10, "log"))] if len(found) > 10 else []
        return Answer("diagnose", data, (f"{len(found)} logs",), tuple(rows), units=units)
    one, swing, law, fit = found[0], found[0].swing, found[0].law, found[0].fit
    rows = [row("Verdict", one.conclusion, mark=marks.get(one.verdict, Mark.CAUTION))]
    for cure in one.remedies[:3]:
        of, ending = cure.quantity, QUANTITIES.get(cure.quantity, ("", ""))[0]
        name = cure.key.removesuffix(ending).replace("_", " ")
        only = "; rests by dry friction alone" * cure.by_friction + "; rests while held" * cure.while_held
        rows.append(row("Remedy", fill(f"{name} {{value:{of}}} in place of {{before:{of}}}{only}", vars(cure))))
    rows += [row("Next log", one.decides)] if one.decides else []
    size = f"{swing.kind} {{frequency_hz}}: {{peak_to_peak_m}}, {{force_peak_to_peak_n}}, in contact {{contact_share}}"
    rows += [row("Oscillation", fill(size, vars(swing)))] if swing.kind != "none" else []
    missed = Value(one.log.missed_share, "share")
    rows += [row("Ticks", missed, "missing", mark=Mark.CAUTION)] if one.log.missed_share else []
    if law is not None:
        gains: Parts = ()
        for name, key in (("k", "stiffness_n_per_m"), (", b", "damping_ns_per_m")):
            value, error = getattr(law, key), getattr(law, key.replace("_n", "_error_n"))
            within = ("±", Value.of(key, error, 1)) if 1e-3 * abs(value) < error < math.inf else None
            gains = (gains, name, "cannot tell" if error > abs(value) else Value.of(key, value), within)
        every = ("; new every", Value(one.log.period_s, "time")) if one.log.hold > 1 else None
        rows.append(row("Force", gains, "; residual", Value(max(law.misfit, 1e-3), "share"), every))
    if fit is not None and law is not None:
        ends, each = dict.fromkeys(one.design.delay_samples), one.design.samples_a_tick(one.log)
        late = f"± {number(fit.delay_error * each, 1)}; {'declared' if one.design.known else 'assumed'} "
        late += " to ".join(number(end, 3) for end in ends)
        rows.append(row("Delay", Value((fit.best.delay + law.lag) * each, "samples"), late))
        hand = () if fit.best.hand is None else zip(fit.best.hand.values(0).values(), subject.HAND, strict=True)
        rows.append(row("Hand", commas(Value.of(key, value) for value, key in hand) or "none"))
        rows += [row("Stops", commas(Value(at, "length") for at in fit.best.stops))] if fit.best.stops else []
    rows += subject.notes(one.notes, "Assumed", Mark.NONE, 1)
    title = parts(one.log.name, " ", Value(one.log.position_m.size * one.log.period_s, "time"))
    return Answer("diagnose", data, title, tuple(rows), units=units)
