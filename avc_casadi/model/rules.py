"""Rules between the values of a problem, each checked wherever the values that it needs are sound."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import Any

from pydantic import BaseModel

from avc_casadi._util.units import A_MASS, KG, MASS, spoken_key
from avc_casadi.model.device import DeviceRange, ResonanceRange
from avc_casadi.model.quantity import plain, shown

Path = tuple[str | int, ...]
UNKNOWN = "is not a known key; allowed: "
"""Beginning of the finding of a mistyped key."""
BELONGS_IN = "; it belongs in "
"""Its continuation where other tables have that key."""

LONGEST_USUAL_S = 20e-3
"""Sample time of a slow loop; a longer one may be in milliseconds."""

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]{1,60}")


def dotted(path: Path) -> str:
    """Return a path as in a file: ``scene.effects[0].mass_kg``."""
    text = ""
    for part in path:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            text += f".{part}" if _BARE_KEY.fullmatch(part) else f".{shown(part)}"
    return text.removeprefix(".")


class UnsoundError(LookupError):
    """A rule read a value that is faulty or missing; that fault is reported elsewhere."""


class Values:
    """Read access to a problem, either a model or the tables of a faulty file."""

    def __init__(self, problem: Mapping[str, Any] | BaseModel, model: type[BaseModel], faulty: Collection[Path] = ()):
        self._problem = problem
        self._model = model
        self._faulty = faulty

    def given(self, *path: str) -> bool:
        """Return whether the value was written, not a default."""
        node: Any = self._problem
        for key in path:
            keys = node.model_fields_set if isinstance(node, BaseModel) else node
            if not isinstance(keys, Mapping | set) or key not in keys:
                return False
            node = getattr(node, key) if isinstance(node, BaseModel) else node[key]
        return True

    def __getitem__(self, path: str) -> Any:
        """Return the value at a dotted path, or its default.

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

    def get(self, path: str, default: Any) -> Any:
        """Return the value at a dotted path, `default` where it is unsound."""
        try:
            return self[path]
        except UnsoundError:
            return default


Finding = tuple[Path, str]
Rule = Callable[[Values], Iterator[Finding]]

MOST_LINK_SAMPLES = 64
"""Largest delay of a link between two devices, in samples, each way."""
# Closer frequencies would coincide after rounding.
_SMALLEST_STEP = 1e-12


def broken_rules(values: Values, rules: Sequence[Rule]) -> list[Finding]:
    """Return every broken rule among those whose values are sound."""
    findings: list[Finding] = []
    for rule in rules:
        try:
            findings.extend(rule(values))
        except UnsoundError:
            continue
    return findings


def _bounds(quantity: str) -> Rule:
    def rule(values: Values) -> Iterator[Finding]:
        upper, lower = values[f"boundaries.upper.{quantity}"], values[f"boundaries.lower.{quantity}"]
        if upper < lower:
            message = f"is {shown(upper)}, below the lower bound {shown(lower)}; allowed: at least that"
            yield ("boundaries", "upper", quantity), message

    return rule


def _bounds_apart(values: Values) -> Iterator[Finding]:
    if values["realism.require"] != "bounds":
        return
    quantities = ("damping_ns_per_m", "stiffness_n_per_m")
    # If left out, both bounds are the environment.
    if not values.given("boundaries") or all(
        values[f"boundaries.upper.{quantity}"] == values[f"boundaries.lower.{quantity}"] for quantity in quantities
    ):
        message = 'is "bounds", but upper and lower of [boundaries] are equal; allowed: bounds apart, "jnd" or "none"'
        yield ("realism", "require"), message


