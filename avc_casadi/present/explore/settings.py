"""Settings of the page as a validated problem: fields from the schema of a problem file, and values typed anew."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import singledispatch
from typing import Any, Literal, TypeGuard, get_origin, get_type_hints

from pydantic import BaseModel, ValidationError
from pydantic_core import PydanticCustomError

from avc_casadi._errors import AvcError, Fault, InputError
from avc_casadi.files.problem_file import problem_document, problem_of
from avc_casadi.model.admittance import AdmittanceProblem
from avc_casadi.model.annotation import choices_of, inside, tables_of
from avc_casadi.model.control_law import ControlLaw
from avc_casadi.model.device import Device
from avc_casadi.model.ends import End, IntervalOf, Wall
from avc_casadi.model.problem import Problem
from avc_casadi.model.quantity import Quantity, Whole
from avc_casadi.model.table import Table
from avc_casadi.model.unit_text import power_at_handle
from avc_casadi.present.row import quantity_of

Explored = Problem | AdmittanceProblem
"""What a page is about. Its functions are chosen by its end, a `Contact` of an admittance device."""

_SLIDER_FACTOR = 30
"""Ratio of the ends of a logarithmic slider to its value."""

_MILLI = 1e-3
"""Factor of millimetres and milliseconds, in which lengths and times are shown."""

_RIGID_N_PER_M = 1e12
"""Stiffness of a contact whose largest is left empty: rigid."""

_BELOW_NYQUIST = 0.45
"""Highest frequency of a loop that is made slower, cycles a sample."""

_LARGEST_NUMBER = 1e100
"""Size of a number from which on it is none."""

_SLOWEST_SAMPLE_S = 10
"""Longest sample time, s, for which frequencies are made to fit."""

_USUAL_CUTOFF_HZ = 100.0
"""Middle of the slider of the filter of the velocity, Hz."""

_USUAL_STIFFNESS_N_PER_M = 1e3
"""Middle of the slider of a spring without a wall, N/m at the handle."""

_SIGNED_FACTOR = 3
"""Ratio of the ends of the slider of a number of either sign to its value."""

_USUAL = {"N/m/s": 1e4, "N/m": 1e3, "N.s/m": 10.0, "kg": 1.0, "N": 10.0, "m": 1e-3, "s": 0.1, "Hz": 1e3, "samples": 8.0}
"""Largest value of a slider whose value is 0, by unit."""


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
        value: Any = tables
        for part in self.key.split("."):
            value = value[int(part)] if isinstance(value, list | tuple) else value.get(part)
            if value is None:
                return None
        rigid = self.blank == "rigid" and value >= self.validator.highest  # type: ignore[union-attr]
        return None if rigid else value


@singledispatch
def document_of(end: End, problem: Any) -> dict[str, Any]:  # noqa: ARG001
    """Return a problem as JSON values, with its name and every value."""
    return problem_document(problem)


@singledispatch
def read_document(end: End, tables: Mapping[str, Any]) -> Any:  # noqa: ARG001
    """Return the problem of `document_of`, validated."""
    return problem_of(tables, file="")


def problem_fields(problem: Explored) -> tuple[Field, ...]:
    """Return the fields of a problem: those of its other end first."""
    tables, hints = document_of(problem.end, problem), get_type_hints(type(problem), include_extras=True)
    fields: list[Field] = []
    for name in (problem.end_table, "device", "hands"):
        fields += _fields(problem, name, tables_of(hints[name], Table)[0], tables.get(name) or {})
    return tuple(fields)


@singledispatch
def gain_fields(end: End, problem: Any) -> tuple[Field, ...]:  # noqa: ARG001
    """Return the fields of one's own spring and damper to an end."""
    stiffness, damping = _usual_gains(problem, 0.0)
    return _gain_fields(problem, ("K", "B", "local"), (stiffness, damping, damping))


@gain_fields.register
def _law_fields(end: Wall, problem: Problem) -> tuple[Field, ...]:
    """Return the fields of a law before a wall: of the table [law], else k, b, b_p and a filter of the velocity."""
    if problem.law is not None:
        return tuple(_stated_law_fields(problem, problem.law))
    names = ("k", "b", "b_p")
    fields = _gain_fields(problem, names, (*_usual_gains(problem, end.stiffness_n_per_m), None))
    group, cutoff = fields[0].group, Quantity("Hz", 1e-6, 1e7)
    return (*fields, _number(problem, "cutoff_hz", group, "filter of the velocity", cutoff, _USUAL_CUTOFF_HZ, "none"))


