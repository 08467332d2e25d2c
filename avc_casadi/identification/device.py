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
from avc_casadi.files.device_file import DeviceFile
from avc_casadi.files.toml import toml_lines
from avc_casadi.identification.fit import Trial
from avc_casadi.identification.ladder import Response
from avc_casadi.identification.log import Record
from avc_casadi.identification.terms import FRICTION, LOOP_RATIO, QuantityName

_PARAMETERS = ("mass_kg", "damping_ns_per_m", FRICTION, "delay_samples")


@dataclass(frozen=True)
class Estimate:
    """An estimate with its 95 % interval."""

    key: str
    quantity: QuantityName
    value: float
    low: float
    high: float
    source: str
    identified: bool = True


@dataclass(frozen=True, eq=False)
class Identification:
    """An identified device; `stretch` is time, and position measured and of the model running nearly free, (3, n)."""

    sources: tuple[str, ...]
    seconds: float
    records: int
    sample_time_s: float
    motion: MotionKind
    rungs: tuple[str, ...]
    encoder_at: str
    estimates: Mapping[str, Estimate]
    unknown: tuple[str, ...]
    trials: tuple[Trial, ...]
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
        key_of, response = units_for(self.motion).key, self.response
        plainly = ("seconds", "records", "sample_time_s", "rungs", "encoder_at", "amplifier_order", "notes")
        device = None if self.device is None else self.device.device.model_dump(mode="json", exclude_unset=True)
        document = {
            "logs": self.sources,
            **{key: getattr(self, key) for key in plainly},
            "estimates": {
                key: {name: value for name, value in vars(one).items() if name != "key"}
                for key, one in self.estimates.items()
            },
            "unknown": [*map(key_of, self.unknown)],
            "evidence": [vars(one) for one in self.trials],
            "error_autocorrelation": self.lags,
            "device": device,
            "gaps": None if self.device is None else [*map(key_of, self.device.gaps)],
            "response": {
                "frequency_hz": response.frequency_hz,
                "measured_re": response.velocity_per_force.real,
                "measured_im": response.velocity_per_force.imag,
                "model_re": self.model_response.real,
                "model_im": self.model_response.imag,
                "coherence": response.coherence,
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
        self.device[key], self.sources[key] = value, {"grade": grade, "source": source}
        if ends is not None:
            self.ranges[key] = ends

    def take(self, base: DeviceFile, key: str, source: str = "") -> None:
        """Take a value of the base, with its range and its source."""
        table = base.device.model_dump(exclude_none=True)
        theirs = base.sources.get(key)
        grade = "assumed" if source or theirs is None else theirs.grade
        reason = source or (f"{base.name}, which gives no source" if theirs is None else theirs.source)
        self.put(key, table[key], table.get("range", {}).get(key), grade, reason)


def device_file(
    result: Identification, base: DeviceFile | None, handle_radius_m: float | None = None
) -> DeviceFile | None:
    """Return the device file, or None where mass, damping or the radius of the handle are known from nothing."""
    file = _File({"sample_time_s": result.sample_time_s})
    if result.motion == "rotary":
        radius = handle_radius_m or (None if base is None else base.device.handle_radius_m)
        if radius is None:
            return None
        file.device = {"motion": "rotary", "handle_radius_m": radius, **file.device}
    logs = ", ".join(dict.fromkeys(name.partition("@")[0].partition("#")[0] for name in result.sources))[:300]
    how = f"avc identify, {result.seconds:.3g} s of {logs}"
    file.sources["sample_time_s"] = {"grade": "measured", "source": f"{how}: time of the log"}
    others = ("encoder_resolution_m", "position_noise_rms_m", "amplifier_bandwidth_hz", "backlash_m", "max_force_n")
    identified = {key for key, one in result.estimates.items() if one.identified}
    gaps = [key for key in (*_PARAMETERS, *others) if key not in identified]
    for key in (*_PARAMETERS, "encoder_resolution_m", "amplifier_bandwidth_hz", LOOP_RATIO):
        one = result.estimates.get(key)
        # A range is worth more than a guess where it bounds the number.
        if one is not None and (one.identified or (key in _PARAMETERS and one.value > 0 and one.high < 30 * one.value)):
            value, ends = _significant(one)
            lag = "; the lag of the amplifier is in it" if key == "delay_samples" and not _lags(result) else ""
            grade = "measured" if one.identified else "assumed"
            file.put(key, value, None if key == "encoder_resolution_m" else ends, grade, f"{how}: {one.source}{lag}")
    if "resonance" in result.rungs:
        mode = {
            key: _significant(result.estimates[f"resonance.{key}"])
            for key in ("frequency_hz", "damping_ratio", "mass_ratio")
        }
        doubt = "" if result.estimates["resonance.mass_ratio"].identified else "; how the mass divides is assumed"
        file.put(
            "resonance",
            {key: value for key, (value, _) in mode.items()},
            {key: ends for key, (_, ends) in mode.items()},
            "measured",
            f"{how}: prediction error, two masses{doubt}",
        )
        file.device["encoder_at"] = result.encoder_at
    else:
        gaps.append("resonance")
    if _lags(result):
        file.device["amplifier_order"] = result.amplifier_order
    _fill(file, base, gaps)
    if not {"mass_kg", "damping_ns_per_m"} <= file.device.keys():
        return None
    title = base.title if base is not None and base.title else "Device identified from its log"
    device = {**file.device, "range": file.ranges}
    tables = {"name": "device", "title": title, "device": device, "sources": file.sources, "gaps": gaps}
    return DeviceFile.model_validate(tables)


def _fill(file: _File, base: DeviceFile | None, gaps: list[str]) -> None:
    """Fill gaps from the base, or cautiously; what was searched for and not found stays a gap."""
    for key in [key for key in gaps if key not in file.device]:
        if key == "amplifier_bandwidth_hz" and "delay_samples" not in gaps:
            continue  # its lag is in the delay
        if base is not None and states(base, key):
            if key in _PARAMETERS:
                file.take(base, key, f"{base.name}; the logs do not tell it")
                value = file.device[key]
                file.ranges.setdefault(key, (value / 3, value * 3))
            else:
                file.take(base, key)
                if key not in base.gaps:
                    gaps.remove(key)
        elif key == "delay_samples":
            source = "not identified; one sample stands for the link to the computer"
            file.put(key, 1.0, (0.0, 2.0), "assumed", source)


def _lags(result: Identification) -> bool:
    return bool({"lag", "loop"} & set(result.rungs))


def states(base: DeviceFile, key: str) -> bool:
    """Return whether a device file gives a value, a guess without a source included."""
    return key in base.device.model_fields_set and getattr(base.device, key) is not None


def _significant(one: Estimate) -> tuple[float, tuple[float, float]]:
    """Return a value and its ends with the digits that the interval supports; next to nothing becomes 0."""
    half, size = (one.high - one.low) / 2, max(abs(one.low), abs(one.high))
    digits = min(max(5, 3 + math.ceil(math.log10(size / half))), 15) if 0 < half < size else 5
    least = 1e-3 if one.key == "delay_samples" else 1e-9
    value, low, high = (float(f"{each:.{digits}g}") for each in (one.value, one.low, one.high))
    value, low, high = (0.0 if abs(each) < least else each for each in (value, low, high))
    return value, (min(low, value), max(high, value))


def check_against(records: Sequence[Record], base: DeviceFile) -> None:
    """Refuse commands above the device's limit, and a log of every second or third tick of its loop."""
    device, faults = base.device, []
    force = np.abs(np.concatenate([one.force_n for one in records]))
    most = device.max_force_n if states(base, "max_force_n") else None
    if most is not None and np.mean(force > 1.01 * most) > 1e-3:
        key = device.units.key("max_force_n")
        message = f"goes above device.{key} of {base.name}, {number(most)}; allowed: the force that acts"
        faults.append(Fault(records[0].name, None, "force", message))
    ticks = records[0].sample_time_s / device.sample_time_s
    if states(base, "sample_time_s") and round(ticks) > 1 and abs(ticks / round(ticks) - 1) < 0.01:
        message = f"steps by {round(ticks)} times device.sample_time_s of {base.name}; allowed: every tick of the loop"
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
        "sources": units.keyed({key: one.model_dump() for key, one in file.sources.items()}),
    }
    return "\n".join(toml_lines((), {key: value for key, value in tables.items() if value})) + "\n"
