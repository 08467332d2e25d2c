"""Identification of a device from logs: estimates, intervals, and what the logs do not tell."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi._util.text import number
from avc_casadi._util.units import units_for
from avc_casadi.files.device_file import DeviceFile
from avc_casadi.identification.closed_loop import autocorrelation, coloured, only_feedback
from avc_casadi.identification.device import check_against, device_file, differences
from avc_casadi.identification.encoder import encoder_step_m
from avc_casadi.identification.fit import Window
from avc_casadi.identification.frequency import measured_response, model_response
from avc_casadi.identification.intervals import bootstrap
from avc_casadi.identification.ladder import WIDEST, Ladder
from avc_casadi.identification.model import Estimate, Identification, Stretch
from avc_casadi.identification.predictor import Observer, Predictor
from avc_casadi.identification.read import read_logs
from avc_casadi.identification.record import Record, shortened
from avc_casadi.identification.regression import Motion, Start, in_ticks
from avc_casadi.identification.terms import (
    FRICTION,
    MASS_RATIO,
    OFFSET,
    PARAMETERS,
    RUNGS,
    Structure,
    offset_of,
)
from avc_casadi.identification.units import Layout

MOST_SAMPLES = 120_000
_LEAST_S, _FEWEST_STEPS = 1.0, 12
_STRETCH_S, _STRETCH_RATE_PER_S = 1.5, 4.0
# A rigid model that explains less of the force does not determine its sign.
_FOLLOWS = 0.3
# Plausible masses of a device that slides, and inertias of one that turns; others are a mistaken unit.
_PLAUSIBLE = {"linear": (1e-3, 2e3), "rotary": (1e-8, 1e4)}
# A log moves one way if so little of its travel goes the other.
_OTHER_WAY = 0.01
# Encoder resolution is known to this share of it; noise is told from this share of its rounding on, and to this one.
_STEP_SHARE, _LEAST_NOISE, _NOISE_SHARE = 1e-3, 0.3, 0.15
_LOGS = {
    "mass_kg": "a multisine of 1 to 30 Hz with several times the force of the friction",
    "damping_ns_per_m": "long strokes at several speeds",
    "delay_samples": "a multisine or chirp up to a fifth of the sample rate, or steps of force",
    FRICTION: "slow strokes both ways with many reversals, the force twice the friction or more",
    OFFSET: "strokes both ways",
    "resonance": "a multisine or chirp of 20 Hz to a third of the sample rate, over several encoder steps",
    MASS_RATIO: "a log of the position at the motor, or the handle weighed",
    "amplifier_bandwidth_hz": "a higher sample rate, or a log of the current; the delay holds its lag",
    "stiffness_n_per_m": "slow strokes over the whole travel",
    "force_scale": "two logs, one with a known mass on the device (--added-mass), or --known",
    "encoder_resolution_m": "the encoder's own counts, unfiltered",
    "max_force_n": "the amplifier's data sheet",
}
"""The log that would tell each value."""


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
    progress: Progress = SILENT,
) -> Identification:
    """Identify a device from logs of time, position and commanded force."""
    records, notes = _records(logs, layout, added_mass_kg)
    if encoder_at not in {None, "motor", "handle"}:
        raise InputError.of(f"is {encoder_at!r}; allowed: motor, handle", key="encoder_at")
    if flip_force:
        records = [
            replace(one, force_n=-one.force_n, later_n=None if one.later_n is None else -one.later_n) for one in records
        ]
    fixed = _fixed(known or {}, records, base, handle_radius_m)
    if base is not None:
        check_against(records, base)
    records, by_clock = in_ticks(records)
    whole = sum(one.position_m.size for one in records)
    records = shortened(records, MOST_SAMPLES)
    used = sum(one.position_m.size for one in records)
    notes += by_clock + ([f"of {whole} samples {used} were used, in pieces over the records"] if used < whole else [])
    step_m = encoder_step_m(records)
    rms_n, travel_m = _sizes(records, step_m)
    ways = {_way(one) for one in records}
    offsets = len({one.whole for one in records})
    if ways <= {-1, 1}:
        # Friction and a constant force are one number in a log of one direction: of logs both ways it is the same.
        offsets = 1 if len(ways) > 1 else 0
        fixed = fixed if offsets else {OFFSET: 0.0, **fixed}
    with progress.step("first guess"):
        motion = Motion(records, offsets)
        start = _checked(motion, one_way=ways <= {-1, 1})
    structure = _simplest(records, fixed, rms_n, travel_m, start, offsets)
    if encoder_at is None and base is not None and base.device.resonance is not None:
        encoder_at = base.device.encoder_at
    predictor, response = Predictor(records), measured_response(records)
    sides = ("motor", "handle") if encoder_at is None else (encoder_at,)
    with progress.step("model"):
        begun = {OFFSET: 0.0, "force_scale": 1.0, **start.values, **fixed}
        found = Ladder.climb(predictor, structure, begun, response, sides, progress)
    fit = found.fit
    estimates = _estimates(found, step_m, one_way=len(ways) == 1 and ways <= {-1, 1})
    lags = autocorrelation(fit.error_m)
    if coloured(lags, resampled=any(one.scatter for one in records)):
        notes.append(
            "the prediction error is not white: something that the model does not know moves the device (a hand, play, "
            "a cable, friction of another kind), and intervals may not hold the truth"
        )
    if "spring" in fit.structure.rungs:
        notes.append("a spring holds the device; a device file has no key for it: log the device released if it can be")
    identified = Identification(
        sources=tuple(dict.fromkeys(one.name for one in records)),
        seconds=sum(one.seconds for one in records),
        records=len(records),
        sample_time_s=predictor.sample_time_s,
        motion=records[0].motion,
        rungs=fit.structure.rungs,
        encoder_at=fit.structure.encoder_at if "resonance" in fit.structure.rungs else "motor",
        estimates=estimates,
        unknown=_unknown(estimates, fit.structure),
        trials=tuple(found.trials.values()),
        names=tuple(fit.structure.names),
        correlation=bootstrap(fit)[1],
        error_m=np.concatenate(fit.error_m),
        lags=lags,
        notes=tuple(notes),
        response=response,
        modelled=model_response(fit.values, fit.structure, predictor.sample_time_s, response.frequency_hz),
        stretches=_stretches(predictor, found),
    )
    if base is not None:
        identified = replace(identified, notes=(*identified.notes, *differences(identified, base)))
    return replace(identified, device=device_file(identified, base, handle_radius_m))


def _records(
    logs: Sequence[str | Path] | str | Path | Sequence[Record], layout: Layout | None, added: Sequence[float]
) -> tuple[list[Record], list[str]]:
    several = [logs] if isinstance(logs, str | Path) else list(logs)
    records = [one for one in several if isinstance(one, Record)]
    notes: list[str] = []
    if not records:
        paths = [one for one in several if isinstance(one, str | Path)]
        if not paths:
            raise InputError.of("are none; allowed: at least one log", key="logs")
        records, notes = read_logs(paths, layout, added)
    if len({one.motion for one in records}) > 1:
        raise InputError.of("are of a device that turns and of one that does not; allowed: one kind", key="logs")
    seconds = sum(one.seconds for one in records)
    if seconds < _LEAST_S:
        raise InputError.of(f"hold {number(seconds)} s in all; allowed: at least {_LEAST_S:g} s", key="logs")
    return records, notes


def _fixed(
    known: Mapping[str, float], records: Sequence[Record], base: DeviceFile | None, handle_radius_m: float | None
) -> dict[str, float]:
    """Return the known values by internal keys, and check the motion of the device."""
    motion = records[0].motion
    units = units_for(motion)
    faults = []
    if base is not None and base.device.motion != motion:
        kinds = {"linear": "metres and newtons", "rotary": "rad and N.m"}
        faults.append(
            Fault("", None, "logs", f"are in {kinds[motion]}, and {base.name} is not; allowed: a base of their motion")
        )
    if motion == "linear" and handle_radius_m is not None:
        faults.append(Fault("", None, "handle_radius_m", "says nothing of logs in metres; allowed: beside logs in rad"))
    inner = {units.key(name): name for name in RUNGS["rigid"]}
    for key, value in known.items():
        if key not in inner:
            faults.append(Fault("", None, "known", f"names {key}; allowed: {', '.join(inner)}"))
            continue
        one = PARAMETERS[inner[key]]
        if not one.lowest <= value <= one.highest:
            faults.append(
                Fault("", None, "known", f"has {key} = {value:g}; allowed: {one.lowest:g} to {one.highest:g}")
            )
    if faults:
        raise InputError(faults)
    return {inner[key]: float(value) for key, value in known.items()}


def _sizes(records: Sequence[Record], step_m: float | None) -> tuple[float, float]:
    """Return the change of the force and the travel; refuse logs that tell nothing."""
    rms_n = float(np.sqrt(np.mean(np.concatenate([one.force_n for one in records]) ** 2)))
    travel = max(float(np.ptp(one.position_m)) for one in records)
    places = max(np.unique(one.position_m).size for one in records)
    steps = travel / step_m if step_m else float(places)
    if steps < _FEWEST_STEPS:
        raise InputError.of(
            f"move over {number(steps, 2)} steps of the encoder only; allowed: more force, or lower frequencies: a "
            "travel of 50 steps and more",
            key="logs",
        )
    if max(float(np.ptp(one.force_n)) for one in records) < 1e-9 and len(records) == 1:
        raise InputError.of(f"have a force that never changes; allowed: {_LOGS['mass_kg']}", key="logs")
    skip = Window.of(Predictor(records)).skip
    if not any(np.ptp(one.position_m[skip:]) for one in records):
        raise InputError.of(
            f"move in the first {number(skip * records[0].sample_time_s)} s only, which the model needs to begin; "
            "allowed: motion that goes on (a multisine, as avc excite plays one)",
            key="logs",
        )
    if only_feedback(records) is not None:
        raise InputError.of(
            "have a force that is a spring and a damper on the measured position and nothing else, while the device "
            "goes on moving: what moves it is not logged; allowed: a force of its own beside the controller (a "
            "multisine, as avc excite plays one), hands off",
            key="logs",
        )
    return rms_n, travel


def _way(record: Record) -> int:
    """Return the direction in which a record moves, 0 if both ways; some steps back at rest are noise."""
    moves = np.diff(record.position_m)
    forth, back = float(moves[moves > 0].sum()), -float(moves[moves < 0].sum())
    if min(forth, back) > _OTHER_WAY * max(forth, back):
        return 0
    return 1 if forth > back else -1


def _checked(motion: Motion, *, one_way: bool) -> Start:
    """Return the start; refuse a force of reversed sign or saturated, and implausible units."""
    start, records = motion.start(), motion.records
    mass = start.values["mass_kg"]
    if mass < 0 or (start.against and start.explained > _FOLLOWS):
        why, allowed = "force and position point against each other", "force along +position, or --flip-force"
        if start.explained < _FOLLOWS:
            share = number(100 * max(start.explained, 0.0), 2)
            why = f"the motion hardly follows the force ({share} % of it explained)"
            allowed = "a multisine with several times the force, free of contact; is it the force that acts, in time?"
        raise InputError.of(f"give a mass of {number(mass)}: {why}; allowed: {allowed}", key="logs")
    low, high = _PLAUSIBLE[records[0].motion]
    if not low <= mass <= high:
        raise InputError.of(
            f"give a mass of {number(mass)}; allowed: {low:g} to {high:g}; are the units of position and force right?",
            key="logs",
        )
    limit = None if one_way else motion.limit_n(start.values["delay_samples"])
    if limit is not None:
        largest = max(float(np.abs(one.force_n).max()) for one in records)
        raise InputError.of(
            f"ask for a force of up to {number(largest, 3)}, and the device follows it up to about {number(limit, 2)}: "
            "what acts is then not what is logged; allowed: a log below that force, or the force as the amplifier "
            "gives it",
            key="logs",
        )
    return start


def _simplest(
    records: Sequence[Record], fixed: Mapping[str, float], rms_n: float, travel_m: float, start: Start, offsets: int
) -> Structure:
    """Return the lowest rung: a scale of the force where a mass is known, a spring where the start has one."""
    speeds = []
    for one in records:
        every = max(1, int(0.01 / one.sample_time_s))
        speeds.append(float(np.std(np.diff(one.position_m[::every]))) / (every * one.sample_time_s))
        speeds.append(abs(float(one.position_m[-1] - one.position_m[0])) / one.seconds)
    units = {
        "damping_ns_per_m": rms_n / max(speeds),
        OFFSET: rms_n,
        FRICTION: rms_n,
        "stiffness_n_per_m": rms_n / travel_m,
    }
    rungs = ["rigid"]
    rungs += ["spring"] if "stiffness_n_per_m" in start.values else []
    rungs += ["scale"] if "mass_kg" in fixed or len({one.added_mass_kg for one in records}) > 1 else []
    return Structure(tuple(rungs), fixed, units, offsets=max(offsets, 1))


def _estimates(found: Ladder, step_m: float | None, *, one_way: bool) -> dict[str, Estimate]:
    """Return the estimates by key; what the log does not tell is a range."""
    fit, logs = found.fit, found.predictor.names
    estimates: dict[str, Estimate] = {}
    of_log = {offset_of(at): f"prediction error, in {name}" for at, name in enumerate(logs)} if len(logs) > 1 else {}
    for one, q, half in zip(fit.structure.free, map(float, fit.search), map(float, found.half), strict=True):
        low, high = (min(max(fit.structure.outward(one, end), one.lowest), one.highest) for end in (q - half, q + half))
        estimates[one.name] = Estimate(
            one.name,
            one.quantity,
            fit.structure.outward(one, q),
            low,
            high,
            of_log.get(one.name, "prediction error"),
            half <= WIDEST.get(one.name, math.inf),
        )
    rival = found.rivals.get("friction")
    if FRICTION not in estimates and rival is not None:
        place = rival.structure.names.index(FRICTION)
        # Friction that the rest of the model explains as well is not told, and bounded with care.
        alike = bool(found.trials["friction"].why)
        most = rival.structure.units[FRICTION]
        most *= max(float(rival.search[place] + (1 + 2 * alike) * bootstrap(rival)[0][place]), 0.0)
        known = most < rival.structure.units[FRICTION] and not alike
        source = "not told from damping; the upper end bounds it" if alike else "no evidence; the upper end bounds it"
        estimates[FRICTION] = Estimate(FRICTION, "force", 0.0, 0.0, most, source, known)
    elif one_way:
        some = estimates[FRICTION]
        source = "one direction only: friction and a constant force are one number"
        estimates[FRICTION] = replace(some, low=0.0, source=source, identified=False)
    if found.shares is not None:
        share = fit.values[MASS_RATIO]
        source = "assumed; the other intervals hold for this range"
        estimates[MASS_RATIO] = Estimate(MASS_RATIO, "number", share, *found.shares, source, identified=False)
    for key, value in fit.structure.known.items():
        if not (key == OFFSET and one_way):
            estimates[key] = Estimate(key, PARAMETERS[key].quantity, value, value, value, "known beforehand")
    if step_m is not None:
        low, high = step_m * (1 - _STEP_SHARE), step_m * (1 + _STEP_SHARE)
        estimates["encoder_resolution_m"] = Estimate(
            "encoder_resolution_m", "length", step_m, low, high, "lattice of the readings"
        )
    rounding = (step_m or 0.0) ** 2 / 12
    mean = fit.rms_m**2 * fit.noise_share
    if not coloured(autocorrelation(fit.error_m)) and mean - rounding > max(
        _LEAST_NOISE * rounding, _NOISE_SHARE * mean
    ):
        shares = (1, 1 - _NOISE_SHARE, 1 + _NOISE_SHARE)
        value, low, high = (math.sqrt(max(share * mean - rounding, 0.0)) for share in shares)
        source = "prediction error less the encoder's rounding"
        estimates["position_noise_rms_m"] = Estimate("position_noise_rms_m", "length", value, low, high, source)
    return estimates


def _unknown(estimates: Mapping[str, Estimate], structure: Structure) -> dict[str, str]:
    """Return what the log does not tell, with the log that would."""
    absent = {"resonance": "resonance", "amplifier_bandwidth_hz": "lag"}
    present = {"lag" if rung == "loop" else rung for rung in structure.rungs}
    return {
        key: log
        for key, log in _LOGS.items()
        if (key in estimates and not estimates[key].identified)
        or (key in absent and absent[key] not in present)
        or (key in {FRICTION, "encoder_resolution_m", "max_force_n", "force_scale"} and key not in estimates)
    }


def _stretches(predictor: Predictor, found: Ladder) -> tuple[Stretch, ...]:
    """Return stretches of the longest records in which the model runs nearly free."""
    stretches = []
    for record in sorted(predictor.records, key=lambda one: -one.seconds)[:2]:
        free = Predictor([record], predictor)
        structure, search = found.fit.structure, found.fit.search
        error: FloatArray = free.predict(structure, search, Observer(_STRETCH_RATE_PER_S), slopes=False)[0].error_m
        size = min(record.position_m.size // 2, int(_STRETCH_S / record.sample_time_s))
        first = record.position_m.size - size - size // 4
        part = slice(first, first + size)
        time = np.asarray(np.arange(first, first + size) * record.sample_time_s, dtype=np.float64)
        position = record.position_m[part]
        stretches.append(Stretch(record.name, time, position, position - error[part]))
    return tuple(stretches)
