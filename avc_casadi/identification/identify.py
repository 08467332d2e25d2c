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
from avc_casadi._util.units import MotionKind
from avc_casadi.files.device_file import DeviceFile
from avc_casadi.identification.device import Estimate, Identification, check_against, device_file
from avc_casadi.identification.fit import Partition, bootstrap
from avc_casadi.identification.ladder import WIDEST, Ladder
from avc_casadi.identification.log import (
    Record,
    allowed_sign,
    excerpts,
    lattice_step,
    require_radius,
    require_radius_of,
)
from avc_casadi.identification.predictor import Predictor, SteadyObserver
from avc_casadi.identification.read import Layout, read_logs
from avc_casadi.identification.regression import Motion, Start, in_ticks, only_feedback, whiteness
from avc_casadi.identification.response import model_response
from avc_casadi.identification.terms import FRICTION, MASS_RATIO, OFFSET, ModelStructure, offset_of

_MOST_SAMPLES = 120_000
"""Samples that are used of all logs, at most."""
_SHORTEST_LOGS_S = 1
"""Seconds of all logs, at least."""
_FEWEST_STEPS = 12
"""Steps of the encoder that a log must move over."""
_REST_SHARE = 0.01
"""Moves back that sum to no more than this share of those forth are noise at rest."""
_RIGID_R_SQUARED = 0.3
"""A rigid model that explains less of the force does not determine its sign."""
_LIKELY_MASSES: Mapping[MotionKind, tuple[float, float]] = {"linear": (1e-3, 2e3), "rotary": (1e-8, 1e4)}
"""Least and largest mass, kg, or inertia, kg.m2; beyond them a unit is mistaken."""
_SPEED_STEP_S = 0.01
"""Time over which moves are taken for the speed of a log."""
_ALIKE_FACTOR = 1.5
"""Factor of the upper end of a friction that the rest of the model explains as well."""
_STEP_INTERVAL = (0.999, 1.001)
"""Ends of the interval of the encoder's step, as shares of it."""
_NEARLY_FREE_RATE_PER_S = 4.0
"""Observer rate of the stretch that is drawn."""
_STRETCH_S = 1.5
"""Length of the stretch that is drawn, at most."""


def identify(
    logs: Sequence[str | Path] | str | Path | Sequence[Record],
    *,
    layout: Layout | None = None,
    base: DeviceFile | None = None,
    flip_force: bool = False,
    handle_radius_m: float | None = None,
    progress: Progress = SILENT,
) -> Identification:
    """Identify a device from logs of time, position and commanded force.

    Args:
        logs: files, or records.
        layout: columns and units of files.
        base: what is known of the device, for what the logs do not tell and to check them against.
        flip_force: the logged force counts along -position.
        handle_radius_m: radius of the handle of a device that turns.
        progress: receiver of the steps.

    Raises:
        InputError: the logs are not usable, or tell no device.
    """
    require_radius(handle_radius_m)
    records, notes = _records_of(logs, layout)
    _check(records, base, handle_radius_m)
    if flip_force:
        records = [_flipped(record) for record in records]
    records, notes_of_clock = in_ticks(records)
    notes += notes_of_clock
    samples = sum(record.position_m.size for record in records)
    records = excerpts(records, _MOST_SAMPLES)
    used = sum(record.position_m.size for record in records)
    if used < samples:
        notes.append(f"of {samples} samples {used} were used, in pieces over the records")
    readings = [record.position_m if record.readings_m is None else record.readings_m for record in records]
    step_m = lattice_step(np.concatenate(readings))
    _check_motion(records, step_m)
    offsets = _offsets(records)
    declared = None if base is None or base.device.resonance is None else base.device.encoder_at
    sides = ("motor", "handle") if declared is None else (declared,)
    with progress.step("first guess"):
        start = _check_start(Motion(records, offsets).start(), records[0].motion, flip_force=flip_force)
    predictor, structure = Predictor(records), _simplest(records, start, offsets)
    with progress.step("model"):
        ladder = Ladder.climb(predictor, structure, start, sides, progress)
    identified = _identification(ladder, notes, step_m, one_way=not offsets)
    return replace(identified, device=device_file(identified, base, handle_radius_m))


