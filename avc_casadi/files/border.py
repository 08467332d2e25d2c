"""The border of a file: its keys as the common ones inside, and the faults found there in the words of the file."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from pydantic_core import PydanticCustomError

from avc_casadi._errors import InputError, UnsupportedError
from avc_casadi._util.units import LINEAR, ROTARY, Units, units_for
from avc_casadi.model import quantity as q
from avc_casadi.model import table as t
from avc_casadi.model.device import Device
from avc_casadi.model.joint import NoDevice
from avc_casadi.model.table import UNKNOWN, checked
from avc_casadi.model.unit_text import power_at_handle, read_quantity, unit_of_key

COUNTS = "encoder_counts_per_turn"
"""Key of an encoder of a rotary device by its counts, in place of its resolution."""
CAPSTAN = "capstan_radius_m"
"""Key of a rotary device with a linear handle: metres per radian."""
_STAND_IN_RADIUS_M = 0.01
"""Stands in place of a faulty radius, so that the rest of the file is checked."""
_PERIODS = q.Quantity("s", 1e-7, 10, zero=False)
_USUAL_PERIOD_S = float(Device.model_fields["sample_time_s"].default)
_COUNTS_PER_TURN = q.Quantity("counts", 8, 1e9, zero=False)
_DETENTS_PER_TURN = q.Whole(1, 100_000)
M = TypeVar("M", bound=t.Table)


@dataclass(frozen=True)
class _Reading:
    """What a text of another unit is read with: the radius of the handle of what turns, and the sample time."""

    radius_m: float | None = None
    period_s: float = _USUAL_PERIOD_S

    @classmethod
    def of(cls, device: Mapping[str, Any]) -> _Reading:
        """Return that of a device; faults of its values are found where they are read."""
        period_s = _read_or_none(device.get("sample_time_s"), "s", _PERIODS)
        return cls(_radius_m(device), _USUAL_PERIOD_S if period_s is None else period_s)

    def samples(self, text: str) -> float:
        """Return how many samples a text means: a count, or a time."""
        try:
            return read_quantity(text, "samples")
        except ValueError as error:
            with suppress(ValueError):
                return float(f"{read_quantity(text, 's') / self.period_s:.12g}")
            raise error from None


@contextmanager
def in_keys_of(units: Units) -> Iterator[None]:
    """Let faults that are found inside name their keys as a file of this motion does."""
    try:
        yield
    except InputError as error:
        if units.linear:
            raise
        faults = [
            replace(fault, key=units.key(fault.key), message=units.words(fault.message)) for fault in error.faults
        ]
        raise InputError(faults) from error
    except UnsupportedError as error:
        error.key = units.key(error.key)
        error.args = tuple(units.words(str(text)) for text in error.args)
        raise


class Border:
    """Tables of a file in the common keys, and where each of them stands in the file.

    `device` and `rest` are the units of the device and of all other tables, `follower_base` is the device that a
    follower refers to.
    """

    def __init__(self) -> None:
        self.tables: dict[str, Any] = {}
        self.device = self.rest = LINEAR
        self.follower_base: Mapping[str, Any] = {}
        self._reading = _Reading()
        self._findings: dict[t.Path, str] = {}
        self._written: dict[t.Path, t.Path] = {(): ()}

    def fault(self, path: t.Path, message: str) -> None:
        """Add a fault at a path of the file."""
        self._findings.setdefault(path, message)

    def checked(self, model: type[M], name: str) -> M | list[t.Finding]:
        """Return the tables as a model, or all faults, each at its path in the file."""
        result = checked(model, self.tables, name, tuple(dict.fromkeys((self.device, self.rest))))
        findings = result if isinstance(result, list) else []
        faults: dict[t.Path, str] = {}
        for path, message in findings:
            place, text = self._in_file(path, message)
            if not message.startswith(UNKNOWN) and self._found_inside(place):
                continue
            # What was found on reading says more than what the model says of it.
            faults[place] = text if message.startswith(UNKNOWN) else self._findings.get(place, text)
        faults |= {place: text for place, text in self._findings.items() if place not in faults}
        if faults or isinstance(result, list):
            return list(faults.items())
        return result

    def _found_inside(self, place: t.Path) -> bool:
        """Return whether a list or table of the file has a fault inside, found on reading, which says it all."""
        return any(len(found) > len(place) and found[: len(place)] == place for found in self._findings)

    def _in_file(self, path: t.Path, message: str) -> t.Finding:
        """Return a finding at its place in the file and in the words of the file."""
        units = self.device if path[:1] in {("device",), ("sources",), ("gaps",)} else self.rest
        known = next(length for length in range(len(path), -1, -1) if path[:length] in self._written)
        rest = (units.key(part) if isinstance(part, str) else part for part in path[known:])
        if message.startswith(UNKNOWN) and not units.linear and difflib.get_close_matches(str(path[-1]), (COUNTS,)):
            of_device = path[0] in {"device", "follower"} and set(path[1:-1]) <= {"range"}
            message = f"{message}; did you mean {COUNTS}{'' if of_device else ' in [device]'}?"
        return (*self._written[path[:known]], *rest), units.words(message)

    def inner(self, value: Any, units: Units, path: t.Path, written: t.Path, reading: _Reading) -> Any:
        """Return a value of the file with the common keys; texts are read in their units, or in those at a radius."""
        if isinstance(value, list):
            return [
                self.inner(item, units, (*path, index), (*written, index), reading) for index, item in enumerate(value)
            ]
        if not isinstance(value, Mapping):
            return value
        reading = _Reading.of({**self.follower_base, **value}) if path == ("follower",) else reading
        inner: dict[str, Any] = {}
        for key, item in value.items():
            name = units.inner(key)
            place = (*written, key)
            if units.key(key) != key:
                self.fault(place, f'is a key of a linear device; use {units.key(key)}, because motion is "rotary"')
                if units.key(key) in value:
                    continue
            self._written[*path, name] = place
            unit = unit_of_key(key, units)
            # A mass typed for an inertia may be that of the handle, or of the rotor.
            ambiguous = name == "mass_kg" and path[:1] != ("hands",)
            typed = self._typed(item, unit, place, replace(reading, radius_m=None) if ambiguous else reading)
            inner[name] = self.inner(typed, units, (*path, name), place, reading)
        return inner

    def _typed(self, value: Any, unit: str, place: t.Path, reading: _Reading) -> Any:
        """Return a text with a unit as the number that it is; anything else unchanged."""
        if isinstance(value, list) and unit:
            return [self._typed(item, unit, (*place, index), reading) for index, item in enumerate(value)]
        if not unit or not isinstance(value, str) or not re.search(r"[^-+.\d\seE]", value):
            return value
        try:
            return reading.samples(value) if unit == "samples" else read_quantity(value, unit, reading.radius_m)
        except ValueError as error:
            self.fault(place, f"is {t.shown(value)}, {error}")
            return value

    def device_table(self, device: Any, base: Mapping[str, Any], table: str = "device") -> tuple[Any, Units]:
        """Return a device in the common keys over the one that it refers to, and the units of the file's."""
        before = base.get("motion", "linear")
        if not isinstance(device, Mapping):
            return base or device, units_for(before)
        motion = device.get("motion", before)
        units = units_for("rotary" if motion == "rotary" else "linear")
        if base and motion != before:
            self.fault(
                (table, "motion"),
                f'is {t.shown(motion)}; allowed: "{before}", as in the device of `from`, or leave it out',
            )
        reading = _Reading.of({**base, **device})
        self._reading = replace(reading, radius_m=None) if units.linear else reading
        stated = self.inner(device, units, (table,), (table,), self._reading)
        if not units.linear:
            self._counted(stated, (table,))
        complete = overridden(base, stated)
        if CAPSTAN not in complete:
            return complete, units
        radius = complete.pop(CAPSTAN)
        if units.linear:
            self.fault((table, CAPSTAN), 'applies to a rotary device only; leave it out, or set motion = "rotary"')
            return complete, units
        if "handle_radius_m" in complete:
            self.fault((table, "handle_radius_m"), f"is given with {CAPSTAN}; give one of them")
        radius_m = self._valid(q.Quantity("m", *q.RADII_M, zero=False), radius, (table, CAPSTAN))
        return at_handle(complete, radius_m or _STAND_IN_RADIUS_M), units

    def read(self, tables: Mapping[str, Any], device: Any, units: Units) -> None:
        """Take the tables of a file, with its device as `device_table` gave it.

        Keys get their common names, those of a linear device; texts with units and counts per turn become numbers.
        """
        self.device = units
        # The handle of a rotary device with a capstan goes in a line.
        has_capstan = isinstance(tables.get("device"), Mapping) and CAPSTAN in tables["device"]
        self.rest = LINEAR if has_capstan else units
        without_device = {key: value for key, value in tables.items() if key != "device"}
        self.tables = self.inner(without_device, self.rest, (), (), self._reading)
        if "device" in tables:
            self.tables["device"] = device
        follower = self.tables.get("follower")
        if isinstance(follower, dict) and not self.rest.linear:
            self._counted(follower, ("follower",))
        sources = self.tables.get("sources")
        if isinstance(sources, dict) and COUNTS in sources and not units.linear:
            sources["encoder_resolution_m"] = self._replaced(sources, COUNTS, "encoder_resolution_m", ("sources",))
        detent = self.tables.get("detent")
        if isinstance(detent, dict) and not self.rest.linear:
            self._per_turn(detent, "per_turn", "pitch_m", _DETENTS_PER_TURN, ("detent",))

    def read_joint(self, tables: Mapping[str, Any]) -> None:
        """Take the tables of a file without a device: an inertia, or another key of what turns, says its motion."""
        keys = {key for name in ("simulation", "law") if isinstance(tables.get(name), Mapping) for key in tables[name]}
        units = ROTARY if any(ROTARY.inner(key) != key for key in keys) else LINEAR
        self.read(tables, None, units)
        self.tables["device"] = NoDevice(motion=units.motion, mass_kg=0.0, damping_ns_per_m=0.0)

    def _counted(self, device: dict[str, Any], path: t.Path) -> None:
        """Replace counts per turn of a device and of its range by the encoder's resolution."""
        self._per_turn(device, COUNTS, "encoder_resolution_m", _COUNTS_PER_TURN, path)
        ranges = device.get("range")
        if isinstance(ranges, dict):
            self._per_turn(ranges, COUNTS, "encoder_resolution_m", _COUNTS_PER_TURN, (*path, "range"))

    def _per_turn(
        self, table: dict[str, Any], key: str, name: str, allowed: q.Quantity | q.Whole, path: t.Path
    ) -> None:
        """Replace a number n per turn by the angle 2 pi/n, rad, or both ends of a range of it."""
        if key not in table:
            return
        given = self._replaced(table, key, name, path)
        is_range = isinstance(given, list)
        numbers = [self._valid(allowed, value, (*path, key)) for value in (given if is_range else [given])]
        # The lower end of the numbers is the upper end of the angles.
        angles = [2 * math.pi / number for number in reversed(numbers) if number]
        if len(angles) == len(numbers):
            table[name] = angles if is_range else angles[0]

    def _replaced(self, table: dict[str, Any], key: str, name: str, path: t.Path) -> Any:
        """Take a key out of a table, whose place in the file that of another key then is."""
        if name in table:
            self.fault((*path, key), f"is given with {self._written[*path, name][-1]}; give one of them")
        self._written[*path, name] = (*path, key)
        return table.pop(key)

    def _valid(self, allowed: q.Quantity | q.Whole, value: Any, place: t.Path) -> float | None:
        """Return a valid number; None for a faulty one, whose fault is added."""
        try:
            return allowed(value)
        except PydanticCustomError as error:
            self.fault(place, error.message())
            return None


