"""Result of an identification, its device file, and what a device file and logs say against each other.

Values of a rotary device stand unchanged under the linear names: kg.m2 in ``mass_kg``, N.m in forces.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.arrays import ComplexArray, FloatArray
from avc_casadi._util.json_values import plain
from avc_casadi._util.text import number
from avc_casadi._util.units import MotionKind, units_for
from avc_casadi.files.border import in_keys_of
from avc_casadi.files.device_file import DeviceFile
from avc_casadi.files.toml import toml_lines
from avc_casadi.identification.fit import FitTrial
from avc_casadi.identification.log import Record
from avc_casadi.identification.response import Response
from avc_casadi.identification.terms import FRICTION, LOOP_RATIO, MASS_RATIO, QuantityName
from avc_casadi.model.table import valid

_PARAMETERS = ("mass_kg", "damping_ns_per_m", FRICTION, "delay_samples")
"""Keys of a device file that a guess stands in for where a log does not tell them."""
_OTHER_KEYS = ("encoder_resolution_m", "position_noise_rms_m", "amplifier_bandwidth_hz", "backlash_m", "max_force_n")
"""Keys that are gaps where a log does not tell them."""
_MODE_KEYS = ("frequency_hz", "damping_ratio", "mass_ratio")
"""Keys of a resonance."""
_WIDEST_GUESS = 30
"""A range is worth more than a guess where its upper end is less than so many times the value."""
_RANGE_OF_GUESS = 3
"""A guess without a range has one from a third of it to three times of it."""
_MOST_SOURCE_CHARACTERS = 300
"""Characters of the names of logs in a source, at most."""
_FEWEST_DIGITS = 5
"""Significant digits of a value, at least; ..."""
_MORE_DIGITS = 3
"""... so many more than those that its interval leaves; ..."""
_MOST_DIGITS = 15
"""... and no more than these."""
_LEAST_DELAY_SAMPLES = 1e-3
"""A shorter delay is none."""
_LEAST_VALUE = 1e-9
"""A smaller value, in its SI unit, is 0."""
_OVER_LIMIT = 1.01
"""A command is above the device's limit from so many times of it on."""
_MOST_OVER_LIMIT_SHARE = 1e-3
"""Share of the samples up to which commands above the limit are accepted."""
_WHOLE_TICKS = 0.01
"""A log's step is a whole number of ticks where it differs from it by less than this share."""


@dataclass(frozen=True)
class Estimate:
    """An estimate with its 95 % interval, in SI units.

    `identified` is False where the log does not tell the number, and the interval is a range.
    """

    key: str
    quantity: QuantityName
    value: float
    low: float
    high: float
    source: str
    identified: bool = True


@dataclass(frozen=True, eq=False)
class Identification:
    """An identified device.

    `error_m` is the prediction error of all judged samples and `lags` its autocorrelation from lag 1 on; `stretch` is
    time, and position measured and of the model running nearly free, shape (3, samples). `unknown` are keys that the
    logs do not tell. `device` is None where mass or damping are known from nothing.
    """

    sources: tuple[str, ...]
    seconds: float
    records: int
    sample_time_s: float
    motion: MotionKind
    rungs: tuple[str, ...]
    encoder_at: str
    estimates: Mapping[str, Estimate]
    unknown: tuple[str, ...]
    trials: tuple[FitTrial, ...]
    error_m: FloatArray
    lags: FloatArray
    notes: tuple[str, ...]
    response: Response
    model_response: ComplexArray
    stretch: FloatArray
    device: DeviceFile | None = None

    @property
    def amplifier_order(self) -> int:
        """1, a lag; 2, a current loop."""
        return 2 if "loop" in self.rungs else 1

    def data(self) -> dict[str, Any]:
        """Return its JSON values."""
        key_of = units_for(self.motion).key
        device = None if self.device is None else self.device.device.model_dump(mode="json", exclude_unset=True)
        gaps = None if self.device is None else [key_of(gap) for gap in self.device.gaps]
        estimates = {}
        for key, estimate in self.estimates.items():
            estimates[key] = {name: value for name, value in vars(estimate).items() if name != "key"}
        document = {
            "logs": self.sources,
            "seconds": self.seconds,
            "records": self.records,
            "sample_time_s": self.sample_time_s,
            "rungs": self.rungs,
            "encoder_at": self.encoder_at,
            "amplifier_order": self.amplifier_order,
            "notes": self.notes,
            "estimates": estimates,
            "unknown": [key_of(key) for key in self.unknown],
            "evidence": [vars(trial) for trial in self.trials],
            "error_autocorrelation": self.lags,
            "device": device,
            "gaps": gaps,
            "response": {
                "frequency_hz": self.response.frequency_hz,
                "measured_re": self.response.velocity_per_force.real,
                "measured_im": self.response.velocity_per_force.imag,
                "model_re": self.model_response.real,
                "model_im": self.model_response.imag,
                "coherence": self.response.coherence,
            },
        }
        return dict(plain(document))