_UNIT_ENDING = re.compile(r"(_rms)?_(kg|ns_per_m|n_per_m_s|n_per_m|m_per_s|samples|hz|n|m|s)$")
"""Unit at the end of a key."""


def _stated_law_fields(problem: Problem, law: ControlLaw) -> Iterator[Field]:
    """Yield a field for each number of a table [law]: the gains, those of 0 too, and those of its other pieces."""
    tables: list[tuple[str, str, Any]] = [
        ("", "", law),
        (".velocity", f"velocity, {law.velocity.kind}: ", law.velocity),
    ]
    tables += [(f".filters.{place}", f"{item.kind}: ", item) for place, item in enumerate(law.filters)]
    if law.friction_compensation is not None:
        tables.append((".friction_compensation", "friction compensation: ", law.friction_compensation))
    for path, before, table in tables:
        hints = get_type_hints(type(table), include_extras=True)
        for name, value in table:
            is_number = isinstance(value, int | float) and name != "order"
            for field in of_value(problem, f"law{path}.{name}", hints[name], value) if is_number else ():
                label = problem.units.key(_UNIT_ENDING.sub("", name)).replace("_", " ")
                yield replace(field, group="Your own law", label=f"{before}{label}")


def _usual_gains(problem: Problem, stiffness_n_per_m: float) -> tuple[float, float]:
    """Return spring and damper in the middle of their sliders, of a stiffness or where that is 0 of the usual one."""
    size = problem.device.metres_per_unit**2
    stiffness = stiffness_n_per_m or _USUAL_STIFFNESS_N_PER_M * size
    return stiffness, (stiffness * problem.device.mass_kg) ** 0.5 or size


def _gain_fields(
    problem: Problem, names: tuple[str, str, str], values: tuple[float, float, float | None]
) -> tuple[Field, ...]:
    """Return the fields of a spring, a damper and a damper everywhere, by their names."""
    (spring_name, damper_name, local_name), (stiffness, damping, local_damping) = names, values
    group = f"Your own {spring_name} and {damper_name}"
    spring, damper = Quantity("N/m", 1e-9, 1e12), Quantity("N.s/m", 1e-9, 1e9)
    local_label = f"{local_name} damper, everywhere"
    return (
        _number(problem, "stiffness_n_per_m", group, f"spring {spring_name}", spring, stiffness, ""),
        _number(problem, "damping_ns_per_m", group, f"damper {damper_name}", damper, damping, ""),
        _number(problem, "local_damping_ns_per_m", group, local_label, damper, local_damping, "none"),
    )


def _fields(problem: Explored, path: str, model: type[Table], values: Mapping[str, Any]) -> Iterator[Field]:
    """Yield the fields of a table of the problem and of the tables in it, each with its present value."""
    skipped = {"model_config", "motion", "held", "range", "drive"}
    if problem.units.linear:
        skipped.add("handle_radius_m")
    for name, hint in get_type_hints(model, include_extras=True).items():
        key, inner = f"{path}.{name}", tables_of(hint, Table)
        if name in skipped:
            continue
        if inner:
            yield from _fields(problem, key, inner[0], values.get(name) or {})
        else:
            yield from of_value(problem, key, hint, values.get(name))


def of_value(problem: Explored, key: str, hint: Any, value: Any) -> Iterator[Field]:
    """Yield the field of a value; of a pair its least and its most."""
    table, *names = key.split(".")
    words = [problem.units.key(_UNIT_ENDING.sub("", name)) for name in names]
    group = "Wall" if table == "environment" else table.capitalize()
    label = " ".join(words).replace("_", " ")
    choices = choices_of(hint)
    if choices:
        yield Field(key, group, label, choices=tuple(choices))
        return
    parts = list(inside(hint))
    validators = [getattr(part, "func", None) for part in parts]
    ends = next((validator for validator in validators if isinstance(validator, IntervalOf)), None)
    of_value = next((validator for validator in validators if isinstance(validator, Quantity | Whole)), None)
    read = ends.one if ends else of_value
    if read is None and quantity_of(key) != "samples":
        return
    none = "" if value is not None else "none"
    if ends is None and not any(get_origin(part) is tuple for part in parts):
        yield _number(problem, key, group, label, read, value, none)
        return
    for end, word in enumerate(("least", "most")):
        given = None if value is None else value[end]
        blank = "rigid" if ends and ends.unbounded and end == 1 else none
        if blank == "rigid" and given is not None and given >= ends.one.highest:  # type: ignore[union-attr]
            given = None
        yield _number(problem, f"{key}.{end}", group, f"{label}, {word}", read, given, blank)


