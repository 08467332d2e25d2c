"""The device file of an identification, and what a device file and logs say against each other."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from avc_casadi._errors import AvcError, Fault, InputError
from avc_casadi._util.text import number
from avc_casadi.files.device_file import DeviceFile
from avc_casadi.identification.intervals import late_samples
from avc_casadi.identification.model import Estimate, Identification
from avc_casadi.identification.record import Record
from avc_casadi.identification.terms import FRICTION, LOOP_RATIO
from avc_casadi.model.device import Device, DeviceRange

_DIGITS = 5
_SEARCHED = ("mass_kg", "damping_ns_per_m", FRICTION, "delay_samples")
_PLAIN = (*_SEARCHED, "encoder_resolution_m", "position_noise_rms_m", "amplifier_bandwidth_hz", LOOP_RATIO)
_GAPS = (*_SEARCHED, "encoder_resolution_m", "position_noise_rms_m", "amplifier_bandwidth_hz", "backlash_m")
_MODE = ("frequency_hz", "damping_ratio", "mass_ratio")
# A guess that a log does not tell is taken as known within this factor.
_GUESSED = 3.0
# Cautious values for gaps that the loop cannot do without.
_CAUTIOUS = {"delay_samples": (1.0, (0.0, 2.0), "one sample stands for the link to the computer")}
# A share of the samples in which the force may exceed the device's; a relative difference of sample times; a factor
# within which a value without a range is the same.
_FEW, _SAME, _FAR = 1e-3, 0.01, 2.0


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
        told = source or (f"{base.name}, which gives no source" if theirs is None else theirs.source)
        self.put(key, table[key], table.get("range", {}).get(key), grade, told)

    def drop(self, key: str) -> None:
        for table in (self.device, self.ranges, self.sources):
            table.pop(key, None)


def device_file(
    found: Identification, base: DeviceFile | None, handle_radius_m: float | None = None
) -> DeviceFile | None:
    """Return the device file, or None where mass, damping or the radius of the handle are known from nothing."""
    file = _File({"sample_time_s": found.sample_time_s})
    if found.motion == "rotary":
        radius = handle_radius_m or (None if base is None else base.device.handle_radius_m)
        if radius is None:
            return None
        file.device = {"motion": "rotary", "handle_radius_m": radius, **file.device}
    logs = ", ".join(dict.fromkeys(name.partition("@")[0].partition("#")[0] for name in found.sources))[:300]
    how = f"avc identify, {found.seconds:.3g} s of {logs}"
    file.sources["sample_time_s"] = {"grade": "measured", "source": f"{how}: time of the log"}
    gaps = [key for key in (*_GAPS, "max_force_n") if not _identified(found, key)]
    for key in _PLAIN:
        one = found.estimates.get(key)
        # A range is worth more than a guess where it bounds the number.
        if one is not None and (one.identified or (key in _SEARCHED and one.value > 0 and one.high < 30 * one.value)):
            value, ends = _rounded(one)
            lag = "; the lag of the amplifier is in it" if key == "delay_samples" and not _lags(found) else ""
            grade = "measured" if one.identified else "assumed"
            file.put(key, value, None if key == "encoder_resolution_m" else ends, grade, f"{how}: {one.source}{lag}")
    if "resonance" in found.rungs:
        mode = {key: _rounded(found.estimates[f"resonance.{key}"]) for key in _MODE}
        assumed = "" if found.estimates["resonance.mass_ratio"].identified else "; how the mass divides is assumed"
        file.put(
            "resonance",
            {key: value for key, (value, _) in mode.items()},
            {key: ends for key, (_, ends) in mode.items()},
            "measured",
            f"{how}: prediction error, two masses{assumed}",
        )
        file.device["encoder_at"] = found.encoder_at
    else:
        gaps.append("resonance")
    _fill(file, base, gaps)
    if "amplifier_bandwidth_hz" in file.device:
        _amplifier(file, found, base, gaps)
    if not {"mass_kg", "damping_ns_per_m"} <= file.device.keys():
        return None
    title = base.title if base is not None and base.title else "Device identified from its log"
    device = {**file.device, "range": file.ranges}
    tables = {"name": "device", "title": title, "device": device, "sources": file.sources, "gaps": gaps}
    return DeviceFile.model_validate(tables)


def _fill(file: _File, base: DeviceFile | None, gaps: list[str]) -> None:
    """Fill gaps from the base, or cautiously; what was searched for and not found stays a gap."""
    for key in [key for key in gaps if key not in file.device]:
        if base is not None and states(base, key):
            if key in _SEARCHED:
                file.take(base, key, f"{base.name}; the logs do not tell it")
                value = file.device[key]
                file.ranges.setdefault(key, (value / _GUESSED, value * _GUESSED))
            else:
                file.take(base, key)
                if key not in base.gaps:
                    gaps.remove(key)
        elif key in _CAUTIOUS:
            value, ends, why = _CAUTIOUS[key]
            file.put(key, value, ends, "assumed", f"not identified; {why}")


def _identified(found: Identification, key: str) -> bool:
    return key in found.estimates and found.estimates[key].identified


def _lags(found: Identification) -> bool:
    return bool({"lag", "loop"} & set(found.rungs))


def states(base: DeviceFile, key: str) -> bool:
    """Return whether a device file gives a value, a guess without a source included."""
    return key in base.device.model_fields_set and getattr(base.device, key) is not None


def _amplifier(file: _File, found: Identification, base: DeviceFile | None, gaps: list[str]) -> None:
    """Say the order of the amplifier; the lag of the base's amplifier is taken out of the delay, which holds it."""
    key, period = "amplifier_bandwidth_hz", found.sample_time_s
    if _lags(found) or base is None:
        file.device["amplifier_order"] = found.amplifier_order
        return
    order = file.device["amplifier_order"] = base.device.amplifier_order
    ratio = base.device.amplifier_damping_ratio
    if order == 2 and states(base, LOOP_RATIO):
        file.take(base, LOOP_RATIO)
    if "delay_samples" not in found.estimates:
        return
    ends = file.ranges.get(key, (file.device[key],) * 2)
    lag, most, least = (
        late_samples({key: hertz, LOOP_RATIO: ratio}, order, period) for hertz in (file.device[key], *ends)
    )
    low, high = file.ranges["delay_samples"]
    if high < lag:
        for one in (key, LOOP_RATIO, "amplifier_order"):
            file.drop(one)
        gaps += [] if key in gaps else [key]
        return
    value, low, high = (
        max(0.0, float(f"{each:.{_DIGITS}g}"))
        for each in (file.device["delay_samples"] - lag, low - most, high - least)
    )
    source = file.sources["delay_samples"]
    told = source["source"].replace("; the lag of the amplifier is in it", "")
    file.put(
        "delay_samples",
        value,
        (low, high),
        source["grade"],
        f"{told}, less the lag of the amplifier, {lag:.3g} samples",
    )


