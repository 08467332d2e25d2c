"""Identification of a device from logs: estimates, intervals, and what the logs do not identify."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi._util.text import number
from avc_casadi._util.units import A_MASS, FORCE, KG, NEWTON, speaking, units_for
from avc_casadi.files.device_file import DeviceFile
from avc_casadi.identification.assumed_mass_ratio import SHARE, other_shares, share_assumed, share_refused, shared
from avc_casadi.identification.assumed_mass_ratio import moved as beyond_side
from avc_casadi.identification.closed_loop import autocorrelation, feeds_back, only_feedback, refused_beside
from avc_casadi.identification.device import SEARCHED, device_file, states
from avc_casadi.identification.doubts import doubts_of
from avc_casadi.identification.encoder import EVENLY, encoder_step_m, repeat_notes, repeats_of
from avc_casadi.identification.estimates import estimates_of, widened
from avc_casadi.identification.fit import Fit, Window, judged, slowest_observer
from avc_casadi.identification.frequency import measured_response, model_response
from avc_casadi.identification.identifiability import (
    cannot_tell,
    never_told,
    not_of_one_kind,
    not_told_apart,
    refusals,
    vague_terms,
)
from avc_casadi.identification.initial_guess import first_guess, in_ticks, saturated_force_n
from avc_casadi.identification.log_consistency import (
    check_against,
    differs_from,
    leans_on,
)
from avc_casadi.identification.model import (
    Doubt,
    Identification,
    Refusal,
    Shown,
    doubted,
    known_at_handle,
    of_the_turn,
    radius_of,
)
from avc_casadi.identification.predictor import Observer, Predictor
from avc_casadi.identification.read import read_logs
from avc_casadi.identification.record import Record, shortened
from avc_casadi.identification.select import HIDDEN, select
from avc_casadi.identification.selection import Selection, settled, without
from avc_casadi.identification.terms import DEAD_ZONE, DRAG, PARAMETERS, PLAY, TERMS, Structure
from avc_casadi.identification.told import remarks
from avc_casadi.identification.uncertainty import Spread, richardson, sensitivity, spread_of
from avc_casadi.identification.units import Layout
from avc_casadi.model.quantity import power_at_handle

MOST_SAMPLES = 120_000
_SHOWN_S = 1.5
_SHOWN_RATE_PER_S = 4.0
# Rates of the alternative observers, as multiples of the best: a wrong model has other estimates under them.
_OTHER_OBSERVERS = (3.0, 0.4, 0.12)
_LEAST_S = 1.0
# A rigid model that explains less of the force does not determine its sign.
_FOLLOWS = 0.3
# Plausible masses at a handle; others are a mistaken unit.
_LIGHTEST_KG, _HEAVIEST_KG = 1e-3, 2e3


def identify(
    logs: Sequence[str | Path] | str | Path | Sequence[Record],
    *,
    layout: Layout | None = None,
    base: DeviceFile | None = None,
    known: Mapping[str, float] | None = None,
    added_mass_kg: Sequence[float] = (),
    encoder_at: str | None = None,
    flip_force: bool = False,
    handle_radius_m: float | None = None,
    most_samples: int = MOST_SAMPLES,
    progress: Progress = SILENT,
) -> Identification:
    """Identify a device from logs of time, position and commanded force.

    Args:
        logs: files, or records.
        layout: columns and units of the files.
        base: prior knowledge of the device, for what the logs do not identify.
        known: fixed values, by key of a device file; of a rotary device inertia_kgm2 and damping_nms_per_rad.
        added_mass_kg: known mass on the device, one of each log.
        encoder_at: "motor" or "handle"; None takes that of the base, or the one with the better evidence.
        flip_force: whether the logs count the force against +position.
        handle_radius_m: radius at which the hand holds a rotary device, if not as in the base.
        most_samples: longer records are cut to so many samples in all.
        progress: of the search.

    Raises:
        InputError: every fault of the logs, or a mass that comes out negative or absurd.
    """
    records, notes = _records(logs, layout, added_mass_kg)
    records, told = in_ticks(records)
    notes += told
    if encoder_at not in {None, "motor", "handle"}:
        raise InputError.of(f"is {encoder_at!r}; allowed: motor, handle", key="encoder_at")
    if flip_force:
        records = [replace(record, force_n=-record.force_n) for record in records]
    with speaking(units_for(records[0].motion)):
        radius = radius_of(records, base, handle_radius_m)
        held = _checked(known or {}, radius)
        if base is not None:
            check_against(records, base)
        if radius is None:
            found = _identified(records, notes, base, held, encoder_at, 1.0, most_samples, progress)
        else:
            at_handle = [record.at_handle(radius) for record in records]
            held = known_at_handle(held, radius)
            found = _identified(at_handle, notes, base, held, encoder_at, radius, most_samples, progress)
            found = of_the_turn(found, radius)
        if base is not None:
            found = replace(found, notes=(*found.notes, *differs_from(found, base), *leans_on(found, base)))
        return replace(found, device=device_file(found, base))


def _identified(
    records: Sequence[Record],
    notes: list[str],
    base: DeviceFile | None,
    known: Mapping[str, float],
    encoder_at: str | None,
    radius_m: float,
    most_samples: int,
    progress: Progress,
) -> Identification:
    """Identify the device at its handle; messages give the values in rotary units."""
    records, cut = shortened(records, most_samples)
    notes += [cut] if cut else []
    seconds = sum(record.seconds for record in records)
    if seconds < _LEAST_S:
        allowed = "; ".join([f"at least {_LEAST_S:g} s", *notes])
        raise InputError.of(f"hold {number(seconds)} s in all; allowed: {allowed}", key="logs")
    step_m = encoder_step_m(records)
    force_rms, travel = _sizes(records, step_m)
    driven = only_feedback(records)
    with progress.step("first guess"):
        guess = _guess(records, radius_m, pushed=driven is not None)
    structure = _simplest(records, known, force_rms, travel, step_m, held="stiffness_n_per_m" in guess)
    if base is not None:
        structure = replace(structure, loop_damping_ratio=base.device.amplifier_damping_ratio)
    guess |= known
    repeats = repeats_of(records, step_m)
    window = Window.of([record.position_m.size for record in records], records[0].sample_time_s, repeats)
    predictor = Predictor(records, float(records[0].position_m[0]))
    response = measured_response(records)
    if encoder_at is None and base is not None and base.device.resonance is not None:
        encoder_at = base.device.encoder_at
    sides = ("motor", "handle") if encoder_at is None else (encoder_at,)
    with progress.step("model"):
        chosen = select(predictor, guess, structure, response, window, sides, progress)
    with progress.step("intervals"):
        spread, refused = _told(predictor, chosen, window)
        fit, share = chosen.fit, None
        spread = replace(spread, beyond=beyond_side(fit))
        if share_assumed(fit):
            beyond, ends = other_shares(predictor, fit, window)
            spread = replace(spread, beyond=beyond)
            share = (fit.values[SHARE], *ends)
            refused[SHARE] = share_refused(share[0], ends)
    normal, collinear = sensitivity(fit)
    inseparable = chosen.inseparable
    if "coulomb" in inseparable:
        refused["coulomb_friction_n"] = not_told_apart("coulomb_friction_n")
    refused |= {} if driven is None else refused_beside([one.name for one in fit.structure.free])
    names = tuple(dict.fromkeys(record.whole for record in records))
    lags, feedback = autocorrelation(fit.error_m), feeds_back(records, fit.error_m)
    doubts: list[Doubt] = []
    if not driven:
        halves = widened(fit, spread, chosen.rivals, inseparable)
        beyond, doubts = doubts_of(predictor, fit, halves, window, lags, feedback=feedback, radius_m=radius_m)
        spread = replace(spread, beyond=np.maximum(spread.beyond, beyond))
    estimates = doubted(estimates_of(fit, spread, chosen.rivals, refused, inseparable, step_m, names), doubts)
    absent = chosen.trials.keys() - set(fit.structure.terms)
    refused |= never_told(fit, estimates, response.excited_hz, absent, inseparable, lags) | refused
    notes += repeat_notes(records, repeats) + remarks(fit, lags, feedback, driven, radius_m)
    return Identification(
        sources=tuple(dict.fromkeys(record.name for record in records)),
        seconds=seconds,
        records=len(records),
        sample_time_s=records[0].sample_time_s,
        terms=fit.structure.terms,
        encoder_at=fit.structure.encoder_at if "resonance" in fit.structure.terms else "motor",
        amplifier_order=fit.structure.amplifier_order if "amplifier" in fit.structure.terms else 1,
        assumed_share=share,
        estimates=estimates,
        refused=tuple(_from(base, one, doubts) for one in refused.values()),
        trials=tuple(chosen.trials.values()),
        names=tuple(one.name for one in fit.structure.free),
        correlation=spread.correlation,
        sensitivity=normal,
        collinearity=collinear,
        spread_from=spread.source,
        error_rms_m=fit.rms_m,
        observer_rate_per_s=fit.observer.rate_per_s,
        error_m=np.concatenate(fit.error_m),
        feedback=feedback,
        lags=lags,
        notes=(*notes, *(one.note for one in doubts)),
        response=response,
        modelled=model_response(fit.values, fit.structure, records[0].sample_time_s, response.frequency_hz),
        shown=_shown(records, fit),
        device=None,
    )


def _sizes(records: Sequence[Record], step_m: float | None) -> tuple[float, float]:
    """Return the change of the force and the travel; refuse logs that identify nothing."""
    changes = np.concatenate([record.force_n - record.force_n.mean() for record in records])
    force = float(np.sqrt(np.mean(changes**2)))
    travel = max(float(np.ptp(record.position_m)) for record in records)
    places = max(np.unique(record.position_m).size for record in records)
    nothing = cannot_tell(force, travel / step_m if step_m else float(places))
    if nothing:
        raise InputError.of("; ".join(f"{one.why}; allowed: {one.excitation}" for one in nothing), key="logs")
    sizes = [record.position_m.size for record in records]
    skip = Window.of(sizes, records[0].sample_time_s).skip
    if not any(np.ptp(record.position_m[skip:]) for record in records):
        start = number(skip * records[0].sample_time_s)
        message = f"move in the first {start} s only, which the model needs to begin, and stand still after; allowed: "
        raise InputError.of(message + "motion that goes on (a multisine, as avc excite plays one)", key="logs")
    return force, travel


def _guess(records: Sequence[Record], radius_m: float, *, pushed: bool) -> dict[str, float]:
    """Return the initial guess; refuse a force of reversed sign or saturated, and implausible units.

    A device that a hand moves does not follow its force at all.
    """
    found = first_guess(records, pushed=pushed)
    guess, explained = found.values, found.explained
    mass = guess["mass_kg"]
    size = radius_m**2
    if mass < 0 or (found.against and explained > _FOLLOWS and not pushed):
        why, allowed = f"{FORCE} and position point against each other", f"{FORCE} along +position, or --flip-force"
        if explained < _FOLLOWS:
            why = f"the motion hardly follows the {FORCE} ({number(100 * max(explained, 0.0), 2)} % of it explained)"
            allowed = (
                f"a multisine with several times the {FORCE}, free of contact; is it the {FORCE} that acts, in time?"
            )
        raise InputError.of(f"give {A_MASS} of {number(mass * size)} {KG}: {why}; allowed: {allowed}", key="logs")
    if not _LIGHTEST_KG <= mass <= _HEAVIEST_KG:
        raise InputError.of(
            f"give {A_MASS} of {number(mass * size)} {KG}; allowed: {number(_LIGHTEST_KG * size)} to "
            f"{number(_HEAVIEST_KG * size)} {KG}; are the units of position and {FORCE} right?",
            key="logs",
        )
    limit = None if pushed else saturated_force_n(records, guess["delay_samples"])
    if limit is not None:
        largest = max(float(np.abs(record.force_n).max()) for record in records)
        message = (
            f"asks for up to {number(largest, 3)} {NEWTON}, and the device follows it up to about {number(limit, 2)} "
            f"{NEWTON}: what acts is then not what is logged; allowed: a log below that {FORCE}, or the {FORCE} as the "
            "amplifier gives it"
        )
        raise InputError([Fault(records[0].name, None, "force", message)])
    return {**guess, "force_scale": 1.0}


def _told(predictor: Predictor, chosen: Selection, window: Window) -> tuple[Spread, dict[str, Refusal]]:
    """Return uncertainty and refusals; terms that are not identifiable are removed, and the rest is fitted again."""
    while True:
        fit = chosen.fit
        spread = spread_of(fit, _beside(predictor, fit, window))
        normal, _ = sensitivity(fit)
        refused = refusals(fit, spread.half_width, normal)
        if SHARE in refused:
            chosen.fit = settled(predictor, shared(predictor, fit, window, 1e-6), window)
            continue
        halves = widened(fit, spread, chosen.rivals, chosen.inseparable)
        refused |= not_of_one_kind(fit, halves)
        vague = vague_terms(fit, halves, refused)
        # Rivals widen an interval beyond what tells a number, too; a delay that holds a lag is told where it is not 0.
        wide = {key: one for key, one in refusals(fit, halves, normal).items() if key in SEARCHED}
        refused |= {key: one for key, one in wide.items() if key != "delay_samples" or _reaches_zero(one)}
        if fit.hides_play:
            without(predictor, chosen, "play", HIDDEN, window)
        elif vague:
            without(predictor, chosen, vague[0], "is not identified well enough for a model", window)
        else:
            chosen.fit, spread = richardson(predictor, fit, spread, window)
            return spread, refused


def _reaches_zero(one: Refusal) -> bool:
    return one.bounds is not None and one.bounds[1] <= 0


def _beside(predictor: Predictor, fit: Fit, window: Window) -> list[Fit]:
    """Return the fit under faster and slower observers, and under another time course of the backlash."""
    rate, slowest, fastest = fit.observer.rate_per_s, slowest_observer(predictor), 1 / predictor.sample_time_s
    rates = {min(max(rate * by, slowest), fastest) for by in _OTHER_OBSERVERS} - {rate}
    found = [judged(predictor, fit.structure, fit.search, Observer(other), window) for other in sorted(rates)]
    if fit.structure.present(PLAY):
        evenly = predictor.of(predictor.records, EVENLY)
        found.append(judged(evenly, fit.structure, fit.search, fit.observer, window))
    return found


def _records(
    logs: Sequence[str | Path] | str | Path | Sequence[Record], layout: Layout | None, added: Sequence[float]
) -> tuple[list[Record], list[str]]:
    if isinstance(logs, str | Path):
        logs = [logs]
    given = [one for one in logs if isinstance(one, Record)]
    if given:
        return given, []
    paths = [one for one in logs if isinstance(one, str | Path)]
    if not paths:
        raise InputError.of("are none; allowed: at least one log", key="logs")
    return read_logs(paths, layout, added)


def _checked(known: Mapping[str, float], radius_m: float | None = None) -> dict[str, float]:
    """Return the values by internal keys; a rotary device has a radius and keys of its own."""
    units = units_for("linear" if radius_m is None else "rotary")
    inner = {units.key(one.name): one.name for one in TERMS["base"].parameters}
    if not set(known) <= set(inner):
        # Not quoted: text on a rotary device would be converted to its units.
        raise InputError.of(
            f"names what a device that moves like this has not; allowed: {', '.join(inner)}", key="known"
        )
    for key, value in known.items():
        one, size = PARAMETERS[inner[key]], (radius_m or 1.0) ** -power_at_handle(inner[key])
        low, high = one.lowest * size, one.highest * size
        if not low <= value <= high:
            raise InputError.of(f"has {key} = {value:g}; allowed: {low:g} to {high:g}", key="known")
    return {inner[key]: float(value) for key, value in known.items()}


def _simplest(
    records: Sequence[Record],
    known: Mapping[str, float],
    force: float,
    travel: float,
    step_m: float | None,
    *,
    held: bool,
) -> Structure:
    """Return the initial structure: a force scale where a mass is known, a stiffness for a device on a spring."""
    speed = max(
        float(np.std(np.diff(record.position_m[:: max(1, int(0.01 / record.sample_time_s))])))
        / (max(1, int(0.01 / record.sample_time_s)) * record.sample_time_s)
        for record in records
    )
    seconds = max(record.begins_s + record.seconds for record in records)
    units = {
        "damping_ns_per_m": force / speed,
        "damping_asymmetry_ns_per_m": force / speed,
        "offset_n": force,
        "coulomb_friction_n": force,
        "breakaway_excess_n": force,
        "offset_drift_n_per_s": force / seconds,
        "stiffness_n_per_m": force / travel,
        DEAD_ZONE: force,
        DRAG: force / speed**2,
        "speed_m_per_s": speed,
        PLAY: step_m or 1e-3 * travel,
    }
    scaled = "mass_kg" in known or len({record.added_mass_kg for record in records}) > 1
    logs = len({record.whole for record in records})
    terms = ("base", *(["stiffness"] if held else []), *(["scale"] if scaled else []))
    return Structure(terms, known, units, logs=logs)


def _from(base: DeviceFile | None, refused: Refusal, doubts: Sequence[Doubt]) -> Refusal:
    """Return the other source of a value that is refused; bounds in doubt are none."""
    if any(doubt.keys is None for doubt in doubts):
        refused = replace(refused, bounds=None)
    if base is None or not states(base, refused.key):
        return refused
    if refused.key in SEARCHED:
        return replace(refused, why=f"{refused.why}; it is a gap of the device file, with a range")
    return replace(refused, why=f"{refused.why}; the value of {base.name} is written")


def _shown(records: Sequence[Record], fit: Fit) -> tuple[Shown, ...]:
    """Return stretches of the longest records in which the model runs nearly free."""
    found = []
    logs = tuple(dict.fromkeys(record.whole for record in records))
    for record in sorted(records, key=lambda one: -one.seconds)[:2]:
        free = Predictor([record], float(records[0].position_m[0]), logs)
        error = free.predict(fit.structure, fit.search, Observer(_SHOWN_RATE_PER_S), slopes=False)[0].error_m
        size = min(record.position_m.size // 2, int(_SHOWN_S / record.sample_time_s))
        first = record.position_m.size - size - size // 4
        part = slice(first, first + size)
        time = np.asarray(np.arange(first, first + size) * record.sample_time_s, dtype=np.float64)
        position = record.position_m[part]
        found.append(Shown(record.name, time, position, position - error[part], record.force_n[part]))
    return tuple(found)
