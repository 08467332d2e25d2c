"""Consistency of logs with each other and with the device file, and of the logged with the acting force."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.text import number
from avc_casadi._util.units import FORCE, FORCES, MASS, NEWTON, spoken_key
from avc_casadi.files.device_file import DeviceFile
from avc_casadi.identification.device import states
from avc_casadi.identification.fit import Fit, Window, judged
from avc_casadi.identification.model import Doubt, Identification
from avc_casadi.identification.predictor import Predictor
from avc_casadi.identification.record import Record
from avc_casadi.identification.terms import LOOP_RATIO
from avc_casadi.identification.uncertainty import compared, moves_of
from avc_casadi.model.quantity import power_at_handle

# Logs disagree where their estimates differ by so many standard errors, and by this share of the value.
_SURE, _SHARE = 6.0, 0.05
_FEWEST_BLOCKS = 5
_COMPARED = ("mass_kg", "damping_ns_per_m", "coulomb_friction_n")


def unlike_logs(fit: Fit, predictor: Predictor, radius_m: float) -> list[Doubt]:
    """Return the doubt of logs that disagree; none where they agree.

    Args:
        fit: of all logs.
        predictor: of their records.
        radius_m: travel of the handle per unit of position.
    """
    names = tuple(dict.fromkeys(record.whole for record in predictor.records))
    unlike = _differences(fit, predictor, names, {key: radius_m ** -power_at_handle(key) for key in _COMPARED})
    if not unlike:
        return []
    between = f"the logs do not agree ({'; '.join(unlike.values())}): the values are between those of two devices"
    why = f"Something may have been on it (--added-mass), or the {FORCE} been scaled otherwise"
    return [Doubt("the logs do not agree", f"{between}. {why}; identify each alone", frozenset(unlike))]


def _differences(fit: Fit, predictor: Predictor, names: Sequence[str], unit_of: dict[str, float]) -> dict[str, str]:
    """Describe the parameters whose estimates from two logs differ, by key.

    The estimate of one log is a Gauss-Newton step from the common estimate, with the curvature of that log alone.
    """
    asked = [_asked(fit, {at for at, log in enumerate(predictor.logs) if log == place}) for place in range(len(names))]
    told = {}
    for index, one in enumerate(fit.structure.free):
        if one.name not in _COMPARED:
            continue
        ends = [
            (step[index], error[index], name) for (step, error), name in zip(asked, names, strict=True) if step.size
        ]
        if len(ends) < 2:
            continue
        (low, below, first), (high, above, last) = min(ends), max(ends)
        values = [fit.structure.outward(one, float(fit.search[index] + step)) for step in (low, high)]
        apart = values[1] - values[0]
        if high - low > _SURE * np.hypot(below, above) and apart > _SHARE * abs(
            fit.structure.outward(one, fit.search[index])
        ):
            some = [number(value * unit_of.get(one.name, 1.0), 3) for value in values]
            told[one.name] = f"{one.name} {some[0]} by {first} alone and {some[1]} by {last}"
    return told


def _asked(fit: Fit, records: set[int]) -> tuple[FloatArray, FloatArray]:
    """Return the Gauss-Newton step of some records and its standard error, each of shape (free,); empty of too few."""
    blocks = tuple(block for block in fit.blocks if block.record in records)
    if len(blocks) < _FEWEST_BLOCKS:
        return np.zeros(0), np.zeros(0)
    moves = moves_of(replace(fit, blocks=blocks))
    return moves.sum(axis=0), np.sqrt(len(blocks)) * moves.std(axis=0, ddof=1)


# A command so much above the limit is no rounding, and so large a share of them no outlier.
_ABOVE, _SHARE_AGAINST_BASE = 1.01, 1e-3
# Sample times within this share are equal.
_SAME = 0.02
# A value without a range is taken as known within this factor.
_FAR = 2.0
_COMPARED_AGAINST_BASE = ("mass_kg", "damping_ns_per_m", "coulomb_friction_n", "encoder_resolution_m", LOOP_RATIO)


def check_against(records: Sequence[Record], base: DeviceFile) -> None:
    """Refuse forces beyond the device's limit, and logs that are decimated.

    Args:
        records: in the units of the device.
        base: prior knowledge of the device.

    Raises:
        InputError: both faults.
    """
    faults = []
    device = base.device
    if states(base, "max_force_n") and device.max_force_n is not None:
        force = np.abs(np.concatenate([record.force_n for record in records]))
        share = float(np.mean(force > _ABOVE * device.max_force_n))
        if share > _SHARE_AGAINST_BASE:
            limit, largest = number(device.max_force_n), number(float(force.max()), 3)
            message = (
                f"asks for up to {largest} {NEWTON}, in {100 * share:.2g} % of its samples for more than "
                f"{spoken_key('device.max_force_n')}, {limit} {NEWTON}: what acts is then not what is logged; allowed: "
                f"less, or in {base.name} the {FORCE} that the device gives for so long"
            )
            faults.append(Fault(records[0].name, None, "force", message))
    period = records[0].sample_time_s
    ticks = period / device.sample_time_s
    if states(base, "sample_time_s") and round(ticks) > 1 and abs(ticks / round(ticks) - 1) < _SAME:
        message = (
            f"steps by {number(1e3 * period)} ms, {round(ticks)} times device.sample_time_s: the {FORCES} between are "
            f"not in the log; allowed: every tick of the loop, or in {base.name} the sample time that it ran at"
        )
        faults.append(Fault(records[0].name, None, "time", message))
    if faults:
        raise InputError(faults)


def differs_from(found: Identification, base: DeviceFile) -> list[str]:
    """Return notes where logs contradict the device file: they may be of another device.

    Args:
        found: the identification, in the units of the device.
        base: prior knowledge of the device.
    """
    told = []
    period = base.device.sample_time_s
    if states(base, "sample_time_s") and abs(found.sample_time_s / period - 1) > _SAME:
        told.append(f"sample_time_s {number(period)}, the logs {number(found.sample_time_s)}")
    for key in _COMPARED_AGAINST_BASE:
        one, said = found.estimates.get(key), getattr(base.device, key)
        if one is None or not states(base, key) or not said or one.value <= 0:
            continue
        low, high = getattr(base.device.range, key, None) or (said / _FAR, said * _FAR)
        if one.high < low or one.low > high:
            known = number(said, 3) if low == high else f"{number(low, 3)} to {number(high, 3)}"
            told.append(f"{spoken_key(key)} {known}, the logs {number(one.value, 3)}")
    order = base.device.amplifier_order
    if "amplifier" in found.terms and states(base, "amplifier_order") and order != found.amplifier_order:
        told.append(f"amplifier_order {order}, the logs {found.amplifier_order}")
    if not told:
        return []
    return [f"{base.name} says {'; '.join(told)}: is it the device of these logs?"]


def leans_on(found: Identification, base: DeviceFile) -> list[str]:
    """Return a note that a delay is known only as well as the lag given in the device file.

    Args:
        found: the identification, in the units of the device.
        base: prior knowledge of the device.
    """
    key = "amplifier_bandwidth_hz"
    if key in found.estimates or "delay_samples" not in found.estimates or not states(base, key):
        return []
    bandwidth = base.device.amplifier_bandwidth_hz
    if bandwidth is None or base.device.range.amplifier_bandwidth_hz is not None:
        return []
    lag = f"the lag of {key} {number(bandwidth, 4)}, which {base.name} gives without a range"
    told = f"the delay in the device file is what the logs tell less {lag}: it is as wrong as that"
    return [f"{told}; say how well it is known in [device.range]"]


# Shares of the samples in which the force may be saturated.
_SHARES = (0.002, 0.005, 0.01, 0.02, 0.04, 0.08)
# The best of several limits is accepted where it betters the prediction by so many standard errors, and by this share.
# Few samples are saturated, so that neither is large; clipping a force that acts raises the squared error by far more.
_SURE_CUT, _WORTH = 2.0, 0.02


def saturation_doubts(predictor: Predictor, fit: Fit, window: Window, radius_m: float) -> list[Doubt]:
    """Return the doubt of a level at which the force seems to saturate; none where it acts as logged.

    Args:
        predictor: of the records.
        fit: of their forces as logged.
        window: of the fit.
        radius_m: travel of the handle per unit of position.
    """
    size = np.abs(np.concatenate([record.force_n for record in predictor.records]))
    best: Fit | None = None
    limit_n = 0.0
    for share in _SHARES:
        limit = float(np.quantile(size, 1 - share))
        cut = judged(predictor.of(_cut(predictor.records, limit)), fit.structure, fit.search, fit.observer, window)
        if best is None or cut.rms_m < best.rms_m:
            best, limit_n = cut, limit
    trial = None if best is None else compared(fit, best, "cut")
    if trial is None or trial.standard_errors < _SURE_CUT or -trial.held_out_change < _WORTH:
        return []
    beyond = number(100 * float(np.mean(size > limit_n)), 1)
    most = number(limit_n * radius_m, 2)
    note = (
        f"the device seems to follow the {FORCE} up to about {most} {NEWTON} only, and the log asks for more in "
        f"{beyond} % of its samples: {MASS} and damping lean by more than their intervals. Better: a log below that "
        f"{FORCE} ({spoken_key('max_force_n')}), or the {FORCE} as the amplifier gives it"
    )
    return [Doubt(f"the device does not follow the whole {FORCE}", note)]


def _cut(records: Sequence[Record], limit_n: float) -> list[Record]:
    return [replace(record, force_n=np.clip(record.force_n, -limit_n, limit_n)) for record in records]