def _radius_m(device: Mapping[str, Any]) -> float | None:
    """Return the radius of a device's handle or capstan; a fault of it is found where it is read."""
    radii = q.Quantity("m", *q.RADII_M, zero=False)
    return _read_or_none(device.get("handle_radius_m", device.get(CAPSTAN)), "m", radii)


def _read_or_none(value: Any, unit: str, allowed: q.Quantity) -> float | None:
    """Return a number, or a text with a unit as one; None where it is not allowed."""
    with suppress(ValueError, PydanticCustomError):
        return allowed(read_quantity(value, unit) if isinstance(value, str) else value)
    return None


def at_handle(device: Mapping[str, Any], radius_m: float) -> dict[str, Any]:
    """Return a rotary device as the linear one at a handle, which moves `radius_m` per radian."""
    linear: dict[str, Any] = {}
    for key, value in device.items():
        if key in {"motion", "handle_radius_m"}:
            continue
        if isinstance(value, Mapping):
            linear[key] = at_handle(value, radius_m)
        else:
            linear[key] = _scaled(value, power_at_handle(key), radius_m)
    return linear


def _scaled(value: Any, power: int, radius_m: float) -> Any:
    """Return a number, or the ends of a range, times a power of the radius; anything else unchanged."""
    if isinstance(value, list | tuple):
        return [_scaled(item, power, radius_m) for item in value]
    if power == 0 or isinstance(value, bool) or not isinstance(value, int | float):
        return value
    return float(value) * radius_m**power


def overridden(base: Mapping[str, Any], stated: Mapping[str, Any]) -> dict[str, Any]:
    """Override keys of a base device by those that a file states; an overridden value loses its old range."""
    device = dict(base)
    ranges = dict(base.get("range", {}))
    for key, value in stated.items():
        if key == "range":
            continue
        if isinstance(value, Mapping) and isinstance(device.get(key), Mapping):
            device[key] = {**device[key], **value}
            ranges[key] = {inner: ends for inner, ends in ranges.get(key, {}).items() if inner not in value}
        else:
            device[key] = value
            ranges.pop(key, None)
    stated_ranges = stated.get("range", {})
    if not isinstance(stated_ranges, Mapping):
        return {**device, "range": stated_ranges}
    for key, value in stated_ranges.items():
        if isinstance(value, Mapping) and isinstance(ranges.get(key), Mapping):
            ranges[key] = {**ranges[key], **value}
        else:
            ranges[key] = value
    return {**device, "range": ranges}
