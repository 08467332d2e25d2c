"""The border of a file: its keys as the common ones inside, and the faults found there in the words of the file."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from typing import Any, TypeVar

from pydantic_core import PydanticCustomError

from avc_casadi._errors import InputError, UnsupportedError
from avc_casadi._util.units import LINEAR, Units, units_for
from avc_casadi.model import quantity as q
from avc_casadi.model import table as t
from avc_casadi.model.table import UNKNOWN, checked

COUNTS = "encoder_counts_per_turn"
CAPSTAN = "capstan_radius_m"
"""Key of a rotary device with a linear handle: metres per radian."""
M = TypeVar("M", bound=t.Table)


@contextmanager
def in_keys_of(units: Units) -> Iterator[None]:
    """Let faults that are found inside name their keys as a file of this motion does."""
    try:
        yield
    except InputError as error:
        if units.linear:
            raise
        faults = [replace(one, key=units.key(one.key), message=units.words(one.message)) for one in error.faults]
        raise InputError(faults) from error
    except UnsupportedError as error:
        error.key, error.args = units.key(error.key), tuple(units.words(str(one)) for one in error.args)
        raise


class Border:
    """Tables of a file in the common keys, and where each of them stands in the file."""

    def __init__(self) -> None:
        self.tables: dict[str, Any] = {}
        self.device = self.rest = LINEAR
        self._radius_m: float | None = None
        self._findings: dict[t.Path, str] = {}
        self._written: dict[t.Path, t.Path] = {(): ()}

    def fault(self, path: t.Path, message: str) -> None:
        """Add a fault at a path of the file."""
        self._findings.setdefault(path, message)

    def checked(self, model: type[M], name: str) -> M | list[t.Finding]:
        """Return the tables as a model, or all faults, each at its path in the file."""
        found = checked(model, self.tables, name)
        faults: dict[t.Path, str] = {}
        for path, message in found if isinstance(found, list) else ():
            place, text = self._in_file(path, message)
            faults[place] = text if message.startswith(UNKNOWN) else self._findings.get(place, text)
        faults |= {place: text for place, text in self._findings.items() if place not in faults}
        return list(faults.items()) if faults or isinstance(found, list) else found

    def _in_file(self, path: t.Path, message: str) -> t.Finding:
        units = self.device if path[:1] in {("device",), ("sources",), ("gaps",)} else self.rest
        known = next(length for length in range(len(path), -1, -1) if path[:length] in self._written)
        rest = (units.key(part) if isinstance(part, str) else part for part in path[known:])
        if message.startswith(UNKNOWN) and not units.linear and difflib.get_close_matches(str(path[-1]), (COUNTS,)):
            message = f"{message}; did you mean {COUNTS}?"
        return (*self._written[path[:known]], *rest), units.words(message)

    def inner(self, value: Any, units: Units, path: t.Path, written: t.Path, radius_m: float | None = None) -> Any:
        """Return a value of the file with the common keys; texts are read in their units, or in those at a radius."""
        if isinstance(value, list):
            places = ((item, (*path, at), (*written, at)) for at, item in enumerate(value))
            return [self.inner(item, units, inner, place, radius_m) for item, inner, place in places]
        if not isinstance(value, Mapping):
            return value
        radius_m = _radius_m(value) if path == ("follower",) else radius_m
        inner: dict[str, Any] = {}
        for key, item in value.items():
            name, place = units.inner(key), (*written, key)
            if units.key(key) != key:
                self.fault(place, f'is a key of a linear device; allowed: {units.key(key)}, as motion is "rotary"')
                if units.key(key) in value:
                    continue
            self._written[*path, name] = place
            unit = q.unit_of_key(key, units)
            # A mass typed for an inertia may be that of the handle, or of the rotor.
            reach = None if name == "mass_kg" and path[:1] != ("hands",) else radius_m
            typed = self._typed(item, unit, place, reach) if unit else item
            inner[name] = self.inner(typed, units, (*path, name), place, radius_m)
        return inner

    def _typed(self, value: Any, unit: str, place: t.Path, radius_m: float | None) -> Any:
        """Return a text with a unit as the number that it is; anything else unchanged."""
        if isinstance(value, list):
            return [self._typed(item, unit, (*place, index), radius_m) for index, item in enumerate(value)]
        if not isinstance(value, str) or not re.search(r"[^-+.\d\seE]", value):
            return value
        try:
            return q.read_quantity(value, unit, radius_m)
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
                (table, "motion"), f'is {t.shown(motion)}, and that of `from` is "{before}"; allowed: that, or none'
            )
        self._radius_m = None if units.linear else _radius_m({**base, **device})
        own = self.inner(device, units, (table,), (table,), self._radius_m)
        if not units.linear:
            self._counted(own, (table,))
        whole = overridden(base, own)
        if CAPSTAN not in whole:
            return whole, units
        radius = whole.pop(CAPSTAN)
        if units.linear:
            self.fault((table, CAPSTAN), 'says nothing of a linear device; allowed: beside motion = "rotary"')
            return whole, units
        if "handle_radius_m" in whole:
            self.fault((table, "handle_radius_m"), f"stands beside {CAPSTAN}; allowed: one of the two")
        valid = self._valid(q.Quantity("m", *q.RADII_M, zero=False), radius, (table, CAPSTAN))
        return at_handle(whole, valid or 0.01), units  # in place of a faulty one, so that the rest is checked

    def read(self, tables: Mapping[str, Any], device: Any, units: Units) -> None:
        """Take the tables of a file, with its device as `device_table` gave it."""
        self.device = units
        self.rest = LINEAR if isinstance(tables.get("device"), Mapping) and CAPSTAN in tables["device"] else units
        others = {key: value for key, value in tables.items() if key != "device"}
        self.tables = self.inner(others, self.rest, (), (), self._radius_m)
        if "device" in tables:
            self.tables["device"] = device
        detent, follower, sources = (self.tables.get(table) for table in ("detent", "follower", "sources"))
        if isinstance(follower, dict) and not self.rest.linear:
            self._counted(follower, ("follower",))
        if isinstance(sources, dict) and COUNTS in sources and not units.linear:
            sources["encoder_resolution_m"] = self._replaced(sources, COUNTS, "encoder_resolution_m", ("sources",))
        if isinstance(detent, dict) and not self.rest.linear:
            self._per_turn(detent, "per_turn", "pitch_m", q.Whole(1, 100_000), ("detent",))

    def _counted(self, device: dict[str, Any], path: t.Path) -> None:
        counts = q.Quantity("counts", 8, 1e9, zero=False)
        for table, place in ((device, path), (device.get("range"), (*path, "range"))):
            if isinstance(table, dict):
                self._per_turn(table, COUNTS, "encoder_resolution_m", counts, place)

    def _per_turn(
        self, table: dict[str, Any], key: str, name: str, allowed: q.Quantity | q.Whole, path: t.Path
    ) -> None:
        """Replace a number per turn by the angle of one, or both ends of a range of it."""
        if key not in table:
            return
        given = self._replaced(table, key, name, path)
        numbers = [self._valid(allowed, one, (*path, key)) for one in (given if isinstance(given, list) else [given])]
        angles = [2 * math.pi / number for number in reversed(numbers) if number]
        if len(angles) == len(numbers):
            table[name] = angles if isinstance(given, list) else angles[0]

    def _replaced(self, table: dict[str, Any], key: str, name: str, path: t.Path) -> Any:
        """Take a key out of a table, whose place in the file that of another key then is."""
        if name in table:
            self.fault((*path, key), f"stands beside {self._written[*path, name][-1]}; allowed: one of the two")
        self._written[*path, name] = (*path, key)
        return table.pop(key)

    def _valid(self, allowed: q.Quantity | q.Whole, value: Any, place: t.Path) -> float | None:
        try:
            return allowed(value)
        except PydanticCustomError as error:
            self.fault(place, error.message())
            return None


def _radius_m(device: Mapping[str, Any]) -> float | None:
    """Return the radius of a device's handle or capstan; a fault of it is found where it is read."""
    radius = device.get("handle_radius_m", device.get(CAPSTAN))
    with suppress(ValueError, PydanticCustomError):
        radius = q.read_quantity(radius, "m") if isinstance(radius, str) else radius
        return q.Quantity("m", *q.RADII_M, zero=False)(radius)
    return None