@dataclass
class _File:
    """The tables of a device file while it is filled."""

    device: dict[str, Any] = field(default_factory=dict)
    ranges: dict[str, Any] = field(default_factory=dict)
    sources: dict[str, Any] = field(default_factory=dict)

    def put(self, key: str, value: Any, ends: Any, grade: str, source: str) -> None:
        """Put a value, its range where it has one, and its source."""
        self.device[key] = value
        self.sources[key] = {"grade": grade, "source": source}
        if ends is not None:
            self.ranges[key] = ends

    def take(self, base: DeviceFile, key: str, source: str = "") -> None:
        """Put a value of the base into the file, with its range and source; a given `source` makes it assumed."""
        table = base.device.model_dump(exclude_none=True)
        base_source = base.sources.get(key)
        if source:
            grade, reason = "assumed", source
        elif base_source is None:
            grade, reason = "assumed", f"{base.name}, which gives no source"
        else:
            grade, reason = base_source.grade, base_source.source
        self.put(key, table[key], table.get("range", {}).get(key), grade, reason)


def device_file(
    result: Identification, base: DeviceFile | None, handle_radius_m: float | None = None
) -> DeviceFile | None:
    """Return the device file of an identification, filled from a base; None where mass or damping are unknown."""
    file = _File({"sample_time_s": result.sample_time_s})
    if result.motion == "rotary":
        radius = handle_radius_m or (None if base is None else base.device.handle_radius_m)
        file.device = {"motion": "rotary", "handle_radius_m": radius, **file.device}
    measurement = _measurement(result)
    file.sources["sample_time_s"] = {"grade": "measured", "source": f"{measurement}: time of the log"}
    identified = {key for key, estimate in result.estimates.items() if estimate.identified}
    gaps = [key for key in (*_PARAMETERS, *_OTHER_KEYS) if key not in identified]
    _put_estimates(file, result, measurement)
    if "resonance" in result.rungs:
        _put_resonance(file, result, measurement)
    else:
        gaps.append("resonance")
    if _lags(result):
        file.device["amplifier_order"] = result.amplifier_order
    _fill(file, base, gaps)
    if not {"mass_kg", "damping_ns_per_m"} <= file.device.keys():
        return None
    title = base.title if base is not None and base.title else "Device identified from its log"
    device = {**file.device, "range": file.ranges}
    tables = {"title": title, "device": device, "sources": file.sources, "gaps": gaps}
    with in_keys_of(units_for(result.motion)):
        return valid(DeviceFile, tables, result.sources[0], "device")


def _measurement(result: Identification) -> str:
    """Return how a value was measured, as its source: the command, and the logs without the names of their pieces."""
    logs = dict.fromkeys(name.partition("@")[0].partition("#")[0] for name in result.sources)
    return f"avc identify, {result.seconds:.3g} s of {', '.join(logs)[:_MOST_SOURCE_CHARACTERS]}"


def _put_estimates(file: _File, result: Identification, measurement: str) -> None:
    """Put the estimates that a log tells, and the ranges that are worth more than a guess."""
    for key in (*_PARAMETERS, "encoder_resolution_m", "amplifier_bandwidth_hz", LOOP_RATIO):
        estimate = result.estimates.get(key)
        if estimate is None or not (estimate.identified or _bounds_its_value(estimate)):
            continue
        value, ends = _significant(estimate)
        lag = "; includes the lag of the amplifier" if key == "delay_samples" and not _lags(result) else ""
        file.put(
            key,
            value,
            None if key == "encoder_resolution_m" else ends,
            "measured" if estimate.identified else "assumed",
            f"{measurement}: {estimate.source}{lag}",
        )


def _bounds_its_value(estimate: Estimate) -> bool:
    """Return whether the range of a number that is not identified bounds it."""
    return estimate.key in _PARAMETERS and estimate.value > 0 and estimate.high < _WIDEST_GUESS * estimate.value


