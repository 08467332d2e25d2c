"""Identification of a device from logs: estimates, intervals, and what the logs do not tell."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.progress import SILENT, Progress
from avc_casadi._util.text import number
from avc_casadi._util.units import MotionKind
from avc_casadi.files.device_file import DeviceFile
from avc_casadi.identification.device import Estimate, Identification, check_against, device_file
from avc_casadi.identification.fit import Window, bootstrap
from avc_casadi.identification.ladder import WIDEST, Ladder, model_response
from avc_casadi.identification.log import Record, excerpts, lattice_step
from avc_casadi.identification.predictor import Observer, Predictor
from avc_casadi.identification.read import Layout, read_logs
from avc_casadi.identification.regression import Motion, Start, in_ticks, only_feedback, whiteness
from avc_casadi.identification.terms import FRICTION, MASS_RATIO, OFFSET, Structure, offset_of


def identify(
    logs: Sequence[str | Path] | str | Path | Sequence[Record],
    *,
    layout: Layout | None = None,
    base: DeviceFile | None = None,
    flip_force: bool = False,
    handle_radius_m: float | None = None,
    progress: Progress = SILENT,
) -> Identification:
    """Identify a device from logs of time, position and commanded force."""
    several = [logs] if isinstance(logs, str | Path) else list(logs)
    records, notes = [one for one in several if isinstance(one, Record)], list[str]()
    if not records:
        records, notes = read_logs([one for one in several if isinstance(one, str | Path)], layout)
    _check(records, base, handle_radius_m)
    if flip_force:
        records = [
            replace(one, force_n=-one.force_n, later_n=None if one.later_n is None else -one.later_n) for one in records
        ]
    records, by_clock = in_ticks(records)
    whole = sum(one.position_m.size for one in records)
    records = excerpts(records, 120_000)
    used = sum(one.position_m.size for one in records)
    notes += by_clock + ([f"of {whole} samples {used} were used, in pieces over the records"] if used < whole else [])
    readings = [one.position_m if one.readings_m is None else one.readings_m for one in records]
    step_m = lattice_step(np.concatenate(readings))
    _check_motion(records, step_m)
    ways = set()
    for one in records:
        moves = np.diff(one.position_m)
        forth, back = float(moves[moves > 0].sum()), -float(moves[moves < 0].sum())
        # Some steps back at rest are noise.
        ways.add(0 if min(forth, back) > 0.01 * max(forth, back) else 1 if forth > back else -1)
    # Friction and a constant force are one number in a log of one direction: of logs both ways it is the same.
    offsets = len({one.whole for one in records}) if 0 in ways else len(ways) - 1
    declared = None if base is None or base.device.resonance is None else base.device.encoder_at
    sides = ("motor", "handle") if declared is None else (declared,)
    with progress.step("first guess"):
        start = _check_start(Motion(records, offsets).start(), records[0].motion)
    predictor, structure = Predictor(records), _simplest(records, start, offsets)
    with progress.step("model"):
        ladder = Ladder.climb(predictor, structure, start, sides, progress)
    fit, response = ladder.fit, ladder.response
    estimates = _estimates(ladder, step_m, one_way=not offsets)
    lags, white = whiteness(fit.error_m, resampled=any(one.scatter for one in records))
    if not white:
        notes.append(
            "the prediction error is not white: something that the model does not know moves the device (a hand, play, "
            "a stop, a cable, friction of another kind), and intervals may not hold the truth"
        )
    if "spring" in fit.structure.rungs:
        notes.append("a spring holds the device; a device file has no key for it: log the device released if it can be")
    unknown = [key for key, one in estimates.items() if not one.identified]
    unknown += [] if "resonance" in fit.structure.rungs else ["resonance"]
    unknown += [] if {"lag", "loop"} & {*fit.structure.rungs} else ["amplifier_bandwidth_hz"]
    unknown += [key for key in (FRICTION, "encoder_resolution_m", "max_force_n") if key not in estimates]
    identified = Identification(
        sources=tuple(dict.fromkeys(one.name for one in records)),
        seconds=sum(one.seconds for one in records),
        records=len(records),
        sample_time_s=predictor.sample_time_s,
        motion=records[0].motion,
        rungs=fit.structure.rungs,
        encoder_at=fit.structure.encoder_at if "resonance" in fit.structure.rungs else "motor",
        estimates=estimates,
        unknown=tuple(unknown),
        trials=tuple(ladder.trials.values()),
        error_m=np.concatenate(fit.error_m),
        lags=lags,
        notes=tuple(notes),
        response=response,
        model_response=model_response(fit.values, fit.structure, predictor.sample_time_s, response.frequency_hz),
        stretch=_stretch(ladder),
    )
    return replace(identified, device=device_file(identified, base, handle_radius_m))


def _check(records: Sequence[Record], base: DeviceFile | None, handle_radius_m: float | None) -> None:
    motions = {one.motion for one in records}
    seconds = sum(one.seconds for one in records)
    faults = []
    if len(motions) > 1 or (base is not None and base.device.motion not in motions):
        message = "are of devices that turn and that do not; allowed: logs and a base of one motion"
        faults.append(Fault("", None, "logs", message))
    if seconds < 1:
        message = f"hold {number(seconds)} s in all; allowed: at least 1 s"
        faults.append(Fault("", None, "logs", message))
    if motions == {"linear"} and handle_radius_m is not None:
        faults.append(Fault("", None, "handle_radius_m", "says nothing of logs in metres; allowed: beside logs in rad"))
    if faults:
        raise InputError(faults)
    if base is not None:
        check_against(records, base)


def _check_motion(records: Sequence[Record], step_m: float | None) -> None:
    """Refuse logs that tell nothing."""
    travel = max(float(np.ptp(one.position_m)) for one in records)
    steps = travel / step_m if step_m else float(max(np.unique(one.position_m).size for one in records))
    skip = Window.of(Predictor(records)).skip
    if steps < 12:
        message = (
            f"move over {number(steps, 2)} steps of the encoder only; allowed: more force, or lower frequencies: a "
            "travel of 50 steps and more"
        )
    elif not any(np.ptp(one.position_m[skip:]) for one in records):
        message = (
            f"move in the first {number(skip * records[0].sample_time_s)} s only, which the model needs to begin; "
            "allowed: motion that goes on (a multisine, as avc excite plays one)"
        )
    elif only_feedback(records):
        message = (
            "have a force that is a spring and a damper on the measured position and nothing else, while the device "
            "goes on moving: what moves it is not logged; allowed: a force of its own beside the controller (a "
            "multisine, as avc excite plays one), hands off"
        )
    else:
        return
    raise InputError.of(message, key="logs")


def _check_start(start: Start, motion: MotionKind) -> Start:
    """Refuse a force of reversed sign, and implausible units."""
    mass = start.values["mass_kg"]
    follows = start.r_squared >= 0.3  # a rigid model that explains less of the force does not determine its sign
    if mass < 0 or (start.against and follows):
        why, allowed = "force and position point against each other", "force along +position, or --flip-force"
        if not follows:
            share = number(100 * max(start.r_squared, 0.0), 2)
            why = f"the motion hardly follows the force ({share} % of it explained)"
            allowed = "a multisine with several times the force, free of contact; is it the force that acts, in time?"
        raise InputError.of(f"give a mass of {number(mass)}: {why}; allowed: {allowed}", key="logs")
    low, high = (1e-3, 2e3) if motion == "linear" else (1e-8, 1e4)
    if not low <= mass <= high:
        raise InputError.of(
            f"give a mass of {number(mass)}; allowed: {low:g} to {high:g}; are the units of position and force right?",
            key="logs",
        )
    return start


def _simplest(records: Sequence[Record], start: Start, offsets: int) -> Structure:
    """Return the lowest rung, with a spring where the start has one."""
    rms_n = float(np.sqrt(np.mean(np.concatenate([one.force_n for one in records]) ** 2)))
    travel_m = max(float(np.ptp(one.position_m)) for one in records)
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
    rungs = ("rigid", "spring") if "stiffness_n_per_m" in start.values else ("rigid",)
    return Structure(rungs, units, fixed={} if offsets else {OFFSET: 0.0}, offsets=max(offsets, 1))


def _estimates(ladder: Ladder, step_m: float | None, *, one_way: bool) -> dict[str, Estimate]:
    """Return the estimates by key; what the log does not tell is a range."""
    fit, logs = ladder.fit, ladder.predictor.names
    estimates: dict[str, Estimate] = {}
    of_log = {offset_of(at): f"prediction error, in {name}" for at, name in enumerate(logs)} if len(logs) > 1 else {}
    for one, q, half in zip(fit.structure.free, map(float, fit.search), map(float, ladder.half), strict=True):
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
    rival = ladder.rivals.get("friction")
    if FRICTION not in estimates and rival is not None:
        place = rival.structure.names.index(FRICTION)
        # Friction that the rest of the model explains as well is not told, and bounded with care.
        alike = bool(ladder.trials["friction"].why)
        most = rival.structure.units[FRICTION]
        most *= (1 + 0.5 * alike) * max(float(rival.search[place] + bootstrap(rival)[place]), 0.0)
        known = most < rival.structure.units[FRICTION] and not alike
        source = f"{'not distinct from damping' if alike else 'no evidence'}; the upper end bounds it"
        estimates[FRICTION] = Estimate(FRICTION, "force", 0.0, 0.0, most, source, known)
    elif one_way:
        some = estimates[FRICTION]
        source = "one direction only: friction and a constant force are one number"
        estimates[FRICTION] = replace(some, low=0.0, source=source, identified=False)
    if ladder.shares is not None:
        share = fit.values[MASS_RATIO]
        source = "assumed; the other intervals hold for this range"
        estimates[MASS_RATIO] = Estimate(MASS_RATIO, "number", share, *ladder.shares, source, identified=False)
    if step_m is not None:
        low, high = 0.999 * step_m, 1.001 * step_m
        estimates["encoder_resolution_m"] = Estimate(
            "encoder_resolution_m", "length", step_m, low, high, "lattice of the readings"
        )
    return estimates


def _stretch(ladder: Ladder) -> FloatArray:
    """Return a stretch of the longest record in which the model runs nearly free."""
    record = max(ladder.predictor.records, key=lambda one: one.seconds)
    free, slow = Predictor([record], ladder.predictor), Observer(4.0)
    error: FloatArray = free.predict(ladder.fit.structure, ladder.fit.search, slow, slopes=False)[0].error_m
    size = min(record.position_m.size // 2, int(1.5 / record.sample_time_s))
    first = record.position_m.size - size - size // 4
    part = slice(first, first + size)
    time = np.arange(first, first + size) * record.sample_time_s
    return np.stack([time, record.position_m[part], record.position_m[part] - error[part]])
