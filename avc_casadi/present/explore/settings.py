"""The settings of the page as a validated problem: a base, a device of the catalogue, and the values that were changed.

The settings are the whole state: they stand in the address of the page and come with every request.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, TypeGuard

from avc_casadi._errors import Fault, InputError
from avc_casadi.files.device_file import load_device
from avc_casadi.files.problem_file import problem_document, problem_of
from avc_casadi.model.device import Device
from avc_casadi.model.problem import Problem
from avc_casadi.model.quantity import power_at_handle
from avc_casadi.present.explore.fields import HANDLE, RANGES, field_faults, fields_for
from avc_casadi.present.explore.forms import WALL, Form, form_of
from avc_casadi.present.explore.requests import RequestError
from avc_casadi.present.explore.tool_fields import STEP, put_of_tool, value_of_tool

_SCENES = ("press", "tap", "hold")
_TOLD = 40
# The page shows six digits: what is typed as it is shown is the value itself.
_SAME = 5e-6
_NYQUIST, _BELOW_NYQUIST, _LONGEST_S = 0.5, 0.45, 10.0
# What the page can follow, in SI units and in the page's.
_FOLLOWED = {
    "device.sample_time_s": (2e-5, 0.1, "0.02 to 100 ms"),
    "device.delay_samples": (0, 50, "0 to 50 samples"),
    "frequency.points": (1, 5000, "1 to 5000"),
    f"{STEP}.0": (1e-5, 0.1, "0.01 to 100 ms"),
    f"{STEP}.1": (1e-5, 0.1, "0.01 to 100 ms"),
}
_TOOL, _SPRING = "simulation.", "stiffness_n_per_m"


@dataclass(frozen=True)
class Settings:
    """One column of the page."""

    device: str | Mapping[str, Any] | None
    values: Mapping[str, Any]
    method: str
    gains: Mapping[str, Any]
    motion: str
    own: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    @property
    def key(self) -> str:
        """The settings as a text: equal settings, equal text."""
        coupling = {key: value for key, value in vars(self).items() if key != "own"}
        return json.dumps(coupling, sort_keys=True, default=dict)

    @property
    def stated(self) -> str:
        """The part of them that makes the problem, as a text."""
        return json.dumps([self.device, dict(self.values), self.motion], sort_keys=True)

    @property
    def run(self) -> str:
        """The part of them that a run depends on, as a text: the touch that is shown is none of it."""
        return json.dumps([self.method, self.device, dict(self.values)], sort_keys=True)


def settings_of(document: Any, form: Form = WALL) -> Settings:
    """Read the settings of a request."""
    if not isinstance(document, dict) or not set(document) <= {"device", "values", "method", "gains", "motion", "own"}:
        raise RequestError(400, "settings are an object with device, values, method, gains, motion and own")
    values, gains, own = (document.get(key, {}) for key in ("values", "gains", "own"))
    method, motion = document.get("method", form.live[0]), document.get("motion", "press")
    found = Settings(document.get("device"), values, method, gains, motion, own)
    wrong = [
        what
        for what, right in (
            ("device is a name, a table or null", found.device is None or isinstance(found.device, str | dict)),
            ("values name fields of the page", isinstance(values, dict) and set(values) <= form.keys),
            ("gains name those of the page", isinstance(gains, dict) and set(gains) <= set(form.gain_names)),
            ("own names those of the page", isinstance(own, dict) and set(own) <= set(form.own_names)),
            ("method is one of the page", found.method in (*form.live, *form.slow)),
            ("motion is press, tap or hold", found.motion in _SCENES),
        )
        if not right
    ]
    if wrong:
        raise RequestError(400, "; ".join(wrong))
    return found


def problem_of_settings(base: Problem, settings: Settings, *, to_save: bool = False) -> Problem:
    """Return the problem that the settings mean.

    The bounds of what feels real keep their ratio to the wall, as far as they were not typed. A value that is given
    anew is no longer in doubt as the old one was: its range goes, unless that is typed too. Frequencies end below
    Nyquist. Hands and bounds of the gains go with the handle of a device that turns, where it is held elsewhere. The
    scene is a press, a tap or a hold with all that the device declares.
    """
    tables = problem_document(base)
    if settings.device is not None:
        tables["device"] = _device_table(base, settings.device)
    tables["device"].update({"handle_radius_m": settings.values[HANDLE]} if HANDLE in settings.values else {})
    _hold_elsewhere(tables, base.device)
    # Ranges last, about what is typed; the lower end before the upper one.
    for key in sorted(settings.values, key=lambda one: (one.startswith(RANGES), one)):
        _put(tables, key, settings.values[key])
    _mend_started(tables, tables["device"], "resonance", "frequency_hz", base.device)
    _mend_started(tables, tables, "detent", "force_n", base.device)
    _end_below_nyquist(tables, settings.values)
    _scale_bounds(tables, base, settings.values)
    if tables["coupling"].get("structure") == "damped" and tables["coupling"]["contact_damping_ns_per_m"] == [0.0, 0.0]:
        tables["coupling"]["contact_damping_ns_per_m"] = [0.0, tables["coupling"]["damping_ns_per_m"][1]]
    if not to_save:
        _set_followed(tables, settings)
    own = [*_gain_faults(settings, base), *_too_long_to_follow(settings)]
    try:
        problem = problem_of(tables | _headed(base, settings, tables["environment"]), file="")
    except InputError as error:
        told = list(field_faults(error.faults, settings.values, base.device, form_of(base).fields))
        raise InputError([*told, *(one for one in own if one.key not in {fault.key for fault in told})]) from None
    if own:
        raise InputError(own)
    return problem


def _headed(base: Problem, settings: Settings, wall: Mapping[str, Any]) -> dict[str, str]:
    """Return name, title and source: those of the base where it is the base."""
    if not settings.values and settings.device is None:
        return {"name": base.name, "title": base.title, "source": base.source}
    device = settings.device if isinstance(settings.device, str) else "" if settings.device is None else "device-file"
    stiffness = wall.get("stiffness_n_per_m")
    of = f" of {stiffness:g} {base.units.unit('N/m')}" if isinstance(stiffness, int | float) else ""
    what = "Simulation" if base.simulation is not None else f"Wall{of}"
    return {
        "name": f"{(device or base.name).replace('/', '-') or 'problem'}-explored",
        "title": f"{what} for {device or f'the device of {base.name}'}",
        "source": f"avc explore, begun from {base.name}",
    }


def _set_followed(tables: dict[str, Any], settings: Settings) -> None:
    """Set what the page has of its own: a scene, and each frequency alone where gains follow at once."""
    motion = {"kind": settings.motion} | ({"frequency_hz": 2.0} if settings.motion == "tap" else {})
    tables["scene"] = {"duration_s": 1.5, "motion": motion}
    if settings.method in WALL.live:
        tables["stability"]["scope"], tables["realism"]["require"] = "pointwise", "none"


def constant_gains(settings: Settings, form: Form) -> dict[str, float]:
    """Return the gains that were typed, by name; those left out are 0."""
    return {name: float(settings.gains.get(name, 0.0)) for name in form.gain_names}


def values_of(problem: Problem) -> dict[str, Any]:
    """Return the value of every field, in SI units; None where the problem has none."""
    tables = problem_document(problem)
    return {
        field.key: value_of_tool(tables["simulation"], field.key.removeprefix(_TOOL))
        if field.key.startswith(_TOOL)
        else _get(tables, field.key)
        for field in fields_for(problem.device, form_of(problem).fields)
    }


def kept_of(problem: Problem) -> list[str]:
    """Return what the problem says otherwise than by default and the page has no field for, as a problem file would."""
    device: dict[str, Any] = {"mass_kg": 0.0, "damping_ns_per_m": 0.0}
    if not problem.units.linear:
        device |= {"motion": problem.device.motion, "handle_radius_m": problem.device.handle_radius_m}
    plainest = {"device": device, "environment": problem.environment}
    default = dict(_flat(problem_document(Problem.model_validate(plainest))))
    found = {key: json.dumps(value) for key, value in _flat(problem_document(problem)) if default.get(key) != value}
    return [
        f"{problem.units.key(key)} = {text if len(text) <= _TOLD else f'{text[:_TOLD]} ...'}"
        for key, text in found.items()
        if not _has_field(key, form_of(problem))
    ]


def _has_field(key: str, form: Form) -> bool:
    return key in form.keys or f"{key}.0" in form.keys or key.partition(".")[0] in {"name", "title", "source", "scene"}


def _flat(tables: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in tables.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


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
    if device.motion == like.motion:
        return
    if like.units.linear:
        message = "turns; allowed here: a linear device, or one with capstan_radius_m; for knobs: avc explore knob"
    else:
        message = "moves in a line; allowed here: a device that turns; for others: avc explore figure5"
    raise InputError.of(message, key="device")


def _gain_faults(settings: Settings, base: Problem) -> Iterator[Fault]:
    if settings.method != "constant":
        return
    for name, value in settings.gains.items():
        unit = base.units.unit("N/m" if name == _SPRING else "N.s/m")
        if not (_is_number(value) and math.isfinite(value) and 0 <= value <= 1e12):
            yield Fault("", None, f"gains.{name}", f"is {value!r}; allowed: a number from 0 to 1e12 {unit}")
    if not any(settings.gains.values()):
        first, second = (field.label for field in form_of(base).gains if field.key != f"gains.{_SPRING}")
        allowed = f"a number above 0, here, for {first} or {second}"
        message = f"is missing: without gains no force is rendered; allowed: {allowed}"
        yield Fault("", None, f"gains.{_SPRING}", message)


def dropped_ranges(base: Problem, settings: Settings, problem: Problem) -> list[dict[str, Any]]:
    """Return the ranges of the device that a value typed anew has taken the place of, each with its key."""
    device = problem_document(base)["device"] if settings.device is None else _device_table(base, settings.device)
    left = problem_document(problem)["device"].get("range", {})
    return [
        {"key": key, "low": both[0], "high": both[1]}
        for key in settings.values
        if key.startswith("device.") and not key.startswith(RANGES)
        for both in [_get(device.get("range") or {}, key.removeprefix("device."))]
        if both and _get(left, key.removeprefix("device.")) is None
    ]


def _is_number(value: Any) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _too_long_to_follow(settings: Settings) -> Iterator[Fault]:
    """What a problem file may say, and a page that follows at once cannot answer."""
    for key, (low, high, allowed) in _FOLLOWED.items():
        value = settings.values.get(key)
        if _is_number(value) and not low <= value <= high:
            yield Fault("", None, key, f"takes too long to follow here; allowed on this page: {allowed}")


def _put(tables: dict[str, Any], key: str, value: Any) -> None:
    """Set a value by its dotted key; None takes it away, and one that is there already changes nothing."""
    if key.startswith(RANGES):
        _put_end(tables["device"], key.removeprefix(RANGES), value)
        return
    if key.startswith(_TOOL):
        if not _same(value, value_of_tool(tables["simulation"], key.removeprefix(_TOOL))):
            put_of_tool(tables["simulation"], key.removeprefix(_TOOL), value)
        return
    *path, last = key.split(".")
    table: Any = tables
    for part in path:
        table = table.setdefault(part, {})
    if _same(value, _get(table, last)):
        return
    if isinstance(table, list):
        table[int(last)] = value
    elif value is None:
        table.pop(last, None)
    else:
        table[last] = value
    if path[0] == "device":
        ranges: Any = tables["device"].get("range", {})
        for part in path[1:]:
            ranges = ranges.get(part, {})
        ranges.pop(last, None)


def _same(value: Any, before: Any) -> bool:
    """Whether a value that was typed is the one before, as it is shown."""
    return _is_number(value) and _is_number(before) and math.isclose(value, before, rel_tol=_SAME)


def _put_end(device: dict[str, Any], key: str, value: Any) -> None:
    """Set an end of a range; the other, and one that is left out, is the value itself."""
    name, _, end = key.partition(".")
    ranges, nominal = device.setdefault("range", {}), device.get(name, 0.0)
    both = list(ranges.get(name) or (nominal, nominal))
    both[int(end)] = nominal if value is None else value
    ranges[name] = both
    if both == [nominal, nominal]:
        del ranges[name]


def _end_below_nyquist(tables: dict[str, Any], values: Mapping[str, Any]) -> None:
    """A slower loop has fewer frequencies, unless somebody typed which."""
    frequency, period = tables["frequency"], tables["device"].get("sample_time_s", 1e-3)
    if "values_hz" in frequency or "frequency.stop_hz" in values:
        return
    if isinstance(period, int | float) and 0 < period <= _LONGEST_S and frequency["stop_hz"] * period >= _NYQUIST:
        frequency["stop_hz"] = float(f"{_BELOW_NYQUIST / period:.3g}")
        frequency["start_hz"] = min(frequency["start_hz"], frequency["stop_hz"] / 10)


def _get(tables: Any, key: str) -> Any:
    for part in key.split("."):
        tables = tables[int(part)] if isinstance(tables, list) else tables.get(part)
        if tables is None:
            return None
    return tables


def _hold_elsewhere(tables: dict[str, Any], before: Device) -> None:
    """Take hands and bounds of the gains along to the radius at which the device is held now."""
    radius = tables["device"].get("handle_radius_m")
    if before.units.linear or isinstance(radius, bool) or not isinstance(radius, int | float) or not radius > 0:
        return
    ratio = radius / before.metres_per_unit
    if ratio == 1:
        return
    for table in (tables["hands"], tables["coupling"]):
        for key, value in table.items():
            power = power_at_handle(key)
            if power and isinstance(value, list):
                table[key] = [end * ratio**-power for end in value]


def _mend_started(tables: dict[str, Any], outer: dict[str, Any], name: str, main: str, device: Device) -> None:
    """A resonance is there with its frequency, detents with their force; other numbers have a value to start from."""
    table = outer.get(name) or {}
    if table.get(main) is None:
        outer.pop(name, None)
        tables["device"].get("range", {}).pop(name, None)
        return
    for field in fields_for(device, WALL.fields):
        *path, last = field.key.split(".")
        if field.start is not None and path[-1] == name and table.get(last) is None:
            table[last] = field.start


def _scale_bounds(tables: dict[str, Any], base: Problem, values: Mapping[str, Any]) -> None:
    for name in ("upper", "lower"):
        for key, before in base.environment.model_dump().items():
            wall = tables["environment"].get(key)
            if before > 0 and isinstance(wall, int | float) and f"boundaries.{name}.{key}" not in values:
                tables["boundaries"][name][key] *= wall / before