def _identification(ladder: Ladder, notes: list[str], step_m: float | None, *, one_way: bool) -> Identification:
    """Return what a ladder found, without the device file."""
    fit, response = ladder.fit, ladder.response
    predictor = ladder.predictor
    records = predictor.records
    estimates = _estimates(ladder, step_m, one_way=one_way)
    lags, white = whiteness(fit.error_m, resampled=any(record.scatter for record in records))
    if not white:
        notes.append(
            "the prediction error is not white: something outside the model moves the device (a hand, play, "
            "a stop, a cable, friction of another kind), and intervals may miss the true value"
        )
    rungs = fit.structure.rungs
    if "spring" in rungs:
        notes.append(
            "a spring acts on the device, and device files have no key for it; log the device without it if possible"
        )
    return Identification(
        sources=tuple(dict.fromkeys(record.name for record in records)),
        seconds=sum(record.seconds for record in records),
        records=len(records),
        sample_time_s=predictor.sample_time_s,
        motion=records[0].motion,
        rungs=rungs,
        encoder_at=fit.structure.encoder_at if "resonance" in rungs else "motor",
        estimates=estimates,
        unknown=_unknown(estimates, rungs),
        trials=tuple(ladder.trials.values()),
        error_m=np.concatenate(fit.error_m),
        lags=lags,
        notes=tuple(notes),
        response=response,
        model_response=model_response(fit.values, fit.structure, predictor.sample_time_s, response.frequency_hz),
        stretch=_stretch(ladder),
    )


def _records_of(
    logs: Sequence[str | Path] | str | Path | Sequence[Record], layout: Layout | None
) -> tuple[list[Record], list[str]]:
    """Return records as they are given, or those of files, and notes for the user."""
    items = [logs] if isinstance(logs, str | Path) else list(logs)
    records = [item for item in items if isinstance(item, Record)]
    if records:
        return records, []
    return read_logs([item for item in items if isinstance(item, str | Path)], layout)


def _flipped(record: Record) -> Record:
    later_n = None if record.later_n is None else -record.later_n
    return replace(record, force_n=-record.force_n, later_n=later_n)


def _offsets(records: Sequence[Record]) -> int:
    """Return the number of constant forces that records tell: of logs both ways one each, of one direction none.

    Friction and a constant force are one number in a log of one direction; of logs in both directions the constant
    force is the same.
    """
    directions = {_direction(record) for record in records}
    return len({record.whole for record in records}) if 0 in directions else len(directions) - 1


def _direction(record: Record) -> int:
    """Return the direction in which a device moves: 1 forth, -1 back, 0 both."""
    moves = np.diff(record.position_m)
    forth, back = float(moves[moves > 0].sum()), -float(moves[moves < 0].sum())
    # Some steps back at rest are noise.
    if min(forth, back) > _REST_SHARE * max(forth, back):
        return 0
    return 1 if forth > back else -1


def _unknown(estimates: Mapping[str, Estimate], rungs: Sequence[str]) -> tuple[str, ...]:
    """Return the keys that the logs do not tell."""
    unknown = [key for key, estimate in estimates.items() if not estimate.identified]
    if "resonance" not in rungs:
        unknown.append("resonance")
    if not {"lag", "loop"} & {*rungs}:
        unknown.append("amplifier_bandwidth_hz")
    unknown += [key for key in (FRICTION, "encoder_resolution_m", "max_force_n") if key not in estimates]
    return tuple(unknown)


