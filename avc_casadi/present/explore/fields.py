"""Fields of the page, made from the schema of a problem file: keys, units and slider ends of every value."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from avc_casadi.files.problem_file import problem_document
from avc_casadi.model.ends import Ends
from avc_casadi.model.problem import Problem
from avc_casadi.model.quantity import Quantity, Whole, power_at_handle
from avc_casadi.model.table import Table

_GROUPS = {
    "simulation": "Simulation",
    "follower": "Follower",
    "environment": "Wall",
    "device": "Device",
    "hands": "Hands",
    "device.range": "Ranges of the device",
    "follower.range": "Ranges of the follower",
    "detent": "Detents",
    "boundaries": "Bounds of what feels real",
    "stability": "Stability",
    "frequency": "Frequencies",
}
_OF_WALLS = ("environment", "detent", "boundaries", "stability", "frequency")
_OPEN = ("Simulation", "Follower", "Wall", "Device", "Hands")
_NO_FIELD = ("model_config", "motion", "held", "scope", "spacing", "values_hz")
# Shown in thousandths; largest value of a slider whose value is 0.
_MILLI = {"m": "mm", "s": "ms"}
_USUAL = {"N/m": 1e3, "N.s/m": 10.0, "kg": 1.0, "N": 10.0, "m": 1e-3, "s": 0.1, "Hz": 1e3, "samples": 8.0}
_UNIT = re.compile(r"(_rms)?_(kg|ns_per_m|n_per_m|samples|hz|n|m|s)$")
_ENDS = ("least", "most")


@dataclass(frozen=True)
class Field:
    """One value of a problem on the page; ``factor`` is one of its unit in SI units.

    Values of a pair end in .0 and .1. A slider goes from ``low`` to ``high`` in the field's unit.
    """

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
    folded: bool = False
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


def problem_fields(problem: Problem) -> tuple[Field, ...]:
    """Return the fields of a problem: those of its other end first."""
    tables = problem_document(problem)
    pair = problem.simulation is not None or problem.follower is not None
    found = []
    for name, hint in get_type_hints(Problem, include_extras=True).items():
        there = problem.model_dump()[name] is not None if name in {"simulation", "follower"} else True
        if name in _GROUPS and there and not (pair and name in _OF_WALLS):
            found += list(_fields(problem, name, _table(hint), tables.get(name) or {}))
    order = list(_GROUPS.values())
    return tuple(sorted(found, key=lambda field: order.index(field.group)))


def gain_fields(problem: Problem) -> tuple[Field, ...]:
    """Return the fields of one's own spring and damper; of a law before a wall with a filter of the velocity."""
    device, wall = problem.device, problem.simulation is None and problem.follower is None
    names = ("k", "b", "b_p") if wall else ("K", "B", "local")
    group = f"Your own {names[0]} and {names[1]}"
    size = device.metres_per_unit**2
    stiffness = (problem.environment.stiffness_n_per_m if wall else 0.0) or 1e3 * size
    damping = (stiffness * device.mass_kg) ** 0.5 or size
    spring, damper = Quantity("N/m", 1e-9, 1e12), Quantity("N.s/m", 1e-9, 1e9)
    stated: list[tuple[str, str, Quantity, float | None, str]] = [
        ("stiffness_n_per_m", f"spring {names[0]}", spring, stiffness, ""),
        ("damping_ns_per_m", f"damper {names[1]}", damper, damping, ""),
        ("local_damping_ns_per_m", f"{names[2]} damper, everywhere", damper, None if wall else damping, "none"),
    ]
    if wall:
        stated.append(("cutoff_hz", "filter of the velocity", Quantity("Hz", 1e-6, 1e7), 100.0, "none"))
    return tuple(
        _number(problem, key, group, label, of, value, blank, folded=False) for key, label, of, value, blank in stated
    )


def _table(hint: Any) -> type[Table] | None:
    """Return the class of a table in a hint."""
    kinds = [hint, *get_args(hint)] if get_origin(hint) in (Union, UnionType, None) else []
    return next((one for one in kinds if isinstance(one, type) and issubclass(one, Table)), None)


