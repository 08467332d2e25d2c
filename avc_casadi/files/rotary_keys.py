"""Conversion of the keys of a rotary device's file to the common keys, and back.

A key of the other kind of motion is refused with the right one, and its value is checked all the same, so that all
faults of a file are reported at once.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, TypeVar

from avc_casadi._util.units import LINEAR, ROTARY, Units, speaking, units_for
from avc_casadi.model.quantity import nearest_key, shown
from avc_casadi.model.registries import EFFECTS
from avc_casadi.model.rules import BELONGS_IN, UNKNOWN, Path

_Finding = tuple[Path, str]
M = TypeVar("M")

COUNTS = "encoder_counts_per_turn"
"""Key of a file in place of `encoder_resolution_rad`."""
CAPSTAN = "capstan_radius_m"
"""Key of a rotary device with a linear handle: metres per radian."""
# Replaces a faulty value, so that the rest of the file is checked.
_SOME_RADIUS_M = 0.01
# Powers of the radius that convert a rotary value to the handle.
_AT_HANDLE = {
    "_ns2_per_m2": -3,
    "_ns_per_m": -2,
    "_n_per_m": -2,
    "_m_per_s": 1,
    "_n_per_s": -1,
    "_kg": -2,
    "_n": -1,
    "_m": 1,
}


@dataclass(frozen=True)
class Worded:
    """Tables in the common keys.

    Attributes:
        tables: converted.
        device: units in which the file states its device.
        rest: units of the rest of the file.
        findings: keys of the wrong kind of motion, as in the file.
    """

    tables: Mapping[str, Any]
    device: Units = LINEAR
    rest: Units = LINEAR
    findings: list[_Finding] = field(default_factory=list)

    def told(self, check: Callable[[], M | list[_Finding]]) -> M | list[_Finding]:
        """Return the checked model, or findings in the units of the file, those of wrong keys first.

        Args:
            check: of the tables, in the units that are spoken.
        """
        with speaking(self.rest):
            checked = of_rest = check()
        with speaking(self.device):
            of_device = of_rest if self.device is self.rest else check()
        found = [*self.findings]
        if isinstance(of_rest, list) and isinstance(of_device, list):
            for rest, own in zip(of_rest, of_device, strict=True):
                (path, message), units = (rest, self.rest)
                if path[:1] in {("device",), ("sources",), ("gaps",)}:
                    (path, message), units = (own, self.device)
                place = tuple(units.key(part) if part in _known() else part for part in path)
                unknown = units is not LINEAR and message.startswith(UNKNOWN)
                found.append((place, _unknown(place, message) if unknown else message))
        return found or checked


def _unknown(path: Path, message: str) -> str:
    """Describe an unknown key: the keys of a table, those of rotary devices among them, and the nearest."""
    keys = message.removeprefix(UNKNOWN).partition(";")[0].split(", ")
    beside: dict[Path, list[str]] = {("device",): [COUNTS], ("device", "range"): [COUNTS], ("detent",): ["per_turn"]}
    keys += beside.get(path[:-1], [])
    _, belongs, table = message.partition(BELONGS_IN)
    near = nearest_key(str(path[-1]), keys)
    hint = f"{belongs}{table}" if belongs else f"; did you mean {near}?" if near else ""
    return f"{UNKNOWN}{', '.join(keys)}{hint}"


@lru_cache(maxsize=1)
def _known() -> frozenset[str]:
    """Return the common names of keys that depend on the motion."""
    of_effects = {key for effect in EFFECTS.values() for key in effect.keys.model_fields}
    return _of_tables() | {key for key in of_effects if ROTARY.key(key) != key}


@lru_cache(maxsize=1)
def _of_tables() -> frozenset[str]:
    """Return those of the tables of a problem; effects have their own, linear in files of 0.2."""
    from avc_casadi.model.problem import Problem  # noqa: PLC0415 - stands on this file

    def keys(schema: Any) -> Iterator[str]:
        if isinstance(schema, Mapping):
            yield from schema.get("properties", {})
            for item in schema.values():
                yield from keys(item)
        elif isinstance(schema, list):
            for item in schema:
                yield from keys(item)

    every = set(keys(Problem.model_json_schema())) | {
        "max_stiffness_n_per_m",
        "max_damping_ns_per_m",
        "wall_stiffness_n_per_m",
    }
    return frozenset(key for key in every if ROTARY.key(key) != key)


def inner_table(table: Any, units: Units, path: Path, findings: list[_Finding], *, capstan: bool = False) -> Any:
    """Return a table of a file with the common keys; keys of the other motion are findings.

    Args:
        table: any value of the file.
        units: of the file.
        path: its key path.
        findings: extended by new ones.
        capstan: whether it is linear through a capstan.
    """
    if isinstance(table, list):
        return [inner_table(item, units, (*path, index), findings, capstan=capstan) for index, item in enumerate(table)]
    if not isinstance(table, Mapping):
        return table
    inner: dict[str, Any] = {}
    for key, value in table.items():
        name, place = _inner_key(key, units), (*path, key)
        if units.linear and ROTARY.inner(key) != key and ROTARY.inner(key) in _known():
            name = ROTARY.inner(key)
            message = f'is a key of a device that turns; allowed: {name}, or device.motion = "rotary"'
            if capstan:
                message = f"is a key of what turns; allowed: {name}, as all but [device] is linear beside {CAPSTAN}"
            findings.append((place, message))
        elif not units.linear and key in _of_tables():
            message = f'is a key of a linear device; allowed: {ROTARY.key(key)}, as device.motion is "rotary"'
            findings.append((place, message))
            if ROTARY.key(key) in table:
                continue
        inner[name] = inner_table(value, units, place, findings, capstan=capstan)
    return inner


def _inner_key(key: str, units: Units) -> str:
    name = units.inner(key)
    return name if name in _known() else key


def resolved(table: Mapping[str, Any], path: Path, findings: list[_Finding]) -> dict[str, Any]:
    """Return a device with encoder counts converted to an angle, its range included."""
    found = dict(table)
    counts = found.pop(COUNTS, None)
    if counts is not None:
        place = (*path, COUNTS)
        if "encoder_resolution_m" in found:
            findings.append((place, "stands beside encoder_resolution_rad; allowed: one of the two"))
        if not _is_count(counts):
            findings.append((place, f"is {shown(counts)}; allowed: 4 to 1e9 counts, four for each line"))
        else:
            found.setdefault("encoder_resolution_m", 2 * math.pi / float(counts))
    if isinstance(found.get("range"), Mapping):
        found["range"] = _resolved_range(found["range"], (*path, "range"), counts, findings)
    return found


def _resolved_range(table: Mapping[str, Any], path: Path, counts: Any, findings: list[_Finding]) -> dict[str, Any]:
    """Return ranges with counts converted to an angle, whose ends swap."""
    found = dict(table)
    ends = found.pop(COUNTS, None)
    if ends is None:
        return found
    wrong = None
    if "encoder_resolution_m" in found:
        wrong = "stands beside encoder_resolution_rad; allowed: one of the two"
    elif not (isinstance(ends, list) and len(ends) == 2 and all(map(_is_count, ends))):
        wrong = f"is {shown(ends)}; allowed: [low, high], 4 to 1e9 counts"
    elif ends[0] > ends[1]:
        wrong = f"is {shown(ends)}, reversed; allowed: [low, high] with low <= high"
    elif counts is None:
        wrong = f"says nothing without device.{COUNTS}; allowed: beside it, or encoder_resolution_rad"
    elif _is_count(counts) and not ends[0] <= counts <= ends[1]:
        wrong = f"is {shown(ends)}; allowed: ends that hold device.{COUNTS} = {shown(counts)}"
    if wrong:
        findings.append(((*path, COUNTS), wrong))
    else:
        found["encoder_resolution_m"] = [2 * math.pi / float(end) for end in reversed(ends)]
    return found


def _is_count(value: Any) -> bool:
    return not isinstance(value, bool) and isinstance(value, int | float) and 4 <= value <= 1e9


def at_handle(device: Mapping[str, Any], radius_m: float) -> dict[str, Any]:
    """Return a rotary device as the linear one at a handle, which moves `radius_m` per radian.

    Mass J/r^2, damping B/r^2, force tau/r, length r theta; times, frequencies and ratios are unchanged.

    Args:
        device: table of the rotary device, in the common keys.
        radius_m: metres per radian.
    """
    return {
        key: at_handle(value, radius_m) if isinstance(value, Mapping) else _moved(value, power_at_handle(key), radius_m)
        for key, value in device.items()
        if key not in {"motion", "handle_radius_m", CAPSTAN}
    }


def power_at_handle(key: str) -> int:
    """Return the power of the radius that converts a rotary value to the handle, by the key's unit."""
    return next((power for ending, power in _AT_HANDLE.items() if key.endswith(ending)), 0)


