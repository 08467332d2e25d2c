"""Settings of the page as a validated problem: a base, a device of the catalogue, and values typed anew.

The settings are the whole state: they stand in the address of the page and come with every question.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeGuard

from avc_casadi._errors import AvcError, Fault, InputError
from avc_casadi.files.device_file import load_device
from avc_casadi.files.problem_file import problem_document, problem_of
from avc_casadi.model.device import Device
from avc_casadi.model.problem import Problem
from avc_casadi.model.quantity import power_at_handle
from avc_casadi.present.explore.fields import Field

MOTIONS = ("press", "tap", "hold")
_KINDS = {"device": (str, dict, type(None)), "values": dict, "gains": dict, "method": str, "motion": str}
# The page shows six digits: a value typed as it is shown is the value itself.
_SAME = 5e-6
# What answers while a slider moves, in SI units.
_QUICK = {
    "device.sample_time_s": (2e-5, 0.1, "0.02 to 100 ms"),
    "device.delay_samples": (0, 50, "0 to 50 samples"),
    "frequency.points": (1, 5000, "1 to 5000"),
    "simulation.step_s.0": (1e-5, 0.1, "0.01 to 100 ms"),
    "simulation.step_s.1": (1e-5, 0.1, "0.01 to 100 ms"),
}


class RequestError(AvcError):
    """A request that the page would not make: refused with a status of HTTP."""

    def __init__(self, status: int, message: str) -> None:
        super().__init__(message)
        self.status = status


@dataclass(frozen=True)
class Settings:
    """One column of the page."""

    device: str | Mapping[str, Any] | None
    values: Mapping[str, Any]
    gains: Mapping[str, Any]
    method: str
    motion: str

    def key(self, *parts: str) -> str:
        """Return some of the settings as a text: equal settings, equal text."""
        return json.dumps([vars(self)[part] for part in ("device", "values", *parts)], sort_keys=True)


@dataclass(frozen=True)
class Form:
    """What the page asks of a problem: fields, gains of one's own, methods that follow at once and those that run."""

    fields: tuple[Field, ...]
    gains: tuple[Field, ...]
    live: tuple[str, ...]
    slow: tuple[str, ...]


def settings_of(document: Any, form: Form) -> Settings:
    """Read the settings of a request."""
    if not isinstance(document, dict) or set(document) != set(_KINDS):
        raise RequestError(400, f"settings are an object with {', '.join(_KINDS)}")
    for key, kinds in _KINDS.items():
        if not isinstance(document[key], kinds):  # type: ignore[arg-type]
            raise RequestError(400, f"{key} is of another kind")
    found = Settings(**document)
    known = {"values": {field.key for field in form.fields}, "gains": {field.key for field in form.gains}}
    unknown = [name for part, names in known.items() for name in document[part] if name not in names]
    if unknown or found.method not in (*form.live, *form.slow) or found.motion not in MOTIONS:
        raise RequestError(400, f"the page has no {', '.join(unknown) or f'{found.method} or {found.motion}'}")
    return found


def problem_of_settings(base: Problem, settings: Settings, form: Form, *, to_save: bool = False) -> Problem:
    """Return the problem of the settings.

    Bounds of what feels real keep their ratio to the wall. A value typed anew has no range. Frequencies end below
    Nyquist. Hands and bounds of the gains go with the handle of a device that turns. The scene is a press, tap or hold.
    """
    tables, values = problem_document(base), dict(settings.values)
    if settings.device is not None:
        tables["device"] = _device_table(base, settings.device)
    if "device.handle_radius_m" in values:
        tables["device"]["handle_radius_m"] = values.pop("device.handle_radius_m")
    _hold_elsewhere(tables, base.device)
    for key in sorted(values, key=lambda one: (".range." in one, one)):  # ranges are about what was typed
        _put(tables, key, values)
    for outer, name, main in ((tables["device"], "resonance", "frequency_hz"), (tables, "detent", "force_n")):
        if (outer.get(name) or {}).get(main) is None:
            outer.pop(name, None)
    _end_below_nyquist(tables, values)
    for name in ("upper", "lower") if base.environment.stiffness_n_per_m else ():
        for key, before in base.environment.model_dump().items():
            wall = tables["environment"].get(key)
            if before > 0 and isinstance(wall, int | float) and f"boundaries.{name}.{key}" not in values:
                tables["boundaries"][name][key] *= wall / before
    if not to_save:
        motion = {"kind": settings.motion} | ({"frequency_hz": 2.0} if settings.motion == "tap" else {})
        tables["scene"] = {"duration_s": 1.5, "motion": motion}
        if settings.method in form.live:  # each frequency alone follows at once
            tables["stability"]["scope"], tables["realism"]["require"] = "pointwise", "none"
    if settings.values or settings.device is not None:
        device = settings.device if isinstance(settings.device, str) else base.name
        tables |= {"name": f"{device.replace('/', '-') or 'problem'}-explored", "title": f"{base.title}, changed"}
        tables["source"] = f"avc explore, begun from {base.name}"
    return _checked(tables, settings, form, base)