def _known_range(*path: str) -> Rule:
    """Check that the nominal value of the device lies in its range and is present where a range is."""
    table, quantity = ".".join(("device", "range", *path[:-1])), path[-1]
    where = ".".join(("device", *path))

    def rule(values: Values) -> Iterator[Finding]:
        # Other faults of its table hide nothing; the resonance may be absent.
        alone = len(path) == 1
        interval = values[f"{table}.{quantity}"] if alone else _inside(values[table], quantity)
        if interval is None:
            return
        nominal = values[where] if alone else _inside(values[".".join(("device", *path[:-1]))], quantity)
        if nominal is None and quantity in _WITHOUT_DEFAULT:
            message = f"is {shown(interval)}, but {spoken_key(where)} is missing; allowed: beside a nominal value in it"
            yield ("device", "range", *path), message
            return
        nominal = values[where] if nominal is None else nominal
        if not interval[0] <= nominal <= interval[1]:
            message = f"is {shown(interval)}; allowed: an interval that holds {spoken_key(where)} = {shown(nominal)}"
            yield ("device", "range", *path), message
        elif quantity == "mass_kg" and interval[0] == 0 < interval[1]:
            message = f"is {shown(interval)}; allowed: from above 0 {KG}, for without {A_MASS} nothing is there to hold"
            yield ("device", "range", *path), message

    return rule


# Optional quantities of the device.
_WITHOUT_DEFAULT = {"amplifier_bandwidth_hz", "max_force_n", "frequency_hz", "damping_ratio", "mass_ratio"}


def _inside(table: Any, key: str) -> Any:
    """Return a value of a table, written or validated; None without the table."""
    return table.get(key) if isinstance(table, Mapping) else getattr(table, key, None)


def _turns(values: Values) -> Iterator[Finding]:
    """Check the radius: required for a rotary device, whose rendered force depends on it; absent for a linear one."""
    radius, rotary = values["device.handle_radius_m"], values["device.motion"] == "rotary"
    if rotary and radius is None:
        message = "is missing; allowed: the radius at which the hand holds what turns, 0.002 to 10 m"
        yield ("device", "handle_radius_m"), message
    if not rotary and radius is not None:
        yield ("device", "handle_radius_m"), 'says nothing of a linear device; allowed: beside motion = "rotary"'


def _resonance(values: Values) -> Iterator[Finding]:
    if values["device.resonance"] is None:
        return
    if values["device.mass_kg"] == 0:
        message = f"is 0, but device.resonance divides the {MASS}; allowed: above 0, or no resonance"
        yield ("device", "mass_kg"), message


def _contact_damping(values: Values) -> Iterator[Finding]:
    interval = values["coupling.contact_damping_ns_per_m"]
    if values["coupling.structure"] == "series" and tuple(interval) != (0, 0):
        message = f'is {shown(interval)}; allowed: [0.0, 0.0], or the structure "damped", which has this damper'
        yield ("coupling", "contact_damping_ns_per_m"), message


def _range_or_list(values: Values) -> Iterator[Finding]:
    listed = values.get("frequency.values_hz", ()) is not None
    for key in ("start_hz", "stop_hz", "points", "spacing"):
        if listed and values.given("frequency", key):
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
    points = values.get("frequency.points", 0)
    if values["frequency.values_hz"] is not None or points == 1:
        return
    start, stop = values["frequency.start_hz"], values["frequency.stop_hz"]
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


def _beyond_nyquist(frequency: float, sample_time: float, origin: str = "") -> str | None:
    """Report a frequency that is too high."""
    if frequency * sample_time < 0.5:
        return None
    limit = plain(0.5 / sample_time)
    return (
        f"is {shown(frequency)}{origin}, at or above the Nyquist frequency {limit} Hz of sample_time_s = "
        f"{shown(sample_time)}, where the Tustin map is infinite; allowed: below {limit} Hz{_in_seconds(sample_time)}"
    )


def _in_seconds(sample_time: float) -> str:
    """Remind of the unit of a sample time beyond the usual, as of one in milliseconds."""
    told = f"; sample_time_s is in seconds: {plain(sample_time)} ms is {plain(sample_time / 1000)}"
    return told if sample_time > LONGEST_USUAL_S else ""


def _end_below_nyquist(key: str) -> Rule:
    def rule(values: Values) -> Iterator[Finding]:
        listed = values["frequency.values_hz"] is not None
        if listed or (key == "stop_hz" and values.get("frequency.points", 0) == 1):
            return
        message = _beyond_nyquist(values[f"frequency.{key}"], values["device.sample_time_s"], _origin(values, key))
        if message:
            yield ("frequency", key), message

    return rule


def _list_below_nyquist(values: Values) -> Iterator[Finding]:
    sample_time = values["device.sample_time_s"]
    for index, frequency in enumerate(values["frequency.values_hz"] or ()):
        message = _beyond_nyquist(frequency, sample_time)
        if message:
            yield ("frequency", "values_hz", index), message


