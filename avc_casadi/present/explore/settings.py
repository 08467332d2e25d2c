"""Settings of the page as a validated problem: fields from the schema of a problem file, and values typed anew."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeGuard, get_origin, get_type_hints

from pydantic import BaseModel, ValidationError
from pydantic_core import PydanticCustomError

from avc_casadi._errors import AvcError, Fault, InputError
from avc_casadi.files.problem_file import problem_document, problem_of
from avc_casadi.model.device import Device
from avc_casadi.model.ends import Ends
from avc_casadi.model.problem import Problem
from avc_casadi.model.quantity import Quantity, Whole, power_at_handle
from avc_casadi.model.table import Table, choices_of, inside, tables_of

# Largest value of a slider whose value is 0.
_USUAL = {"N/m": 1e3, "N.s/m": 10.0, "kg": 1.0, "N": 10.0, "m": 1e-3, "s": 0.1, "Hz": 1e3, "samples": 8.0}


class RequestError(AvcError):
    """A request that the page would not make: refused with a status of HTTP."""

    def __init__(self, status: int, message: str) -> None:
        super().__init__(message)
        self.status = status


@dataclass(frozen=True)
class Field:
    """One value of a problem on the page; ``factor`` is one of its unit in SI units; .0 and .1 end those of a pair."""

    key: str
    group: str
    label: str
    unit: str = ""
    factor: float = 1.0
    low: float = 0.0
    high: float = 1.0
    log: bool = False
    whole: bool = False
    blank: str = ""
    choices: tuple[str | int, ...] = ()
    validator: Quantity | Whole | None = None

    def document(self) -> dict[str, Any]:
        """Return JSON values."""
        return {key: value for key, value in vars(self).items() if key != "validator"}

    def fault(self, message: str) -> str:
        """Return the message of a fault in the field's unit."""
        if self.factor == 1 or not isinstance(self.validator, Quantity) or self.validator.allowed not in message:
            return message
        ends = self.validator.lowest / self.factor, self.validator.highest / self.factor
        allowed = Quantity(self.unit, *ends, self.validator.zero, self.validator.signed).allowed
        return f"allowed: {allowed} {self.unit}"

    def value(self, tables: Mapping[str, Any]) -> Any:
        """Return its value in the document of a problem; None where it is empty."""
        found: Any = tables
        for part in self.key.split("."):
            found = found[int(part)] if isinstance(found, list | tuple) else found.get(part)
            if found is None:
                return None
        return None if self.blank == "rigid" and found >= self.validator.highest else found  # type: ignore[union-attr]


def problem_fields(problem: Problem) -> tuple[Field, ...]:
    """Return the fields of a problem: those of its other end first."""
    tables, hints, found = problem_document(problem), get_type_hints(Problem, include_extras=True), list[Field]()
    ends = [name for name in ("simulation", "follower") if getattr(problem, name) is not None]
    for name in (*(ends or ["environment"]), "device", "hands"):
        found += _fields(problem, name, tables_of(hints[name])[0], tables.get(name) or {})
    return tuple(found)


def gain_fields(problem: Problem) -> tuple[Field, ...]:
    """Return the fields of one's own spring and damper; of a law before a wall with a filter of the velocity."""
    device, wall = problem.device, problem.simulation is None and problem.follower is None
    names = ("k", "b", "b_p") if wall else ("K", "B", "local")
    group = f"Your own {names[0]} and {names[1]}"
    size = device.metres_per_unit**2
    stiffness = (problem.environment.stiffness_n_per_m if wall else 0.0) or 1e3 * size
    damping = (stiffness * device.mass_kg) ** 0.5 or size
    spring, damper, local = Quantity("N/m", 1e-9, 1e12), Quantity("N.s/m", 1e-9, 1e9), None if wall else damping
    found = [
        _number(problem, "stiffness_n_per_m", group, f"spring {names[0]}", spring, stiffness, ""),
        _number(problem, "damping_ns_per_m", group, f"damper {names[1]}", damper, damping, ""),
        _number(problem, "local_damping_ns_per_m", group, f"{names[2]} damper, everywhere", damper, local, "none"),
    ]
    if wall:
        hz = Quantity("Hz", 1e-6, 1e7)
        found.append(_number(problem, "cutoff_hz", group, "filter of the velocity", hz, 100.0, "none"))
    return tuple(found)


