"""Rows of a device that is measured: an excitation, an identified device, a diagnosis."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from shlex import quote

from avc_casadi._util.json_values import plain
from avc_casadi._util.text import number, plural
from avc_casadi._util.units import Quantity, Units
from avc_casadi.diagnose.causes import Diagnosis
from avc_casadi.diagnose.fit import PlantFit
from avc_casadi.diagnose.law import FittedLaw
from avc_casadi.diagnose.oscillation import Log, Oscillation
from avc_casadi.diagnose.remedies import Remedy
from avc_casadi.diagnose.should_run import RunComparison
from avc_casadi.files.plausibility import device_plausibility
from avc_casadi.identification.device import Estimate, Identification
from avc_casadi.identification.excitation import Excitation, ExcitationFigures
from avc_casadi.identification.fit import FitTrial
from avc_casadi.model.hands import Hand
from avc_casadi.present import words
from avc_casadi.present.row import Answer, Mark, Part, Parts, Row, Value, commas, grade, parts, row
from avc_casadi.present.rows import subject
from avc_casadi.present.rows.look import Doubt


@dataclass(frozen=True)
class ExcitationLimits:
    """Limits of an excitation."""

    force_n: float
    speed_m_per_s: float
    travel_m: float


@dataclass(frozen=True)
class ExcitationForecast:
    """The largest values that a plan reaches on the devices of the ranges."""

    force_n: float
    speed_m_per_s: float
    travel_m: float
    stroke_m: float


@dataclass(frozen=True)
class ExcitationPlan:
    """Figures of a plan of `avc excite`, with what is forecast at most on the devices of the ranges."""

    signal: str
    seconds: float
    lowest_hz: float
    highest_hz: float
    peak_force_n: float
    held_back_by: str
    limits: ExcitationLimits
    spring_n_per_m: float
    damper_ns_per_m: float
    devices: int
    forecast: ExcitationForecast

    @classmethod
    def of(cls, planned: Excitation) -> ExcitationPlan:
        """Return the figures of a plan."""
        plan, forecast = planned.plan, planned.forecast
        lowest_hz, highest_hz = plan.band_hz
        return cls(
            signal=plan.kind,
            seconds=plan.seconds,
            lowest_hz=lowest_hz,
            highest_hz=highest_hz,
            peak_force_n=plan.peak_force_n,
            held_back_by=plan.units.key(planned.nearest_limit),
            limits=ExcitationLimits(plan.max_force_n, plan.max_speed_m_per_s, plan.max_travel_m),
            spring_n_per_m=plan.spring_n_per_m,
            damper_ns_per_m=plan.damper_ns_per_m,
            devices=len(planned.devices),
            forecast=ExcitationForecast(
                force_n=float(forecast.force_n.max()),
                speed_m_per_s=float(forecast.speed_m_per_s.max()),
                travel_m=float(forecast.travel_m.max()),
                stroke_m=float(forecast.stroke_m.max()),
            ),
        )


def plan(planned: ExcitationPlan, units: Units, shown: str, port: str) -> Answer:
    """Return the plan of `excite`."""
    corners = "worst device of the ranges" if planned.devices > 1 else "declared device"
    band = (Value(planned.lowest_hz, "frequency"), "to", Value(planned.highest_hz, "frequency"))
    peak = (", peak", Value(planned.peak_force_n, "force"), f"; bounded by {planned.held_back_by}")
    limits, forecast = planned.limits, planned.forecast
    spring, damper = Value(planned.spring_n_per_m, "stiffness"), Value(planned.damper_ns_per_m, "damping")

    def reached(label: str, most: float, allowed: float, quantity: Quantity) -> Row:
        return row(label, Value(most, quantity), "of", Value(allowed, quantity), f"allowed, {corners}")

    rows = [
        row("Signal", f"{planned.signal},", band, peak),
        reached("Force", forecast.force_n, limits.force_n, "force"),
        reached("Speed", forecast.speed_m_per_s, limits.speed_m_per_s, "speed"),
        reached("Travel", forecast.travel_m, limits.travel_m, "length"),
        row("Centred by", "spring", spring, ", damper", damper, "; keep hands off"),
    ]
    title = parts(shown, " ", f"{planned.signal} of", Value(planned.seconds, "time"), f"on {port}")
    document = {"plan": plain(planned), "out": None, "log": None}
    return Answer("excite", document, title, tuple(rows), units=units)


def log(
    played: ExcitationFigures,
    units: Units,
    title: str,
    *,
    planned: ExcitationPlan | None = None,
    out: str | None = None,
    onwards: Sequence[str] = (),
) -> Answer:
    """Return the answer of `excite`: the log that was played; of one that was cut short the log alone."""
    lost = f"{played.lost} lost, seen as gaps" if played.lost else "none lost"
    recorded = (f"{plural(played.records, 'record')} in", Value(played.seconds, "time"), f", {lost}")
    force, speed = Value(played.peak_force_n, "force"), Value(played.peak_speed_m_per_s, "speed")
    rows = [
        row("Played", played.end, mark=grade(played.whole)),
        row("Recorded", recorded),
        row("At most", force, ",", speed, ",", Value(played.peak_travel_m, "length")),
    ]
    document = {"log": plain(played)} if planned is None else {"plan": plain(planned), "out": out, "log": plain(played)}
    return Answer("excite", document, (title,), tuple(rows), tuple(onwards), units)


_FIRST_ESTIMATES = 9
"""Values of an identified device that are shown without -v."""


def identification(result: Identification, units: Units, logs: Sequence[str], out: str | None) -> Answer:
    """Return the answer of `identify`: a row for each value of the device."""
    length = (Value(result.seconds, "time"), f"in {plural(result.records, 'record')} at")
    title = parts(", ".join(logs), " ", length, Value(1 / result.sample_time_s, "frequency"))
    rows = [
        _estimate(units.key(key), estimate, rank=0 if place < _FIRST_ESTIMATES else 1)
        for place, (key, estimate) in enumerate(result.estimates.items())
    ]
    rows.append(row("Model", ", ".join(result.rungs)))
    rows += subject.notes(result.notes, mark=Mark.CAUTION)
    doubts = (
        []
        if result.device is None
        else [Doubt(fault.key, fault.message) for fault in device_plausibility(result.device)]
    )
    rows += subject.notes((doubt.text for doubt in doubts), "Warning")
    rows.append(row("Not known", ", ".join(map(units.key, result.unknown)), rank=1))
    rows += map(_rung, result.trials)
    onwards = (f"avc check {quote(out)}",) if out else ()
    document = result.data() | {"warnings": plain(doubts), "out": out}
    return Answer("identify", document, title, tuple(rows), onwards, units)


def _estimate(label: str, estimate: Estimate, rank: int) -> Row:
    """Return a value with its interval, to as many digits as that supports."""
    half = (estimate.high - estimate.low) / 2
    size = max(abs(estimate.low), abs(estimate.high))
    digits = 3
    if 0 < half < size:
        digits = min(max(3, 1 + math.ceil(math.log10(size / half))), 15)
    best = 0.0 if abs(estimate.value) < 1e-3 * half else estimate.value
    value, low, high = (Value(end, estimate.quantity, digits) for end in (best, estimate.low, estimate.high))
    if estimate.identified:
        return row(label, value, "(", low, "to", high, ")", rank=rank)
    return row(label, low, "to", high, "; not identified", mark=Mark.CAUTION, rank=rank)


def _rung(trial: FitTrial) -> Row:
    """Return whether a rung of the model was taken, and why not."""
    taken = "taken" if trial.taken else "not taken"
    errors = f"on held-out data, {trial.standard_errors:.2g} standard errors"
    why = f"; {trial.why}" if trial.why else ""
    return row(f"Rung {trial.rung}", f"{taken}: error", Value(trial.change, "share"), f"{errors}{why}", rank=1)


_VERDICT_MARKS = {"nothing wrong": Mark.PASS, "named": Mark.FAIL}
"""Marks of the verdicts of a diagnosis; others are a caution."""
_MOST_LOGS = 10
_MOST_REMEDIES = 3
"""Logs and remedies that have a row."""
_LEAST_MISFIT = 1e-3
"""Residual of a law below which its row says no more."""


def diagnosis(diagnoses: Sequence[Diagnosis]) -> Answer:
    """Return the answer of `diagnose`: the rows of one log, or a row for each of several."""
    units = diagnoses[0].design.device.units
    documents = [result.data() for result in diagnoses]
    if len(diagnoses) > 1:
        rows = [
            row(result.log.name, result.conclusion, _other_coupling(result), mark=_verdict_mark(result))
            for result in diagnoses[:_MOST_LOGS]
        ]
        rows += [row("Others", plural(len(diagnoses) - _MOST_LOGS, "log"))] if len(diagnoses) > _MOST_LOGS else []
        return Answer("diagnose", {"logs": documents}, (f"{len(diagnoses)} logs",), tuple(rows), units=units)
    log = diagnoses[0].log
    title = parts(log.name, " ", Value(log.position_m.size * log.period_s, "time"))
    return Answer("diagnose", documents[0], title, tuple(_diagnosis_rows(diagnoses[0])), units=units)


def _other_coupling(result: Diagnosis) -> str | None:
    """Return that a log of several does not run the coupling that should have run."""
    compared = result.compared
    return f"; does not run coupling {compared.coupling}" if compared and compared.runs is False else None


def _verdict_mark(result: Diagnosis) -> Mark:
    return _VERDICT_MARKS.get(result.verdict, Mark.CAUTION)


def _diagnosis_rows(result: Diagnosis) -> list[Row]:
    """Return the rows of one log: verdict, remedies, oscillation, and what was fitted."""
    rows = [row("Verdict", result.conclusion, mark=_verdict_mark(result))]
    rows += map(_remedy, result.remedies[:_MOST_REMEDIES])
    if result.decides:
        rows.append(row("Next log", result.decides))
    if result.swing.kind != "none":
        rows.append(_oscillation(result.swing))
    if result.log.missed_share:
        missed = Value(result.log.missed_share, "share")
        rows.append(row("Ticks", missed, "missing", mark=Mark.CAUTION))
    if result.law is not None:
        rows.append(_fitted_law(result.law, result.log))
    if result.compared is not None:
        rows.append(_compared(result.compared, result.law, result.log))
    if result.law is not None and result.fit is not None:
        rows += _fitted_plant(result, result.law, result.fit)
    return [*rows, *subject.notes(result.notes)]


def _remedy(remedy: Remedy) -> Row:
    only = "; settles only by dry friction" if remedy.by_friction else ""
    only += "; settles only while held" if remedy.while_held else ""
    value = Value(remedy.value, remedy.quantity)
    before = "none" if remedy.before is None else Value(remedy.before, remedy.quantity)
    return row("Remedy", words.REMEDIES[remedy.key], value, "instead of", before, only)


def _oscillation(swing: Oscillation) -> Row:
    position, force = Value(swing.peak_to_peak_m, "length"), Value(swing.force_peak_to_peak_n, "force")
    hz, share = Value(swing.frequency_hz, "frequency"), Value(swing.contact_share, "share")
    return row("Oscillation", swing.kind, hz, ":", position, ",", force, ", in contact", share)


def _fitted_law(law: FittedLaw, log: Log) -> Row:
    """Return spring and damper of the logged force, and what they leave of it."""
    spring = _gain(law.stiffness_n_per_m, law.stiffness_error_n_per_m, "stiffness")
    damper = _gain(law.damping_ns_per_m, law.damping_error_ns_per_m, "damping")
    period = ("; new every", Value(log.period_s, "time")) if log.hold > 1 else None
    residual = Value(max(law.misfit, _LEAST_MISFIT), "share")
    return row("Force", "k", spring, ", b", damper, "; residual", residual, period)


def _compared(compared: RunComparison, law: FittedLaw | None, log: Log) -> Row:
    """Return whether the log runs the coupling that should have run, with both springs and dampers."""
    name = f"coupling {compared.coupling}"
    if compared.runs is None or law is None:
        why = "" if compared.why_not is None else compared.why_not.value
        return row("Coupling", f"not compared with {name}: {why}", mark=Mark.CAUTION)
    stiffness = Value(compared.stiffness_n_per_m, "stiffness")
    expected = parts("k", stiffness, ", b", Value(compared.damping_ns_per_m, "damping"))
    if compared.runs:
        return row("Coupling", f"the force is that of {name} in series with its wall:", expected, mark=Mark.PASS)
    spring = _gain(law.stiffness_n_per_m, law.stiffness_error_n_per_m, "stiffness")
    damper = _gain(law.damping_ns_per_m, law.damping_error_ns_per_m, "damping")
    fitted = parts("k", spring, ", b", damper)
    if not compared.same_rate(log):
        fitted += ("every", Value(log.period_s, "time"))
        expected += ("every", Value(compared.sample_time_s, "time"))
    differs = f"the log does not run {name}:"
    return row("Coupling", differs, fitted, "in place of", expected, "in series with its wall", mark=Mark.CAUTION)


def _gain(value: float, error: float, quantity: Quantity) -> tuple[Part, ...]:
    """Return a gain with its error, where that is more than a thousandth of it and not more than it."""
    within = ("±", Value(error, quantity, 1)) if 1e-3 * abs(value) < error < math.inf else None
    return parts("not determined" if error > abs(value) else Value(value, quantity), within)


def _fitted_plant(result: Diagnosis, law: FittedLaw, fit: PlantFit) -> list[Row]:
    """Return delay, hand, resonance and travel stops of the fitted plant."""
    samples_a_tick = result.design.samples_a_tick(result.log)
    intended = " to ".join(number(end, 3) for end in dict.fromkeys(result.design.delay_samples))
    origin = "declared" if result.design.known else "assumed"
    error = f"± {number(fit.delay_error * samples_a_tick, 1)}; {origin} {intended}"
    delay = Value((fit.best.delay + law.lag) * samples_a_tick, "samples")
    hand = _fitted_hand(fit.best.hand) if result.hand_determined else "not determined"
    rows = [row("Delay", delay, error), row("Hand", hand)]
    mode = fit.best.device.resonance
    if mode is not None and fit.resonance_hz is not None:
        interval = "to".join(f" {number(end, 3)} " for end in fit.resonance_hz).strip()
        rows.append(row("Resonance", Value(mode.frequency_hz, "frequency"), f"; {interval} Hz at 95 %, not declared"))
    if fit.best.stops:
        places = commas(Value(position, "length") for position in fit.best.stops)
        rows.append(row("Stops", places, ", if the device has any: the fit leaves out the motion beyond them"))
    return rows


def _fitted_hand(hand: Hand | None) -> Parts:
    if hand is None:
        return "none"
    values = hand.values(0)
    return commas(Value.of(key, values[key]) for key in subject.HAND)