def _rounded(one: Estimate) -> tuple[float, tuple[float, float]]:
    """Return a value and its ends with the digits that the interval supports; next to nothing becomes 0."""
    half, size = (one.high - one.low) / 2, max(abs(one.low), abs(one.high))
    digits = min(max(_DIGITS, 3 + math.ceil(math.log10(size / half))), 15) if 0 < half < size else _DIGITS
    least = 1e-3 if one.key == "delay_samples" else 1e-9
    value, low, high = (float(f"{each:.{digits}g}") for each in (one.value, one.low, one.high))
    value, low, high = (0.0 if abs(each) < least else each for each in (value, low, high))
    return value, (min(low, value), max(high, value))


def check_against(records: Sequence[Record], base: DeviceFile) -> None:
    """Refuse commands above the device's limit, and a log of every second or third tick of its loop."""
    device, faults = base.device, []
    force = np.abs(np.concatenate([one.force_n for one in records]))
    if states(base, "max_force_n") and device.max_force_n is not None:
        share = float(np.mean(force > device.max_force_n * (1 + _SAME)))
        if share > _FEW:
            message = (
                f"is above device.max_force_n, {number(device.max_force_n)}, in {100 * share:.2g} % of the samples: "
                f"what acts is then not what is logged; allowed: less, or in {base.name} what the device gives"
            )
            faults.append(Fault(records[0].name, None, "force", message))
    period = records[0].sample_time_s
    ticks = period / device.sample_time_s
    if states(base, "sample_time_s") and round(ticks) > 1 and abs(ticks / round(ticks) - 1) < _SAME:
        message = (
            f"steps by {number(1e3 * period)} ms, {round(ticks)} times device.sample_time_s: the forces between are "
            f"not in the log; allowed: every tick of the loop, or in {base.name} the sample time that it ran at"
        )
        faults.append(Fault(records[0].name, None, "time", message))
    if faults:
        raise InputError(faults)


def differences(found: Identification, base: DeviceFile) -> list[str]:
    """Return a note where logs contradict the device file: they may be of another device."""
    unlike = []
    if states(base, "sample_time_s") and abs(found.sample_time_s / base.device.sample_time_s - 1) > _SAME:
        unlike.append("sample_time_s")
    for key in ("mass_kg", "damping_ns_per_m", FRICTION, "amplifier_bandwidth_hz"):
        one, theirs = found.estimates.get(key), getattr(base.device, key)
        if one is None or not one.identified or not states(base, key) or not theirs or one.value <= 0:
            continue
        low, high = getattr(base.device.range, key, None) or (theirs / _FAR, theirs * _FAR)
        if one.high < low or one.low > high:
            unlike.append(key)
    keys = ", ".join(map(base.device.units.key, unlike))
    return [f"the logs and {base.name} differ in {keys}: is it the device of these logs?"] if unlike else []


def device_text(file: DeviceFile) -> str:
    """Return a device file as TOML."""
    units = file.device.units
    lines = [f"title = {_value(file.title)}"]
    if file.gaps:
        lines += [
            "# Not known. Where a value stands all the same, it is assumed, with a cautious range.",
            f"gaps = {_value([units.key(gap) for gap in file.gaps])}",
        ]
    tables = file.device.model_dump(exclude_unset=True, exclude_none=True)
    ranges = tables.pop("range", {})
    lines += [
        "",
        "[device]",
        *(f"{units.key(key)} = {_value(units.keyed(tables[key]))}" for key in Device.model_fields if key in tables),
    ]
    if ranges:
        order = [key for key in DeviceRange.model_fields if ranges.get(key)]
        lines += ["", "[device.range]", *(f"{units.key(key)} = {_value(units.keyed(ranges[key]))}" for key in order)]
    sources = {key: source.model_dump() for key, source in file.sources.items()}
    lines += ["", "[sources]"]
    lines += [f"{units.key(key)} = {_value(sources[key])}" for key in Device.model_fields if key in sources]
    return "\n".join(lines) + "\n"


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{key} = {_value(item)}' for key, item in value.items())} }}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)  # a TOML string too
    if isinstance(value, int | float) and not isinstance(value, bool):
        return repr(value)
    raise AvcError(f"{type(value).__name__} cannot be written as TOML")