def _fields(problem: Problem, path: str, model: type[Table], values: Mapping[str, Any]) -> Iterator[Field]:
    skipped = {"model_config", "motion", "held", "range"}
    if problem.units.linear:
        skipped.add("handle_radius_m")
    for name, hint in get_type_hints(model, include_extras=True).items():
        key, inner = f"{path}.{name}", tables_of(hint)
        if name in skipped:
            continue
        if inner:
            yield from _fields(problem, key, inner[0], values.get(name) or {})
        else:
            yield from _of_value(problem, key, hint, values.get(name))


def _of_value(problem: Problem, key: str, hint: Any, value: Any) -> Iterator[Field]:
    path = key.partition(".")[0]
    ending = re.compile(r"(_rms)?_(kg|ns_per_m|n_per_m|samples|hz|n|m|s)$")
    words = [problem.units.key(ending.sub("", part)) for part in key.removeprefix(f"{path}.").split(".")]
    group = "Wall" if path == "environment" else path.capitalize()
    label, parts = " ".join(words).replace("_", " "), list(inside(hint))
    validators = [one for one in (getattr(part, "func", None) for part in parts) if one is not None]
    if choices := choices_of(hint):
        yield Field(key, group, label, choices=tuple(choices))
        return
    ends = next((one for one in validators if isinstance(one, Ends)), None)
    of = ends.one if ends else next((one for one in validators if isinstance(one, Quantity | Whole)), None)
    if of is None and not key.endswith("_samples"):
        return
    none = "" if value is not None else "none"
    if ends is None and not any(get_origin(part) is tuple for part in parts):
        yield _number(problem, key, group, label, of, value, none)
        return
    for end, word in enumerate(("least", "most")):
        given = None if value is None else value[end]
        blank = "rigid" if ends and ends.unbounded and end == 1 else none
        if blank == "rigid" and given is not None and given >= ends.one.highest:  # type: ignore[union-attr]
            given = None
        yield _number(problem, f"{key}.{end}", group, f"{label}, {word}", of, given, blank)


def _number(
    problem: Problem, key: str, group: str, label: str, of: Quantity | Whole | None, value: float | None, blank: str
) -> Field:
    unit = of.unit if isinstance(of, Quantity) else "samples" if of is None else ""
    shown, size = {"m": "mm", "s": "ms"}.get(unit, unit), 1.0
    factor = 1.0 if shown == unit else 1e-3
    if "handle_radius" not in key:
        shown = problem.units.unit(shown)
        if not problem.units.linear:
            size = problem.device.metres_per_unit ** -power_at_handle(re.sub(r"\.\d$", "", key))
    log = of is not None and value is not None and value > 0
    low, high = (value / 30, value * 30) if log and value else (0.0, size * _USUAL.get(unit, 1.0))
    if of is not None:
        low, high = max(low, of.lowest) if log else low, min(high, of.highest)
    low, high = (float(f"{end / factor:.1g}") for end in (low, high))
    return Field(key, group, label, shown, factor, low, high, log, isinstance(of, Whole), blank, validator=of)


class Settings(BaseModel, frozen=True, extra="forbid", strict=True):
    """One column of the page."""

    values: dict[str, Any]
    gains: dict[str, Any]
    method: str
    motion: Literal["press", "tap", "hold"]

    def key(self, *parts: str) -> str:
        """Return some of the settings as a text: equal settings, equal text."""
        return json.dumps([vars(self)[part] for part in ("values", *parts)], sort_keys=True)


@dataclass(frozen=True)
class Form:
    """What the page asks of a problem: fields, gains of one's own, methods that follow at once and those that run."""

    fields: tuple[Field, ...]
    gains: tuple[Field, ...]
    live: tuple[str, ...]
    slow: tuple[str, ...]


def settings_of(document: Any, form: Form) -> Settings:
    """Read the settings of a request."""
    try:
        found = Settings.model_validate(document)
    except ValidationError as error:
        raise RequestError(400, f"settings are an object with {', '.join(Settings.model_fields)}") from error
    known = {"values": {field.key for field in form.fields}, "gains": {field.key for field in form.gains}}
    unknown = [name for part, names in known.items() for name in document[part] if name not in names]
    if unknown or found.method not in (*form.live, *form.slow):
        raise RequestError(400, f"the page has no {', '.join(unknown) or found.method}")
    return found


def gains_of(settings: Settings, form: Form) -> dict[str, float | None]:
    """Return the gains that were typed."""
    faults, found = [], dict(settings.gains)
    for field in form.gains:
        value, read = found.get(field.key), field.validator
        try:
            found |= {} if value is None or read is None else {field.key: read(value)}
        except PydanticCustomError as error:
            faults.append(Fault("", None, field.key, str(error)))
    if faults:
        raise InputError(faults)
    return found