def _check(records: Sequence[Record], base: DeviceFile | None, handle_radius_m: float | None) -> None:
    """Refuse logs that do not belong together, or that the base contradicts."""
    motions = {record.motion for record in records}
    seconds = sum(record.seconds for record in records)
    faults = []
    if len(motions) > 1 or (base is not None and base.device.motion not in motions):
        message = "mix linear and rotary devices; give logs and a --device of the same motion"
        faults.append(Fault("", None, "logs", message))
    if seconds < _SHORTEST_LOGS_S:
        message = f"have {number(seconds)} s in all; allowed: at least {_SHORTEST_LOGS_S} s"
        faults.append(Fault("", None, "logs", message))
    if faults:
        raise InputError(faults)
    require_radius_of(records[0].motion, handle_radius_m, None if base is None else base.device)
    if base is not None:
        check_against(records, base)


def _check_motion(records: Sequence[Record], step_m: float | None) -> None:
    """Refuse logs that tell nothing."""
    if step_m:
        steps = max(float(np.ptp(record.position_m)) for record in records) / step_m
    else:
        steps = float(max(np.unique(record.position_m).size for record in records))
    skip = Partition.of(Predictor(records)).skip
    if steps < _FEWEST_STEPS:
        message = (
            f"move over {number(steps, 2)} steps of the encoder only; use more force or lower frequencies, for a "
            "travel of 50 steps or more"
        )
    elif not any(np.ptp(record.position_m[skip:]) for record in records):
        message = (
            f"move in the first {number(skip * records[0].sample_time_s)} s only, and the fit needs this time to "
            "begin; log a longer motion (such as the multisine of avc excite)"
        )
    elif only_feedback(records):
        message = (
            "have a force of a spring and a damper on the measured position only, but the device keeps moving: "
            "something that is not logged moves it; add a force of another kind (such as the multisine of avc excite), "
            "and log it without a hand"
        )
    else:
        return
    raise InputError.of(message, key="logs")


def _check_start(start: Start, motion: MotionKind, *, flip_force: bool) -> Start:
    """Return the start of a fit, m x'' + b x' = F, unless F seems to have the wrong sign, or m not to be in kg."""
    mass = start.values["mass_kg"]
    follows = start.r_squared >= _RIGID_R_SQUARED
    if mass < 0 or (start.against and follows):
        reason, allowed = "force and position point against each other", allowed_sign(flip_force=flip_force)
        if not follows:
            share = number(100 * max(start.r_squared, 0.0), 2)
            reason = f"the motion hardly follows the force ({share} % of it explained)"
            allowed = (
                "a multisine with several times the force, out of contact; is it the true force, at the right time?"
            )
        raise InputError.of(f"give a mass of {number(mass)}: {reason}; allowed: {allowed}", key="logs")
    lowest, highest = _LIKELY_MASSES[motion]
    if not lowest <= mass <= highest:
        allowed = f"{lowest:g} to {highest:g}"
        raise InputError.of(
            f"give a mass of {number(mass)}; allowed: {allowed}; are the units of position and force right?",
            key="logs",
        )
    return start


def _simplest(records: Sequence[Record], start: Start, offsets: int) -> ModelStructure:
    """Return the lowest rung, a rigid mass with damping, with a spring where the start has one, and units of search.

    Units are the sizes that the log suggests: rms force over the largest speed or travel.
    """
    rms_n = float(np.sqrt(np.mean(np.concatenate([record.force_n for record in records]) ** 2)))
    travel_m = max(float(np.ptp(record.position_m)) for record in records)
    speeds = []
    for record in records:
        samples = max(1, int(_SPEED_STEP_S / record.sample_time_s))
        moves = np.diff(record.position_m[::samples])
        speeds.append(float(np.std(moves)) / (samples * record.sample_time_s))
        speeds.append(abs(float(record.position_m[-1] - record.position_m[0])) / record.seconds)
    units = {
        "damping_ns_per_m": rms_n / max(speeds),
        OFFSET: rms_n,
        FRICTION: rms_n,
        "stiffness_n_per_m": rms_n / travel_m,
    }
    rungs = ("rigid", "spring") if "stiffness_n_per_m" in start.values else ("rigid",)
    return ModelStructure(rungs, units, fixed={} if offsets else {OFFSET: 0.0}, offsets=max(offsets, 1))