def _moved(value: Any, power: int, radius_m: float) -> Any:
    if isinstance(value, list | tuple):
        return [_moved(item, power, radius_m) for item in value]
    if power == 0 or isinstance(value, bool) or not isinstance(value, int | float):
        return value
    return float(value) * radius_m**power


def _pitched(detent: Mapping[str, Any], findings: list[_Finding]) -> dict[str, Any]:
    """Return detents per turn as the angle between them."""
    found = dict(detent)
    count = found.pop("per_turn", None)
    if count is None:
        if "pitch_rad" not in found:
            findings.append(
                (("detent", "pitch_rad"), "is missing; allowed: 1e-6 to 10 rad, or per_turn, a whole number")
            )
        return {"pitch_rad": 1.0} | found
    if "pitch_rad" in found:
        findings.append((("detent", "per_turn"), "stands beside pitch_rad; allowed: one of the two"))
    if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= 100_000:
        findings.append((("detent", "per_turn"), f"is {shown(count)}; allowed: an integer 1 to 100000"))
        count = 1
    return {"pitch_rad": 2 * math.pi / count} | found


def device_words(device: Any, base: Mapping[str, Any], findings: list[_Finding]) -> tuple[Any, Units]:
    """Return the device table of a file in the common keys, and its units.

    Args:
        device: as in the file, without a reference.
        base: the device that it refers to; empty where there is none.
        findings: extended by new ones.
    """
    before = base.get("motion", "linear")
    if not isinstance(device, Mapping):
        return device, units_for(before)
    motion = device.get("motion", before)
    units = units_for("rotary" if motion == "rotary" else "linear")
    if base and motion != before:
        message = f'is {shown(motion)}, and the device that it refers to is "{before}"; allowed: that, or none'
        findings.append((("device", "motion"), message))
    found = inner_table(device, units, ("device",), findings)
    if not units.linear:
        return resolved(found, ("device",), findings), units
    ranges = found.get("range")
    for place, table in ((("device",), found), (("device", "range"), ranges if isinstance(ranges, dict) else {})):
        if table.pop(COUNTS, None) is not None:
            message = 'is a key of a device that turns; allowed: encoder_resolution_m, or device.motion = "rotary"'
            findings.append(((*place, COUNTS), message))
    return found, units


