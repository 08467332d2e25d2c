"""The settings of the page as a validated problem: a base, a device of the catalogue, and the values that were changed.

The settings are the whole state: they stand in the address of the page and come with every request.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from avc_casadi._errors import Fault, InputError
from avc_casadi.coupling import Gains
from avc_casadi.explore._fields import FIELDS, KEYS
from avc_casadi.explore._requests import RequestError
from avc_casadi.problem import Problem, load_device, problem_document, problem_of

LiveMethod = Literal["direct", "closed-form", "exact", "constant"]
LIVE: tuple[str, ...] = ("direct", "closed-form", "exact", "constant")
"""Methods that are quick enough to follow a slider."""
SLOW: tuple[str, ...] = ("recommend", "robust", "static", "static-tuned", "schedule")
"""Methods that run beside the page, and can be cancelled."""
GAINS = ("damping_ns_per_m", "stiffness_n_per_m", "contact_damping_ns_per_m")
_SCENES = ("press", "tap", "hold")
# What the page can follow, in SI units and in the page's.
_FOLLOWED = {
    "device.sample_time_s": (2e-5, 0.1, "0.02 to 100 ms"),
    "device.delay_samples": (0, 50, "0 to 50 samples"),
    "frequency.points": (1, 5000, "1 to 5000"),
}


@dataclass(frozen=True)
class Settings:
    """One column of the page.

    Attributes:
        device: name of a device of the catalogue; None keeps that of the base.
        values: dotted key to value, in SI units, as far as they were changed; None stands for a value left out.
        method: one of `LIVE` and `SLOW`.
        gains: b, k and b_p of the method constant.
        motion: what the hand does in the simulated touch.
    """

    device: str | None
    values: Mapping[str, Any]
    method: str
    gains: Mapping[str, Any]
    motion: str

    @property
    def key(self) -> str:
        """The settings as a text: equal settings, equal text."""
        return json.dumps(vars(self), sort_keys=True, default=dict)

    @property
    def stated(self) -> str:
        """The part of them that makes the problem, as a text."""
        return json.dumps([self.device, dict(self.values), self.motion], sort_keys=True)


def settings_of(document: Any) -> Settings:
    """Read the settings of a request.

    Raises:
        RequestError: it is none, or names what the page does not have.
    """
    if not isinstance(document, dict) or not set(document) <= {"device", "values", "method", "gains", "motion"}:
        raise RequestError(400, "settings are an object with device, values, method, gains and motion")
    values, gains = document.get("values", {}), document.get("gains", {})
    found = Settings(
        document.get("device"), values, document.get("method", "direct"), gains, document.get("motion", "press")
    )
    wrong = [
        what
        for what, right in (
            ("device is a name or null", found.device is None or isinstance(found.device, str)),
            ("values name fields of the page", isinstance(values, dict) and set(values) <= KEYS),
            ("gains name b, k and b_p", isinstance(gains, dict) and set(gains) <= set(GAINS)),
            ("method is one of the page", found.method in (*LIVE, *SLOW)),
            ("motion is press, tap or hold", found.motion in _SCENES),
        )
        if not right
    ]
    if wrong:
        raise RequestError(400, "; ".join(wrong))
    return found


def problem_of_settings(base: Problem, settings: Settings) -> Problem:
    """Return the problem that the settings mean.

    The bounds of what feels real keep their ratio to the wall. A value that is given anew is no longer in doubt as the
    old one was: its range goes. The scene is a press, a tap or a hold with all that the device declares.

    Args:
        base: what was started with.
        settings: the changes.

    Raises:
        InputError: with every fault, each under the key of its field.
    """
    tables = problem_document(base)
    if settings.device is not None:
        tables["device"] = load_device(settings.device).device.model_dump(mode="json", exclude_unset=True)
    for key, value in settings.values.items():
        _put(tables, key, value)
    _mend_resonance(tables["device"], settings.values)
    if "measured" not in tables["boundaries"]:
        _scale_bounds(tables["boundaries"], base, tables["environment"])
    if tables["coupling"].get("structure") == "damped" and tables["coupling"]["contact_damping_ns_per_m"] == [0.0, 0.0]:
        tables["coupling"]["contact_damping_ns_per_m"] = [0.0, tables["coupling"]["damping_ns_per_m"][1]]
    motion = {"kind": settings.motion} | ({"frequency_hz": 2.0} if settings.motion == "tap" else {})
    tables["scene"] = {"duration_s": 1.5, "motion": motion}
    tables["stability"]["scope"] = "pointwise" if settings.method in LIVE else tables["stability"]["scope"]
    faults = [*_gain_faults(settings), *_too_long_to_follow(settings)]
    try:
        problem = problem_of(tables | {"name": base.name}, file="")
    except InputError as error:
        raise InputError([*_with_field(error), *faults]) from None
    if faults:
        raise InputError(faults)
    return problem


def constant_gains(settings: Settings) -> Gains:
    """Return the gains that were typed, b, k and b_p; those left out are 0."""
    return Gains(*(float(settings.gains.get(name, 0.0)) for name in GAINS))


def values_of(problem: Problem) -> dict[str, Any]:
    """Return the value of every field, in SI units; None where the problem has none."""
    tables = problem_document(problem)
    return {field.key: _get(tables, field.key) for field in FIELDS}


def _gain_faults(settings: Settings) -> Iterator[Fault]:
    if settings.method != "constant":
        return
    for name, value in settings.gains.items():
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not (number and math.isfinite(value) and 0 <= value <= 1e12):
            yield Fault("", None, f"gains.{name}", f"is {value!r}; allowed: a number from 0 to 1e12")


def _too_long_to_follow(settings: Settings) -> Iterator[Fault]:
    """What a problem file may say, and a page that follows at once cannot answer."""
    for key, (low, high, allowed) in _FOLLOWED.items():
        value = settings.values.get(key)
        if isinstance(value, int | float) and not isinstance(value, bool) and not low <= value <= high:
            yield Fault("", None, key, f"takes too long to follow here; allowed on this page: {allowed}")


def _with_field(error: InputError) -> Iterator[Fault]:
    """Give a fault of a pair to the field of its first place; bounds that only follow the wall are its fault alone."""
    of_wall = any(fault.key.startswith("environment.") for fault in error.faults)
    for fault in error.faults:
        if of_wall and fault.key.startswith("boundaries."):
            continue
        key = fault.key if fault.key in KEYS else f"{fault.key}.0"
        yield Fault("", None, key if key in KEYS else fault.key, fault.message)


def _put(tables: dict[str, Any], key: str, value: Any) -> None:
    """Set a value by its dotted key; None takes it away."""
    *path, last = key.split(".")
    table: Any = tables
    for part in path:
        table = table.setdefault(part, {})
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


def _get(tables: Any, key: str) -> Any:
    for part in key.split("."):
        tables = tables[int(part)] if isinstance(tables, list) else tables.get(part)
        if tables is None:
            return None
    return tables


def _mend_resonance(device: dict[str, Any], values: Mapping[str, Any]) -> None:
    """A resonance is there with its frequency, and its other numbers have a value to start from."""
    table = device.get("resonance", {})
    if table.get("frequency_hz") is None:
        device.pop("resonance", None)
        device.get("range", {}).pop("resonance", None)
        return
    for field in FIELDS:
        if field.start is not None and values.get(field.key) is None:
            table.setdefault(field.key.rpartition(".")[2], field.start)


def _scale_bounds(bounds: dict[str, Any], base: Problem, wall: Mapping[str, Any]) -> None:
    for name in ("upper", "lower"):
        for key, before in base.environment.model_dump().items():
            if before > 0 and isinstance(wall.get(key), int | float):
                bounds[name][key] *= wall[key] / before