def at_handle(device: Mapping[str, Any], radius_m: float) -> dict[str, Any]:
    """Return a rotary device as the linear one at a handle, which moves `radius_m` per radian."""
    return {
        key: at_handle(value, radius_m)
        if isinstance(value, Mapping)
        else _scaled(value, q.power_at_handle(key), radius_m)
        for key, value in device.items()
        if key not in {"motion", "handle_radius_m"}
    }


def _scaled(value: Any, power: int, radius_m: float) -> Any:
    if isinstance(value, list | tuple):
        return [_scaled(item, power, radius_m) for item in value]
    if power == 0 or isinstance(value, bool) or not isinstance(value, int | float):
        return value
    return float(value) * radius_m**power


def overridden(base: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """Override keys of a device; an overridden value loses its old range."""
    whole, ranges = dict(base), dict(base.get("range", {}))
    for key, value in own.items():
        if key == "range":
            continue
        if isinstance(value, Mapping) and isinstance(whole.get(key), Mapping):
            whole[key] = {**whole[key], **value}
            ranges[key] = {inner: ends for inner, ends in ranges.get(key, {}).items() if inner not in value}
        else:
            whole[key] = value
            ranges.pop(key, None)
    given = own.get("range", {})
    if not isinstance(given, Mapping):
        return {**whole, "range": given}
    for key, value in given.items():
        both = isinstance(value, Mapping) and isinstance(ranges.get(key), Mapping)
        ranges[key] = {**ranges[key], **value} if both else value
    return {**whole, "range": ranges}