def _fields(problem: Problem, path: str, model: type[Table] | None, values: Mapping[str, Any]) -> Iterator[Field]:
    linear = problem.units.linear
    for name, hint in get_type_hints(model, include_extras=True).items() if model else ():
        key, inner = f"{path}.{name}", _table(hint)
        if name in _NO_FIELD or (linear and name == "handle_radius_m"):
            continue
        if inner is not None:
            yield from _fields(problem, key, inner, values.get(name) or {})
            continue
        group = next(_GROUPS[one] for one in sorted(_GROUPS, key=len, reverse=True) if f"{key}.".startswith(f"{one}."))
        yield from _of_value(problem, key, group, hint, values.get(name))


def _of_value(problem: Problem, key: str, group: str, hint: Any, value: Any) -> Iterator[Field]:
    parts = list(_flat(hint))
    validators = [one for one in (getattr(part, "func", None) for part in parts) if one is not None]
    label = _label(problem, key, group)
    folded = group not in _OPEN
    if choices := next((get_args(part) for part in parts if get_origin(part) is Literal), ()):
        yield Field(key, group, label, choices=tuple(choices), folded=folded)
        return
    ends = next((one for one in validators if isinstance(one, Ends)), None)
    pair = ends is not None or any(get_origin(part) is tuple for part in parts)
    of = ends.one if ends else next((one for one in validators if isinstance(one, Quantity | Whole)), None)
    if of is None and not key.endswith("_samples"):
        return
    pairs = value or (None, None)
    for end in (0, 1) if pair else ("",):
        mine = pairs[end] if isinstance(end, int) else value
        word = f", {_ENDS[end]}" if isinstance(end, int) else ""
        blank = "rigid" if ends and ends.unbounded and end == 1 else "" if value is not None else "none"
        rigid = ends is not None and mine is not None and mine >= ends.one.highest
        given = None if blank == "rigid" and rigid else mine
        yield _number(problem, f"{key}.{end}".strip("."), group, label + word, of, given, blank, folded=folded)


def _number(
    problem: Problem,
    key: str,
    group: str,
    label: str,
    of: Quantity | Whole | None,
    value: float | None,
    blank: str,
    *,
    folded: bool,
) -> Field:
    unit = of.unit if isinstance(of, Quantity) else "samples" if of is None else ""
    turns = "handle_radius" not in key
    factor = 1e-3 if unit in _MILLI else 1.0
    size = (
        1.0
        if problem.units.linear or not turns
        else problem.device.metres_per_unit ** -power_at_handle(re.sub(r"\.\d$", "", key))
    )
    log = of is not None and value is not None and value > 0
    low, high = (value / 30, value * 30) if log and value else (0.0, size * _USUAL.get(unit, 1.0))
    if of is not None:
        low, high = max(low, of.lowest) if log else low, min(high, of.highest)
    shown = _MILLI.get(unit, unit)
    return Field(
        key,
        group,
        label,
        problem.units.unit(shown) if turns else shown,
        factor,
        float(f"{low / factor:.1g}"),
        float(f"{high / factor:.1g}"),
        log=log,
        whole=isinstance(of, Whole),
        blank=blank,
        folded=folded,
        validator=of,
    )


def _flat(hint: Any) -> Iterator[Any]:
    """Yield a hint and all in it: classes, validators and choices."""
    yield hint
    if get_origin(hint) is not Literal:
        for one in (*get_args(hint), *getattr(hint, "__metadata__", ())):
            yield from _flat(one)


def _label(problem: Problem, key: str, group: str) -> str:
    path = next(name for name, one in _GROUPS.items() if one == group)
    words = [problem.units.key(_UNIT.sub("", part)) for part in key.removeprefix(f"{path}.").split(".")]
    return " ".join(words).replace("_", " ")


def value_of(tables: Mapping[str, Any], field: Field) -> Any:
    """Return the value of a field in the document of a problem; None where it is empty."""
    found: Any = tables
    for part in field.key.split("."):
        found = found[int(part)] if isinstance(found, list | tuple) else found.get(part)
        if found is None:
            return None
    return None if field.blank == "rigid" and found >= field.validator.highest else found  # type: ignore[union-attr]