def _number(
    problem: Explored, key: str, group: str, label: str, read: Quantity | Whole | None, value: float | None, blank: str
) -> Field:
    """Return the field of a number, whose slider spans a range about its value; `read` is its validator."""
    unit = "" if read is not None else "samples"
    if isinstance(read, Quantity):
        unit = read.unit
    shown = {"m": "mm", "s": "ms"}.get(unit, unit)
    factor = 1.0 if shown == unit else _MILLI
    size = 1.0
    if "handle_radius" not in key:
        shown = problem.units.unit(shown)
        if not problem.units.linear:
            size = problem.device.metres_per_unit ** -power_at_handle(re.sub(r"\.\d$", "", key))
    low, high = 0.0, size * _USUAL.get(unit, 1.0)
    signed = isinstance(read, Quantity) and read.signed
    log = read is not None and not signed and value is not None and value > 0
    if log and value:
        low, high = value / _SLIDER_FACTOR, value * _SLIDER_FACTOR
    if signed:
        high = _SIGNED_FACTOR * abs(value) if value else high
        low = -high
    elif read is not None:
        low, high = max(low, read.lowest) if log else low, min(high, read.highest)
    return Field(
        key=key,
        group=group,
        label=label,
        unit=shown,
        factor=factor,
        low=_one_digit(low / factor),
        high=_one_digit(high / factor),
        log=log,
        whole=isinstance(read, Whole),
        blank=blank,
        validator=read,
    )


def _one_digit(value: float) -> float:
    return float(f"{value:.1g}")


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
        settings = Settings.model_validate(document)
    except ValidationError as error:
        raise RequestError(400, f"settings are an object with {', '.join(Settings.model_fields)}") from error
    known = {"values": {field.key for field in form.fields}, "gains": {field.key for field in form.gains}}
    unknown = [name for part, names in known.items() for name in document[part] if name not in names]
    if unknown or settings.method not in (*form.live, *form.slow):
        raise RequestError(400, f"the page has no {', '.join(unknown) or settings.method}")
    return settings


def gains_of(settings: Settings, form: Form) -> dict[str, float | None]:
    """Return the gains that were typed."""
    faults = []
    gains = dict(settings.gains)
    for field in form.gains:
        value = gains.get(field.key)
        if value is None or field.validator is None:
            continue
        try:
            gains[field.key] = field.validator(value)
        except PydanticCustomError as error:
            faults.append(Fault("", None, field.key, str(error)))
    if faults:
        raise InputError(faults)
    return gains


def problem_of_settings(base: Any, settings: Settings, form: Form, *, to_save: bool = False) -> Any:
    """Return the problem of the settings."""
    tables = document_of(base.end, base)
    # The numbers of a law are of the problem too, as `law.damping_ns_per_m`: they are saved with it.
    own_law = {key: value for key, value in settings.gains.items() if key.split(".")[0] in tables}
    values = settings.values | own_law
    if "device.handle_radius_m" in values:
        _hold_elsewhere(tables, base.device, values["device.handle_radius_m"])
    for key in sorted(values):
        _put(tables, key, values)
    adapt(base.end, tables, base, settings, live=settings.method in form.live, to_save=to_save)
    if values:
        tables["title"] = ", ".join(filter(None, (base.title, "changed")))
        tables["name"] = f"{base.name.replace('/', '-') or 'problem'}-explored"
        tables["source"] = f"avc explore, begun from {base.name}"
    return _checked(tables, settings, form, base)


@singledispatch
def adapt(
    end: End,  # noqa: ARG001
    tables: dict[str, Any],
    base: Any,
    settings: Settings,
    *,
    live: bool,
    to_save: bool,
) -> None:
    """Take along what follows values that were typed: mode, frequencies, boundaries and the scene of the page."""
    if (tables["device"].get("resonance") or {}).get("frequency_hz") is None:
        tables["device"].pop("resonance", None)
    _end_below_nyquist(tables)
    if base.environment.stiffness_n_per_m:
        _scale_boundaries(tables, base)
    if not to_save:
        motion = {"kind": settings.motion} | ({"frequency_hz": 2.0} if settings.motion == "tap" else {})
        tables["scene"] = {"duration_s": 1.5, "motion": motion}
        if live:  # each frequency alone follows at once
            tables["stability"]["scope"], tables["realism"]["require"] = "pointwise", "none"