def _checked(tables: dict[str, Any], settings: Settings, form: Form, base: Problem) -> Problem:
    slow = [
        Fault("", None, key, f"takes too long to follow here; allowed on this page: {allowed}")
        for key, (low, high, allowed) in _QUICK.items()
        if _is_number(value := settings.values.get(key)) and not low <= value <= high
    ]
    try:
        problem = problem_of(tables, file="")
    except InputError as error:
        fields = {field.key: field for field in form.fields}
        faults = [_of_field(fault, fields, settings.values, base) for fault in error.faults]
        typed = any(fault.key.startswith("environment.") for fault in faults)
        kept = [one for one in faults if not (typed and one.key.startswith("boundaries."))]
        raise InputError([*kept, *(one for one in slow if one.key not in {fault.key for fault in kept})]) from None
    if slow:
        raise InputError(slow)
    return problem


def _of_field(fault: Fault, fields: Mapping[str, Field], typed: Mapping[str, Any], base: Problem) -> Fault:
    """Return a fault with the key of its field, in its unit; that of a pair at the end that was typed."""
    key = fault.key.replace("[", ".").replace("]", "")
    if f"{key}.0" in fields:
        key = next((end for end in (f"{key}.0", f"{key}.1") if end in typed), f"{key}.0")
    message = fields[key].fault(fault.message) if key in fields else fault.message
    return Fault("", None, key if key in fields else base.units.key(key), base.units.words(message))


def _device_table(base: Problem, device: str | Mapping[str, Any]) -> dict[str, Any]:
    """Return the table of a device that is not that of the base."""
    if isinstance(device, str):
        found = load_device(device).device
    else:
        found = problem_of({"device": device, "environment": base.environment.model_dump()}, file="").device
    require_motion(found, base.device)
    table: dict[str, Any] = found.model_dump(mode="json", exclude_unset=True)
    return table


def require_motion(device: Device, like: Device) -> None:
    """Refuse a device that turns on the page of one that does not, and the other way."""
    if device.motion != like.motion:
        kind, other = ("linear", "knob") if like.units.linear else ("rotary", "figure5")
        message = f"is {device.motion}; allowed here: a {kind} device; for others: avc explore {other}"
        raise InputError.of(message, key="device")


def dropped_ranges(base: Problem, settings: Settings, problem: Problem) -> list[str]:
    """Return the keys of values typed anew that have a range in the device's file and none here."""
    device = problem_document(base)["device"] if settings.device is None else _device_table(base, settings.device)
    before, left = device.get("range") or {}, problem.device.range.model_dump(exclude_none=True)
    names = {key: key.removeprefix("device.") for key in settings.values if key.startswith("device.")}
    return [key for key, name in names.items() if before.get(name) and name not in left]


def _is_number(value: Any) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= 1e100


def _same(value: Any, before: Any) -> bool:
    return _is_number(value) and _is_number(before) and math.isclose(value, before, rel_tol=_SAME)


def _put(tables: dict[str, Any], key: str, values: Mapping[str, Any]) -> None:
    """Set a value by its dotted key; None takes it away, and one that is there already changes nothing."""
    value, (*path, last) = values[key], key.split(".")
    table: Any = tables
    end = int(last) if last in {"0", "1"} else None
    if end is not None:
        *path, last = path
    for part in path:
        table = table.setdefault(part, {})
    before = table.get(last)
    if end is not None:
        nominal = tables["device"].get(last, 0.0) if path[-1] == "range" else None
        low, high = before or (nominal, nominal)
        pair = [low, high]
        if _same(value, pair[end]):
            return
        other = f"{'.'.join((*path, last))}.{1 - end}"
        alone = nominal is None and (low == high or pair[1 - end] is None) and other not in values
        pair[end] = nominal if value is None else value
        table[last] = [pair[end]] * 2 if alone else pair
        if value is None and (nominal is None or pair == [nominal, nominal]):
            table.pop(last)
            if last.startswith("contact_stiffness"):  # empty is rigid
                table[last] = [low if end else 0.0, 1e12]
        return
    if _same(value, before):
        return
    if value is None:
        table.pop(last, None)
    else:
        table[last] = value
    if path[0] == "device":
        ranges: Any = tables["device"].get("range", {})
        for part in path[1:]:
            ranges = ranges.get(part, {})
        ranges.pop(last, None)


def _end_below_nyquist(tables: dict[str, Any], values: Mapping[str, Any]) -> None:
    """A slower loop has fewer frequencies, unless somebody typed which."""
    frequency, period = tables["frequency"], tables["device"].get("sample_time_s", 1e-3)
    if "values_hz" in frequency or "frequency.stop_hz" in values or not (_is_number(period) and 0 < period <= 10):
        return
    if frequency["stop_hz"] * period >= 0.5:
        frequency["stop_hz"] = float(f"{0.45 / period:.3g}")
        if "frequency.start_hz" not in values:
            frequency["start_hz"] = min(frequency["start_hz"], frequency["stop_hz"] / 10)


def _hold_elsewhere(tables: dict[str, Any], before: Device) -> None:
    """Take hands and bounds of the gains along to the radius at which the device is held now."""
    radius = tables["device"].get("handle_radius_m")
    if before.units.linear or not _is_number(radius) or not radius > 0:
        return
    ratio = radius / before.metres_per_unit
    for table in (tables["hands"], tables["coupling"]):
        for key, value in table.items():
            if (power := power_at_handle(key)) and isinstance(value, list):
                table[key] = [end * ratio**-power for end in value]