def _duration(values: Values) -> Iterator[Finding]:
    duration, sample_time = values["scene.duration_s"], values["device.sample_time_s"]
    if duration < sample_time:
        message = f"is {shown(duration)}; allowed: at least one sample, device.sample_time_s = {shown(sample_time)}"
        yield ("scene", "duration_s"), message


def _saturation(values: Values) -> Iterator[Finding]:
    if values["device.max_force_n"] is not None:
        return
    for index, effect in enumerate(values["scene.effects"]):
        table = dict(effect)
        if table["kind"] == "saturation" and table.get("force_n") is None:
            message = (
                f"has neither {spoken_key('force_n')} nor {spoken_key('device.max_force_n')}; allowed: one of the two"
            )
            yield ("scene", "effects", index, "force_n"), message


def _engine_no_faster(values: Values) -> Iterator[Finding]:
    """Check that the engine is no faster than the device, to which faster steps would be invisible."""
    simulation, period = values["simulation"], values["device.sample_time_s"]
    step_s = None if simulation is None else _inside(simulation, "step_s")
    if step_s is None:
        return
    shortest = step_s if isinstance(step_s, int | float) else min(step_s)
    if shortest < period * (1 - 1e-9):
        message = f"is {shown(step_s)}; allowed: device.sample_time_s = {shown(period)} or more"
        yield ("simulation", "step_s"), message


def _one_other_end(values: Values) -> Iterator[Finding]:
    """Check that a device is coupled to an engine or to a second device, not to both, and has no detents beside it.

    The slope of a detent is a spring in the device's own loop, in which no coupling to another end is judged.
    """
    there = [table for table in ("simulation", "follower") if values[table] is not None]
    if len(there) > 1:
        yield ("follower",), "stands beside [simulation]; allowed: one of them"
    if there and values["detent"] is not None:
        why = "no coupling to another end is judged or exported with detents in the device's loop"
        onwards = "leave [detent] out, or render detents at the other end"
        yield ("detent",), f"stands beside [{there[0]}]; allowed: one of them, as {why}; {onwards}"


def _follower_moves_alike(values: Values) -> Iterator[Finding]:
    """Check that both devices are rotary or both linear, as their positions are coupled."""
    follower = values["follower"]
    if follower is None:
        return
    motion, leader = _inside(follower, "motion") or "linear", values["device.motion"]
    if motion != leader:
        message = (
            f"is {shown(motion)}, and device.motion is {shown(leader)}; allowed: a follower that moves as its leader"
        )
        yield ("follower", "motion"), message


def _link_is_short(values: Values) -> Iterator[Finding]:
    """Check the delay of the link: every pending sample is a state, and long delays take minutes, then memory."""
    follower, period = values["follower"], values["device.sample_time_s"]
    if follower is None:
        return
    shorter = min(period, _inside(follower, "sample_time_s") or period)
    for key in ("delay_s", "return_delay_s"):
        delay = _inside(follower, key)
        if delay is None:
            continue
        longest = delay if isinstance(delay, int | float) else max(delay)
        if longest > MOST_LINK_SAMPLES * shorter * (1 + 1e-9):
            most = plain(MOST_LINK_SAMPLES * shorter)
            message = (
                f"is {shown(delay)}; allowed: at most {MOST_LINK_SAMPLES} samples ({most} s): "
                "a longer link makes a loop too large to be judged here"
            )
            yield ("follower", key), message


DEVICE_RULES: tuple[Rule, ...] = (
    *(_known_range(key) for key in DeviceRange.model_fields if key != "resonance"),
    *(_known_range("resonance", key) for key in ResonanceRange.model_fields),
    _turns,
    _resonance,
)
RULES: tuple[Rule, ...] = (
    _bounds("damping_ns_per_m"),
    _bounds("stiffness_n_per_m"),
    _bounds_apart,
    *DEVICE_RULES,
    _contact_damping,
    _range_or_list,
    _increasing,
    _range,
    _end_below_nyquist("start_hz"),
    _end_below_nyquist("stop_hz"),
    _list_below_nyquist,
    _duration,
    _saturation,
    _engine_no_faster,
    _one_other_end,
    _follower_moves_alike,
    _link_is_short,
)