def problem_of_settings(base: Problem, settings: Settings, form: Form, *, to_save: bool = False) -> Problem:
    """Return the problem of the settings."""
    tables, values = problem_document(base), settings.values
    _hold_elsewhere(tables, base.device, values.get("device.handle_radius_m"))
    for key in sorted(values):
        _put(tables, key, values)
    if (tables["device"].get("resonance") or {}).get("frequency_hz") is None:
        tables["device"].pop("resonance", None)
    _end_below_nyquist(tables)
    for name in ("upper", "lower") if base.environment.stiffness_n_per_m else ():
        for key, before in base.environment.model_dump().items():
            wall = tables["environment"].get(key)
            if before > 0 and isinstance(wall, int | float):
                tables["boundaries"][name][key] *= wall / before
    if not to_save:
        motion = {"kind": settings.motion} | ({"frequency_hz": 2.0} if settings.motion == "tap" else {})
        tables["scene"] = {"duration_s": 1.5, "motion": motion}
        if settings.method in form.live:  # each frequency alone follows at once
            tables["stability"]["scope"], tables["realism"]["require"] = "pointwise", "none"
    if settings.values:
        tables["title"] = ", ".join(filter(None, (base.title, "changed")))
        tables["name"] = f"{base.name.replace('/', '-') or 'problem'}-explored"
        tables["source"] = f"avc explore, begun from {base.name}"
    return _checked(tables, settings, form, base)


def _checked(tables: dict[str, Any], settings: Settings, form: Form, base: Problem) -> Problem:
    """Return the problem of tables; faults have the keys of their fields, in their units."""
    fields, found = {field.key: field for field in form.fields}, []
    try:
        return problem_of(tables, file="")
    except InputError as error:
        faults = error.faults
    for fault in faults:
        key = fault.key.replace("[", ".").replace("]", "")
        if f"{key}.0" in fields:  # of a pair the end that was typed
            key = f"{key}.1" if f"{key}.1" in settings.values and f"{key}.0" not in settings.values else f"{key}.0"
        message = base.units.words(fields[key].fault(fault.message) if key in fields else fault.message)
        found.append(Fault("", None, key if key in fields else base.units.key(key), message))
    raise InputError(found)


def dropped_ranges(base: Problem, settings: Settings, problem: Problem) -> list[str]:
    """Return the keys of values typed anew that have a range in the device's file and none here."""
    before, after = (one.device.range.model_dump(exclude_none=True) for one in (base, problem))
    return [key for key in settings.values if key.removeprefix("device.") in before.keys() - after.keys()]


def _is_number(value: Any) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= 1e100


def _put(tables: dict[str, Any], key: str, values: Mapping[str, Any]) -> None:
    """Set a value by its dotted key; None takes it away."""
    value, (*path, last) = values[key], key.split(".")
    table: Any = tables
    end = int(last) if last in {"0", "1"} else None
    if end is not None:
        *path, last = path
    for part in path:
        table = table.setdefault(part, {})
    if end is not None:
        low, high = pair = list(table.get(last) or (None, None))
        other = f"{'.'.join((*path, last))}.{1 - end}"
        alone = (low == high or pair[1 - end] is None) and other not in values
        pair[end] = value
        if value is not None:
            value = [value] * 2 if alone else pair
        elif last.startswith("contact_stiffness"):  # empty is rigid
            value = [low if end else 0.0, 1e12]
    if value is None:
        table.pop(last, None)
    else:
        table[last] = value
    ranges: Any = tables[path[0]].get("range") or {}
    for part in path[1:]:
        ranges = ranges.get(part) or {}
    ranges.pop(last, None)


def _end_below_nyquist(tables: dict[str, Any]) -> None:
    """A slower loop has fewer frequencies."""
    frequency, period = tables["frequency"], tables["device"].get("sample_time_s", 1e-3)
    if "values_hz" in frequency or not (_is_number(period) and 0 < period <= 10):
        return
    if frequency["stop_hz"] * period >= 0.5:
        frequency["stop_hz"] = float(f"{0.45 / period:.3g}")
        frequency["start_hz"] = min(frequency["start_hz"], frequency["stop_hz"] / 10)


def _hold_elsewhere(tables: dict[str, Any], before: Device, radius: Any) -> None:
    """Take hands and bounds of the gains along to the radius at which the device is held now."""
    if before.units.linear or not _is_number(radius) or not radius > 0:
        return
    ratio = radius / before.metres_per_unit
    for table in (tables["hands"], tables["coupling"]):
        for key, value in table.items():
            if (power := power_at_handle(key)) and isinstance(value, list):
                table[key] = [end * ratio**-power for end in value]