def _scale_boundaries(tables: dict[str, Any], base: Problem) -> None:
    """Take the boundaries of what feels real along to the stiffness and damping of the wall now."""
    for name in ("upper", "lower"):
        for key, before in base.environment.model_dump().items():
            now = tables["environment"].get(key)
            if before > 0 and isinstance(now, int | float):
                tables["boundaries"][name][key] *= now / before


def _checked(tables: dict[str, Any], settings: Settings, form: Form, base: Explored) -> Any:
    """Return the problem of tables; faults have the keys of their fields, in their units."""
    fields = {field.key: field for field in (*form.fields, *form.gains)}
    try:
        return read_document(base.end, tables)
    except InputError as error:
        faults = error.faults
    of_fields = []
    for fault in faults:
        key = fault.key.replace("[", ".").replace("]", "")
        if f"{key}.0" in fields:  # of a pair the end that was typed
            key = f"{key}.1" if f"{key}.1" in settings.values and f"{key}.0" not in settings.values else f"{key}.0"
        if key in fields:
            of_fields.append(Fault("", None, key, base.units.words(fields[key].fault(fault.message))))
        else:
            of_fields.append(Fault("", None, base.units.key(key), base.units.words(fault.message)))
    raise InputError(of_fields)


def dropped_ranges(base: Explored, settings: Settings, problem: Explored) -> list[str]:
    """Return the keys of values typed anew that have a range in the device's file and none here."""
    before = base.device.range.model_dump(exclude_none=True)
    after = problem.device.range.model_dump(exclude_none=True)
    dropped = {f"device.{key}" for key in before.keys() - after.keys()}
    return [key for key in settings.values if key in dropped]


def _is_number(value: Any) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= _LARGEST_NUMBER


def _put(tables: dict[str, Any], key: str, values: Mapping[str, Any]) -> None:
    """Set a value by its dotted key; None takes it away."""
    value = values[key]
    *path, last = key.split(".")
    end = int(last) if last in {"0", "1"} else None
    if end is not None:
        *path, last = path
    table: Any = tables
    for part in path:
        table = table[int(part)] if isinstance(table, list) else table.setdefault(part, {})
    if end is not None:
        opposite_key = f"{'.'.join((*path, last))}.{1 - end}"
        value = _pair_of(table.get(last), end, value, last, opposite_typed=opposite_key in values)
    if value is None:
        table.pop(last, None)
    else:
        table[last] = value
    ranges: Any = tables[path[0]].get("range") or {}
    for part in path[1:]:
        ranges = ranges.get(part) or {}
    ranges.pop(last, None)


def _pair_of(before: Any, end: int, value: Any, name: str, *, opposite_typed: bool) -> list[Any] | None:
    """Return a pair with a new least (0) or most (1); both are the new one where they were one and nobody typed two.

    An empty end takes the pair away; of the stiffness of a contact it is rigid.
    """
    pair = list(before or (None, None))
    low, high = pair
    if value is None:
        return [low if end else 0.0, _RIGID_N_PER_M] if name == "contact_stiffness_n_per_m" else None
    if (low == high or pair[1 - end] is None) and not opposite_typed:
        return [value] * 2
    pair[end] = value
    return pair


def _end_below_nyquist(tables: dict[str, Any]) -> None:
    """A slower loop has fewer frequencies."""
    frequency, period = tables["frequency"], tables["device"].get("sample_time_s", 1e-3)
    if "values_hz" in frequency or not (_is_number(period) and 0 < period <= _SLOWEST_SAMPLE_S):
        return
    if frequency["stop_hz"] * period >= 0.5:
        frequency["stop_hz"] = float(f"{_BELOW_NYQUIST / period:.3g}")
        frequency["start_hz"] = min(frequency["start_hz"], frequency["stop_hz"] / 10)


def _hold_elsewhere(tables: dict[str, Any], before: Device, radius: Any) -> None:
    """Take hands and bounds of the gains along to the radius at which the device is held now."""
    if before.units.linear or not _is_number(radius) or not radius > 0:
        return
    ratio = radius / before.metres_per_unit
    for table in (tables["hands"], tables.get("coupling", {}), tables.get("contact", {})):
        for key, value in table.items():
            power = power_at_handle(key)
            if power and isinstance(value, list):
                table[key] = [end * ratio**-power for end in value]
