"""Rules between the values of a problem, each checked wherever the values that it needs are sound."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Collection, Iterator, Mapping
from typing import Any

from pydantic import BaseModel

from avc_casadi.problem._quantity import plain, shown

Path = tuple[str | int, ...]
Finding = tuple[Path, str]

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]{1,60}")

# Closer frequencies would coincide after rounding.
_SMALLEST_STEP = 1e-12


def dotted(path: Path) -> str:
    """Write a path as a user does: ``scene.effects[0].mass_kg``."""
    text = ""
    for part in path:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            text += f".{part}" if _BARE_KEY.fullmatch(part) else f".{shown(part)}"
    return text.removeprefix(".")


class UnsoundError(LookupError):
    """A rule asked for a value that is faulty or missing; its own fault is told elsewhere."""


class Values:
    """Read access to a problem, whether a model or the tables of a file with faults in it."""

    def __init__(
        self, problem: Mapping[str, Any] | BaseModel, model: type[BaseModel], faulty: Collection[Path] = ()
    ):
        self._problem = problem
        self._model = model
        self._faulty = faulty

    def given(self, *path: str) -> bool:
        """Whether the value was written down, rather than a default."""
        node: Any = self._problem
        for key in path:
            keys = node.model_fields_set if isinstance(node, BaseModel) else node
            if not isinstance(keys, Mapping | set) or key not in keys:
                return False
            node = getattr(node, key) if isinstance(node, BaseModel) else node[key]
        return True

    def __getitem__(self, path: str) -> Any:
        """Return the value at a dotted path, a default where it is left out.

        Raises:
            UnsoundError: the value is faulty, or missing and without a default.
        """
        keys = tuple(path.split("."))
        if any(keys[: len(bad)] == bad[: len(keys)] for bad in self._faulty):
            raise UnsoundError(path)
        node: Any = self._problem
        model: Any = self._model
        for key in keys:
            field = model.model_fields[key]
            if isinstance(node, Mapping) and key not in node:
                if field.is_required() or field.default_factory is not None:
                    raise UnsoundError(path)
                node = field.default
            else:
                node = getattr(node, key) if isinstance(node, BaseModel) else node[key]
            model = field.annotation
        return node


def broken_rules(values: Values) -> list[Finding]:
    """Return every broken rule among those whose values are sound."""
    findings: list[Finding] = []
    for rule in _RULES:
        try:
            findings.extend(rule(values))
        except UnsoundError:
            continue
    return findings


def _bounds(quantity: str) -> Callable[[Values], Iterator[Finding]]:
    def rule(values: Values) -> Iterator[Finding]:
        upper, lower = values[f"boundaries.upper.{quantity}"], values[f"boundaries.lower.{quantity}"]
        if upper < lower:
            message = f"is {shown(upper)}, below the lower bound {shown(lower)}; allowed: at least that"
            yield ("boundaries", "upper", quantity), message

    return rule


def _known_range(quantity: str) -> Callable[[Values], Iterator[Finding]]:
    def rule(values: Values) -> Iterator[Finding]:
        interval, nominal = values[f"device.range.{quantity}"], values[f"device.{quantity}"]
        if interval is not None and not interval[0] <= nominal <= interval[1]:
            message = (
                f"is {shown(interval)}; allowed: an interval that holds device.{quantity} = {shown(nominal)}"
            )
            yield ("device", "range", quantity), message

    return rule


def _contact_damping(values: Values) -> Iterator[Finding]:
    interval = values["coupling.contact_damping_ns_per_m"]
    if values["coupling.structure"] == "series" and tuple(interval) != (0, 0):
        message = (
            f'is {shown(interval)}; allowed: [0.0, 0.0], or the structure "damped", which has this damper'
        )
        yield ("coupling", "contact_damping_ns_per_m"), message


def _range_or_list(values: Values) -> Iterator[Finding]:
    for key in ("start_hz", "stop_hz", "points", "spacing"):
        if values.given("frequency", "values_hz") and values.given("frequency", key):
            yield ("frequency", key), "stands beside values_hz; allowed: a range or a list, not both"


def _increasing(values: Values) -> Iterator[Finding]:
    for index, (one, two) in enumerate(itertools.pairwise(values["frequency.values_hz"] or ()), start=1):
        if two <= one:
            fault = "repeats" if two == one else "is below"
            message = f"is {shown(two)} and {fault} the one before, {shown(one)}; allowed: increasing values"
            yield ("frequency", "values_hz", index), message


def _origin(values: Values, key: str) -> str:
    return "" if values.given("frequency", key) else " (the default)"


def _range(values: Values) -> Iterator[Finding]:
    if values["frequency.values_hz"] is not None or values["frequency.points"] == 1:
        return
    start, stop, points = (values[f"frequency.{key}"] for key in ("start_hz", "stop_hz", "points"))
    if stop < start:
        origin = _origin(values, "stop_hz")
        message = f"is {shown(stop)}{origin}, below start_hz = {shown(start)}; allowed: at least that"
        yield ("frequency", "stop_hz"), message
    elif stop - start < _SMALLEST_STEP * stop * (points - 1):
        message = (
            f"is {points}, too many between {shown(start)} and {shown(stop)} Hz to be told apart; "
            "allowed: 1 for start_hz alone, or a wider range"
        )
        yield ("frequency", "points"), message


def _nyquist(values: Values) -> Iterator[Finding]:
    sample_time = values["device.sample_time_s"]
    limit = plain(0.5 / sample_time)

    def message(frequency: float, origin: str = "") -> str:
        return (
            f"is {shown(frequency)}{origin}, at or above the Nyquist frequency {limit} Hz of sample_time_s = "
            f"{shown(sample_time)}, where the Tustin map is infinite; allowed: below {limit} Hz"
        )

    listed = values["frequency.values_hz"]
    if listed is not None:
        for index, frequency in enumerate(listed):
            if frequency * sample_time >= 0.5:
                yield ("frequency", "values_hz", index), message(frequency)
        return
    for key in ("start_hz",) if values["frequency.points"] == 1 else ("start_hz", "stop_hz"):
        frequency = values[f"frequency.{key}"]
        if frequency * sample_time >= 0.5:
            yield ("frequency", key), message(frequency, _origin(values, key))


def _duration(values: Values) -> Iterator[Finding]:
    duration, sample_time = values["scene.duration_s"], values["device.sample_time_s"]
    if duration < sample_time:
        message = (
            f"is {shown(duration)}; allowed: at least one sample, device.sample_time_s = {shown(sample_time)}"
        )
        yield ("scene", "duration_s"), message


def _saturation(values: Values) -> Iterator[Finding]:
    if values["device.max_force_n"] is not None:
        return
    for index, effect in enumerate(values["scene.effects"]):
        table = dict(effect)
        if table["kind"] == "saturation" and table.get("force_n") is None:
            message = "has neither force_n nor device.max_force_n; allowed: one of the two"
            yield ("scene", "effects", index, "force_n"), message


_RULES: tuple[Callable[[Values], Iterator[Finding]], ...] = (
    _bounds("damping_ns_per_m"),
    _bounds("stiffness_n_per_m"),
    _known_range("mass_kg"),
    _known_range("damping_ns_per_m"),
    _contact_damping,
    _range_or_list,
    _increasing,
    _range,
    _nyquist,
    _duration,
    _saturation,
)