def _estimates(ladder: Ladder, step_m: float | None, *, one_way: bool) -> dict[str, Estimate]:
    """Return the estimates by key; what the log does not tell is a range."""
    estimates = _fitted_estimates(ladder)
    if FRICTION not in estimates and "friction" in ladder.rivals:
        estimates[FRICTION] = _bounded_friction(ladder)
    elif one_way:
        source = "one direction only: friction and a constant force are one number"
        estimates[FRICTION] = replace(estimates[FRICTION], low=0.0, source=source, identified=False)
    if ladder.shares is not None:
        low, high = ladder.shares
        source = "assumed; the other intervals apply to this range"
        share = ladder.fit.values[MASS_RATIO]
        estimates[MASS_RATIO] = Estimate(MASS_RATIO, "number", share, low, high, source, identified=False)
    if step_m is not None:
        low, high = (share * step_m for share in _STEP_INTERVAL)
        estimates["encoder_resolution_m"] = Estimate(
            "encoder_resolution_m", "length", step_m, low, high, "lattice of the readings"
        )
    return estimates


def _fitted_estimates(ladder: Ladder) -> dict[str, Estimate]:
    """Return the estimates of the free parameters of the model."""
    structure, logs = ladder.fit.structure, ladder.predictor.names
    of_log: dict[str, str] = {}
    if len(logs) > 1:
        of_log = {offset_of(log): f"prediction error, in {name}" for log, name in enumerate(logs)}
    estimates = {}
    coordinates = zip(structure.free, map(float, ladder.fit.search), map(float, ladder.half), strict=True)
    for parameter, q, half in coordinates:
        low, high = (
            min(max(structure.outward(parameter, end), parameter.lowest), parameter.highest)
            for end in (q - half, q + half)
        )
        estimates[parameter.name] = Estimate(
            key=parameter.name,
            quantity=parameter.quantity,
            value=structure.outward(parameter, q),
            low=low,
            high=high,
            source=of_log.get(parameter.name, "prediction error"),
            identified=half <= WIDEST.get(parameter.name, math.inf),
        )
    return estimates


def _bounded_friction(ladder: Ladder) -> Estimate:
    """Return the friction of a model without it: none, up to that of the rival with it."""
    rival = ladder.rivals["friction"]
    place = rival.structure.names.index(FRICTION)
    # Friction that the rest of the model explains as well is not told, and bounded with care.
    alike = bool(ladder.trials["friction"].why)
    unit_n = rival.structure.units[FRICTION]
    factor = _ALIKE_FACTOR if alike else 1.0
    upper_end = max(float(rival.search[place] + bootstrap(rival)[place]), 0.0)
    most_n = unit_n * (factor * upper_end)
    doubt = "not distinct from damping" if alike else "no evidence"
    return Estimate(
        key=FRICTION,
        quantity="force",
        value=0.0,
        low=0.0,
        high=most_n,
        source=f"{doubt}; the upper end bounds it",
        identified=most_n < unit_n and not alike,
    )


def _stretch(ladder: Ladder) -> FloatArray:
    """Return a stretch of the longest record in which the model runs nearly free, shape (3, samples)."""
    record = max(ladder.predictor.records, key=lambda record: record.seconds)
    free, slow = Predictor([record], ladder.predictor), SteadyObserver(_NEARLY_FREE_RATE_PER_S)
    (prediction,) = free.predict(ladder.fit.structure, ladder.fit.search, slow, slopes=False)
    size = min(record.position_m.size // 2, int(_STRETCH_S / record.sample_time_s))
    # Near the end, where the initial state has decayed.
    first = record.position_m.size - size - size // 4
    part = slice(first, first + size)
    time_s = np.arange(first, first + size) * record.sample_time_s
    measured_m = record.position_m[part]
    return np.stack([time_s, measured_m, measured_m - prediction.error_m[part]])