def linear_at_capstan(device: Any, units: Units, findings: list[_Finding]) -> tuple[Any, Units]:
    """Return a device with a capstan as the linear one at its handle, and the units of the rest of the file."""
    if not isinstance(device, Mapping) or CAPSTAN not in device:
        return device, units
    radius, place = device[CAPSTAN], ("device", CAPSTAN)
    rest = {key: value for key, value in device.items() if key != CAPSTAN}
    if units.linear:
        findings.append((place, 'says nothing of a linear device; allowed: beside motion = "rotary"'))
        return rest, units
    if isinstance(radius, bool) or not isinstance(radius, int | float) or not 2e-3 <= radius <= 10:
        findings.append((place, f"is {shown(radius)}; allowed: 0.002 to 10 m of handle for each radian"))
        return at_handle(rest, _SOME_RADIUS_M), LINEAR
    if "handle_radius_m" in rest:
        findings.append((("device", "handle_radius_m"), f"stands beside {CAPSTAN}; allowed: one of the two"))
    return at_handle(rest, float(radius)), LINEAR


def problem_words(
    tables: Mapping[str, Any], device: Any, words: tuple[Units, Units], findings: list[_Finding]
) -> Worded:
    """Return all tables of a file in the common keys.

    Args:
        tables: of the file.
        device: its converted device.
        words: units of the device, and of the rest.
        findings: found so far.
    """
    own, rest = words
    if not rest.linear and isinstance(tables.get("detent"), Mapping):
        tables = {**tables, "detent": _pitched(tables["detent"], findings)}
    capstan = rest.linear and not own.linear
    others = {key: value for key, value in tables.items() if key != "device"}
    inner = inner_table(others, rest, (), findings, capstan=capstan)
    return Worded(inner | ({"device": device} if "device" in tables else {}), own, rest, findings)
