"""The device file of an identification: estimates with their ranges, the rest from a base or named as gaps."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

from avc_casadi._errors import AvcError
from avc_casadi._util.units import M_PER_S, MASS, N_PER_M, NEWTON
from avc_casadi.files.device_file import DeviceFile
from avc_casadi.identification.model import Estimate, Identification
from avc_casadi.identification.terms import DEAD_ZONE, DRAG, LOOP_RATIO, lag_of
from avc_casadi.model.device import CURRENT_LOOP_DAMPING_RATIO, Device, DeviceRange

_DIGITS = 5
_PLAIN = (
    "mass_kg",
    "damping_ns_per_m",
    "delay_samples",
    "coulomb_friction_n",
    "encoder_resolution_m",
    "position_noise_rms_m",
    "amplifier_bandwidth_hz",
    LOOP_RATIO,
    "backlash_m",
)
_MODE = ("frequency_hz", "damping_ratio", "mass_ratio")
_ALWAYS_THERE = tuple(key for key in _PLAIN if key != LOOP_RATIO)
_QUANTITIES = (*_ALWAYS_THERE, "sample_time_s", "max_force_n", "resonance")
_NEEDED = ("mass_kg", "damping_ns_per_m")
SEARCHED = ("mass_kg", "damping_ns_per_m", "coulomb_friction_n", "delay_samples")
"""Keys that are estimated from every log."""
# A guess that a log does not identify is taken as known within this factor; a wider interval bounds nothing.
_GUESSED, _BOUNDS_NOTHING = 3.0, 30.0
_MOVING = ("mass_kg", "damping_ns_per_m", "coulomb_friction_n")
_LAG_WITHIN = "; the lag of the amplifier is in it"
_LAG_TAKEN = "; less the lag of the amplifier"
# Cautious values for gaps that the loop cannot do without.
_CAUTIOUS: Mapping[str, tuple[float, tuple[float, float], str]] = {
    "delay_samples": (1.0, (0.0, 2.0), "not identified; one sample stands for the link to the computer"),
}


def device_file(found: Identification, base: DeviceFile | None) -> DeviceFile | None:
    """Return the device file, or None where mass or damping are known neither from the logs nor from the base.

    Args:
        found: the identification.
        base: prior knowledge of the device.
    """
    turn = {} if found.motion == "linear" else {"motion": found.motion, "handle_radius_m": found.handle_radius_m}
    device: dict[str, Any] = {**turn, "sample_time_s": found.sample_time_s}
    ranges: dict[str, Any] = {}
    logs = ", ".join(dict.fromkeys(name.partition("@")[0].partition("#")[0] for name in found.sources))[:300]
    how = f"avc identify, {found.seconds:.3g} s of {logs}"
    sources: dict[str, Any] = {"sample_time_s": {"grade": "measured", "source": f"{how}: time of the log"}}
    for key in _PLAIN:
        one = found.estimates.get(key)
        if one is not None:
            device[key], ranges[key] = _rounded(one)
            sources[key] = _graded(f"{how}: {_meaning(key, found)}", one.doubt)
    _widened(found, device, ranges)
    mode = {key: found.estimates.get(f"resonance.{key}") for key in _MODE}
    pairs = {key: _rounded(one) for key, one in mode.items() if one is not None}
    if found.assumed_share is not None:
        share = float(f"{found.assumed_share[0]:.2g}")
        pairs["mass_ratio"] = (share, (min(found.assumed_share[1], share), max(found.assumed_share[2], share)))
    if len(pairs) == len(_MODE):
        device["resonance"] = {key: pair[0] for key, pair in pairs.items()}
        ranges["resonance"] = {key: pair[1] for key, pair in pairs.items()}
        device["encoder_at"] = found.encoder_at
        assumed = "" if found.assumed_share is None else f"; how the {MASS} divides is assumed"
        doubts = dict.fromkeys(one.doubt for one in mode.values() if one is not None and one.doubt)
        sources["resonance"] = _graded(f"{how}: output error, two masses{assumed}", "; ".join(doubts))
    for key in ("encoder_resolution_m",):
        ranges.pop(key, None)
    gaps = [key for key in _QUANTITIES if key not in device]
    _fill(found, base, how, device, ranges, sources, gaps)
    if "amplifier_bandwidth_hz" in device:
        _of_its_kind(found, base, device, ranges, sources, gaps)
        _without_lag(found, device, ranges, sources, gaps)
    if not all(key in found.estimates or (base is not None and states(base, key)) for key in _NEEDED):
        return None
    title = base.title if base is not None and base.title else "Device identified from its log"
    tables = {
        "title": title,
        "device": {**device, "range": {key: value for key, value in ranges.items() if value}},
        "sources": sources,
        "gaps": gaps,
    }
    return DeviceFile.model_validate({"name": "device", **tables})


def _graded(source: str, doubt: str) -> dict[str, str]:
    """Return the source of an identified value; one in doubt is not said to be measured."""
    if doubt:
        return {"grade": "assumed", "source": f"{source}; in doubt: {doubt}"}
    return {"grade": "measured", "source": source}


def _fill(
    found: Identification,
    base: DeviceFile | None,
    how: str,
    device: dict[str, Any],
    ranges: dict[str, Any],
    sources: dict[str, Any],
    gaps: list[str],
) -> None:
    """Fill gaps from the bounds of the log, the base, or cautiously; parameters that were not identified stay gaps."""
    bounds = {one.key: one.bounds for one in found.refused}
    for key in list(gaps):
        if key in SEARCHED and _bounded(key, bounds.get(key), device, ranges):
            sources[key] = {"grade": "assumed", "source": f"{how}: not identified, within these bounds"}
        elif base is not None and states(base, key) and key in SEARCHED:
            # A value that was searched for in these logs and not identified has no source in them.
            _taken(base, key, device, ranges, sources)
            ranges.setdefault(key, (device[key] / _GUESSED, device[key] * _GUESSED))
            sources[key] = {"grade": "assumed", "source": f"{base.name}; the logs do not tell it"}
        elif base is not None and states(base, key):
            _taken(base, key, device, ranges, sources)
            if key not in base.gaps:
                gaps.remove(key)
        elif key in _CAUTIOUS:
            device[key], ranges[key], why = _CAUTIOUS[key]
            sources[key] = {"grade": "assumed", "source": why}


def _bounded(
    key: str, bounds: tuple[float, float, float] | None, device: dict[str, Any], ranges: dict[str, Any]
) -> bool:
    """Take the bounds of parameters that are not identified, where they are informative; return whether they are."""
    if bounds is None:
        return False
    value, low, high = (float(f"{each:.3g}") for each in bounds)
    if not 0 <= low <= value <= high < _BOUNDS_NOTHING * max(low, value / _GUESSED) or value == 0:
        return False
    device[key], ranges[key] = value, (low, high)
    return True


def states(base: DeviceFile, key: str) -> bool:
    """Return whether a device file gives a value, a guess without a source included.

    Args:
        base: the file.
        key: of a quantity; False for any other.
    """
    return key in base.device.model_fields_set and getattr(base.device, key) is not None


def _meaning(key: str, found: Identification) -> str:
    one = found.estimates[key]
    told = f"{one.how}, {100 * one.level:g} % interval" if one.level < 1 else one.how
    if key == "delay_samples" and "amplifier" not in found.terms:
        told += _LAG_WITHIN
    if key == "coulomb_friction_n" and "stribeck" in found.terms:
        excess, speed = (found.estimates.get(name) for name in ("breakaway_excess_n", "stribeck_speed_m_per_s"))
        if excess is not None and speed is not None:
            told += f"; {excess.value:.3g} {NEWTON} more from rest, which goes within {speed.value:.2g} {M_PER_S}"
    if key in {"mass_kg", "damping_ns_per_m"} and "stiffness" in found.terms:
        spring = found.estimates.get("stiffness_n_per_m")
        of = "" if spring is None else f" of {spring.value:.4g} {N_PER_M}"
        told += f"; beside a spring{of} to the ground, which this file has no key for: no loop made with it has it"
    beside = {"a dead zone": DEAD_ZONE, "a drag": DRAG} if key in _MOVING else {}
    for what, name in beside.items():
        if name in found.estimates:
            size = f"{found.estimates[name].value:.3g} {found.estimates[name].unit}"
            told += f"; beside {what} of {size}, which this file has no key for"
    return told


def _widened(found: Identification, device: dict[str, Any], ranges: dict[str, Any]) -> None:
    """Widen ranges by what a device file has no key for: damping by its dependence on the direction."""
    one = found.estimates.get("damping_asymmetry_ns_per_m")
    if one is None or "damping_ns_per_m" not in device:
        return
    low, high = ranges["damping_ns_per_m"]
    more = max(abs(one.low), abs(one.high))
    ranges["damping_ns_per_m"] = (max(low - more, 0.0), high + more)


def _of_its_kind(
    found: Identification,
    base: DeviceFile | None,
    device: dict[str, Any],
    ranges: dict[str, Any],
    sources: dict[str, Any],
    gaps: list[str],
) -> None:
    """Describe the order of the amplifier whose bandwidth the file gives, and the damping of a current loop."""
    theirs = base is not None and "amplifier_bandwidth_hz" not in found.estimates
    device["amplifier_order"] = base.device.amplifier_order if base and theirs else found.amplifier_order
    if device["amplifier_order"] == 1:
        for table in (device, ranges, sources):
            table.pop(LOOP_RATIO, None)
    elif LOOP_RATIO not in device:
        if base is not None and states(base, LOOP_RATIO):
            _taken(base, LOOP_RATIO, device, ranges, sources)
        if base is None or not states(base, LOOP_RATIO) or LOOP_RATIO in base.gaps:
            gaps.append(LOOP_RATIO)


def _taken(base: DeviceFile, key: str, device: dict[str, Any], ranges: dict[str, Any], sources: dict[str, Any]) -> None:
    """Take a value of the base, with its range and its source."""
    table = base.device.model_dump(exclude_none=True)
    device[key] = table[key]
    if key in table.get("range", {}):
        ranges[key] = table["range"][key]
    source = getattr(base.sources, key)
    guess = {"grade": "assumed", "source": f"{base.name}, which gives no source"}
    sources[key] = guess if source is None else source.model_dump()


def _without_lag(
    found: Identification, device: dict[str, Any], ranges: dict[str, Any], sources: dict[str, Any], gaps: list[str]
) -> None:
    """Subtract the lag of the base's amplifier from the identified delay, which includes it; drop a longer lag."""
    if "amplifier_bandwidth_hz" in found.estimates or "delay_samples" not in found.estimates:
        return
    key, turns = "amplifier_bandwidth_hz", 2 * math.pi * device["sample_time_s"]
    ratio = device.get(LOOP_RATIO, CURRENT_LOOP_DAMPING_RATIO)
    angle = [lag_of(device["amplifier_order"], one) for one in (ratio, *ranges.get(LOOP_RATIO, (ratio, ratio)))]
    slowest, fastest = ranges.get(key, (device[key],) * 2)
    lag, least, most = (a / (turns * f) for a, f in zip(angle, (device[key], fastest, slowest), strict=True))
    low, high = ranges["delay_samples"]
    if high < lag:
        for table in (device, ranges, sources):
            table.pop(key, None)
            table.pop(LOOP_RATIO, None)
        device.pop("amplifier_order")
        if key not in gaps:
            gaps.append(key)
        return
    value, low, high = (
        max(0.0, float(f"{each:.{_DIGITS}g}")) for each in (device["delay_samples"] - lag, low - most, high - least)
    )
    device["delay_samples"], ranges["delay_samples"] = value, (low, high)
    source = sources["delay_samples"]
    source["source"] = source["source"].replace(_LAG_WITHIN, f"{_LAG_TAKEN}, {lag:.3g} samples")


def _rounded(one: Estimate) -> tuple[float, tuple[float, float]]:
    """Return a value and its ends rounded to the digits that the interval supports; next to nothing becomes 0."""
    digits = one.digits(3, _DIGITS)
    value, low, high = (float(f"{each:.{digits}g}") for each in (one.value, one.low, one.high))
    value, low, high = (0.0 if abs(each) < 1e-9 else each for each in (value, low, high))
    if one.key == "delay_samples":
        value, low, high = (0.0 if each < 1e-3 else each for each in (value, low, high))
    return value, (min(low, value), max(high, value))


def device_text(file: DeviceFile) -> str:
    """Return a device file as TOML.

    Raises:
        AvcError: a text that TOML cannot hold.
    """
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
    sources = file.sources.model_dump(exclude_none=True)
    lines += ["", "[sources]"]
    for key in Device.model_fields:
        if key in sources:
            one = {"grade": sources[key]["grade"], "source": sources[key]["source"]}
            lines.append(f"{units.key(key)} = {_value(one)}")
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