def _put_resonance(file: _File, result: Identification, measurement: str) -> None:
    """Put the resonance and the side of the encoder."""
    mode: dict[str, float] = {}
    ranges: dict[str, tuple[float, float]] = {}
    for key in _MODE_KEYS:
        mode[key], ranges[key] = _significant(result.estimates[f"resonance.{key}"])
    doubt = "" if result.estimates[MASS_RATIO].identified else "; the mass ratio is assumed"
    file.put("resonance", mode, ranges, "measured", f"{measurement}: prediction error, two masses{doubt}")
    file.device["encoder_at"] = result.encoder_at


def _fill(file: _File, base: DeviceFile | None, gaps: list[str]) -> None:
    """Fill gaps from the base, or cautiously; what was searched for and not found stays a gap."""
    for key in [key for key in gaps if key not in file.device]:
        if key == "amplifier_bandwidth_hz" and "delay_samples" not in gaps:
            continue  # its lag is in the delay
        if base is not None and states(base, key):
            if key in _PARAMETERS:
                file.take(base, key, f"{base.name}; the logs do not determine this value")
                value = file.device[key]
                file.ranges.setdefault(key, (value / _RANGE_OF_GUESS, value * _RANGE_OF_GUESS))
            else:
                file.take(base, key)
                if key not in base.gaps:
                    gaps.remove(key)
        elif key == "delay_samples":
            source = "not identified; one sample is assumed for the link to the computer"
            file.put(key, 1.0, (0.0, 2.0), "assumed", source)


def _lags(result: Identification) -> bool:
    """Return whether an amplifier with a lag was identified."""
    return bool({"lag", "loop"} & set(result.rungs))


def states(base: DeviceFile, key: str) -> bool:
    """Return whether a device file gives a value, a guess without a source included."""
    return key in base.device.model_fields_set and getattr(base.device, key) is not None


def _significant(estimate: Estimate) -> tuple[float, tuple[float, float]]:
    """Return a value and its ends with the digits that the interval supports; next to nothing becomes 0."""
    half = (estimate.high - estimate.low) / 2
    size = max(abs(estimate.low), abs(estimate.high))
    digits = _FEWEST_DIGITS
    if 0 < half < size:
        supported = _MORE_DIGITS + math.ceil(math.log10(size / half))
        digits = min(max(_FEWEST_DIGITS, supported), _MOST_DIGITS)
    least = _LEAST_DELAY_SAMPLES if estimate.key == "delay_samples" else _LEAST_VALUE

    def rounded(exact: float) -> float:
        short = float(f"{exact:.{digits}g}")
        return 0.0 if abs(short) < least else short

    value = rounded(estimate.value)
    return value, (min(rounded(estimate.low), value), max(rounded(estimate.high), value))


def check_against(records: Sequence[Record], base: DeviceFile) -> None:
    """Refuse commands above the device's limit, and a log of every second or third tick of its loop."""
    device = base.device
    faults = []
    force = np.abs(np.concatenate([record.force_n for record in records]))
    limit = device.max_force_n if states(base, "max_force_n") else None
    if limit is not None and np.mean(force > _OVER_LIMIT * limit) > _MOST_OVER_LIMIT_SHARE:
        key = device.units.key("max_force_n")
        message = f"is above device.{key} of {base.name}, {number(limit)}; log the limited force, or check the units"
        faults.append(Fault(records[0].name, None, "force", message))
    ticks = records[0].sample_time_s / device.sample_time_s
    if states(base, "sample_time_s") and round(ticks) > 1 and abs(ticks / round(ticks) - 1) < _WHOLE_TICKS:
        message = f"has steps of {round(ticks)} times device.sample_time_s of {base.name}; log every sample of the loop"
        faults.append(Fault(records[0].name, None, "time", message))
    if faults:
        raise InputError(faults)


def device_text(file: DeviceFile) -> str:
    """Return a device file as TOML."""
    units = file.device.units
    tables = {
        "title": file.title,
        "gaps": tuple(map(units.key, file.gaps)),
        "device": units.keyed(file.device.model_dump(exclude_unset=True, exclude_none=True)),
        "sources": units.keyed({key: source.model_dump() for key, source in file.sources.items()}),
    }
    return "\n".join(toml_lines((), {key: value for key, value in tables.items() if value})) + "\n"
