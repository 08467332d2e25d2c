"""A device file: a device that problems refer to, each value with its source, and its gaps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import BeforeValidator, model_validator

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.units import spoken_key
from avc_casadi.files.catalogue import device_names, device_path
from avc_casadi.files.key_lines import KeyLines
from avc_casadi.files.rotary_keys import COUNTS, Worded, device_words, linear_at_capstan, problem_words
from avc_casadi.files.toml_text import tables_of, text_of
from avc_casadi.model.device import Device
from avc_casadi.model.findings import checked
from avc_casadi.model.quantity import Damping, Stiffness, Table, Text, refusal, shown
from avc_casadi.model.rules import DEVICE_RULES, Finding, Values, broken_rules, dotted

if TYPE_CHECKING:
    from avc_casadi.model.rules import Finding
    from avc_casadi.model.rules import Path as KeyPath


Grade = Literal["measured", "computed", "vendor", "example", "assumed"]

# Keys that qualify another key and are no quantities.
_NO_QUANTITY = {"motion", "handle_radius_m", "amplifier_order", "encoder_at", "held", "range"}
_QUANTITIES = tuple(key for key in Device.model_fields if key not in _NO_QUANTITY)
# Not a gap where absent: a lag has none, and most files give a lag.
_NEED_NOT_BE_SAID = {"amplifier_damping_ratio"}


class Source(Table):
    """Source and grade of a value and its range."""

    source: Text
    grade: Grade


class Sources(Table):
    """The source of each value that a device file states."""

    mass_kg: Source | None = None
    damping_ns_per_m: Source | None = None
    sample_time_s: Source | None = None
    delay_samples: Source | None = None
    coulomb_friction_n: Source | None = None
    encoder_resolution_m: Source | None = None
    position_noise_rms_m: Source | None = None
    amplifier_bandwidth_hz: Source | None = None
    amplifier_damping_ratio: Source | None = None
    max_force_n: Source | None = None
    backlash_m: Source | None = None
    resonance: Source | None = None


class SdkExample(Table):
    """Example limits shipped with an SDK; neither of a datasheet nor part of the device."""

    source: Text
    max_stiffness_n_per_m: Stiffness | None = None
    max_damping_ns_per_m: Damping | None = None
    wall_stiffness_n_per_m: Stiffness | None = None


def _gaps(value: Any) -> tuple[str, ...]:
    if not isinstance(value, list | tuple) or any(name not in _QUANTITIES for name in value):
        raise refusal(f"is {shown(value)}; allowed: a list of {', '.join(_QUANTITIES)}")
    return tuple(value)


class DeviceFile(Table):
    """A device of the catalogue or of a user.

    Attributes:
        name: catalogue name or file stem.
        title: one line.
        device: the device; unknown properties have cautious values.
        gaps: keys of unknown properties.
        sources: of every value; or of none, in a file of one's own estimates.
        sdk_example: limits shipped with an SDK.
    """

    name: Text = ""
    title: Text = ""
    device: Device
    gaps: Annotated[tuple[str, ...], BeforeValidator(_gaps)] = ()
    sources: Sources = Sources()
    sdk_example: SdkExample | None = None

    @model_validator(mode="after")
    def _keeps_the_rules(self) -> Self:
        broken = broken_rules(Values(self, type(self)), _RULES)
        if broken:
            raise refusal("\n".join(f"{dotted(path)}: {message}" for path, message in broken))
        return self


def load_device(source: str | Path) -> DeviceFile:
    """Load a device file.

    Args:
        source: a path, or a name of the catalogue of devices, for example ``phantom-omni``.

    Raises:
        InputError: with every fault of the file at once, each with its line and key.

    Example:
        >>> avc.load_device("reference-r1").device.amplifier_bandwidth_hz
        1000.0
    """
    path = device_path(source)
    if isinstance(path, str):
        raise InputError.of(path, file=str(source))
    return parse_device(
        text_of(path, "give the path of a device file or the name of a device from `avc list`"),
        file=str(source),
        name=path.stem,
    )


def parse_device(text: str, *, file: str = "device.toml", name: str = "") -> DeviceFile:
    """Validate the text of a device file.

    Args:
        text: TOML.
        file: name in faults.
        name: name of the device.

    Raises:
        InputError: with every fault of the text at once, each with its line and key.
    """
    tables = tables_of(text, file)
    if "environment" in tables:
        message = "is that of a problem; allowed: a device file, of the problem's [device] and what is known of it"
        raise InputError.of(message, file=file, key="environment")
    worded = _worded(tables)
    found = worded.told(lambda: checked(DeviceFile, worded.tables, name, _RULES))
    if isinstance(found, DeviceFile):
        return found
    lines = KeyLines(text.replace("\r\n", "\n"))
    raise InputError([Fault(file, lines[key], dotted(key), message) for key, message in found])


def _worded(tables: Mapping[str, Any]) -> Worded:
    """Return the tables in the common keys."""
    findings: list[Finding] = []
    own, units = device_words(tables.get("device"), {}, findings)
    device, _ = linear_at_capstan(own, units, findings)
    words = (
        {**tables, "gaps": [units.inner(_of_counts(gap)) for gap in tables.get("gaps", ())]}
        if _texts(tables)
        else tables
    )
    found = problem_words(words, device, (units, units), findings)
    sources = found.tables.get("sources")
    if isinstance(sources, Mapping) and COUNTS in sources and not units.linear:
        named = {(_of_counts(key) if key == COUNTS else key): value for key, value in sources.items()}
        return replace(
            found, tables={**found.tables, "sources": {units.inner(key): value for key, value in named.items()}}
        )
    return found


def _texts(tables: Mapping[str, Any]) -> bool:
    gaps = tables.get("gaps")
    return isinstance(gaps, list) and all(isinstance(gap, str) for gap in gaps)


def _of_counts(key: str) -> str:
    """Return the key that a number of counts replaces."""
    return "encoder_resolution_rad" if key == COUNTS else key


def device_catalogue() -> tuple[DeviceFile, ...]:
    """Return every device of the catalogue."""
    return tuple(map(load_device, device_names()))


def _sourced(values: Values) -> Iterator[Finding]:
    """Require a source of every value, every gap named and its value graded assumed; or no sources at all."""
    if not values.given("sources") and not values.given("gaps"):
        return
    gaps = values["gaps"]
    for key in _QUANTITIES:
        stated = values.given("device", key) or values.given("device", "range", key)
        source = values[f"sources.{key}"]
        if not stated and key not in gaps and key not in _NEED_NOT_BE_SAID:
            message = (
                f'is neither given nor a gap; allowed: a value with its source, or gaps = ["{spoken_key(key)}", ...]'
            )
            yield ("device", key), message
        if stated and source is None:
            yield ("sources", key), "is missing; allowed: a source and a grade of every value of [device]"
        if source is not None and not stated:
            yield ("sources", key), "is the source of a value that is not given; allowed: beside the value"
        if stated and source is not None and key in gaps:
            grade = source["grade"] if isinstance(source, Mapping) else source.grade
            if grade != "assumed":
                yield (
                    ("sources", key, "grade"),
                    f'is {shown(grade)}, but {spoken_key(key)} is a gap; allowed: "assumed"',
                )


_RULES = (*DEVICE_RULES, _sourced)


def with_device(tables: Mapping[str, Any], folder: Path | None) -> Worded | Finding:
    """Replace a reference by the device, ``device = "name"`` or ``[device]`` with ``from = "name"``.

    Keys beside `from` override those of the device and its ranges of them. All tables then have the common keys,
    whatever the motion of the device.

    Args:
        tables: parsed tables of a problem file.
        folder: of the problem file.

    Returns:
        The tables with the whole device, or the fault of the reference.

    Raises:
        InputError: with every fault of the device file.
    """
    table, base = tables.get("device"), {}
    own: Any = table
    if isinstance(table, str) or (isinstance(table, Mapping) and "from" in table):
        found = _referred(table, folder)
        if isinstance(found, tuple):
            return found
        base, own = found, {} if isinstance(table, str) else {k: v for k, v in table.items() if k != "from"}
    findings: list[Finding] = []
    own, units = device_words(own, base, findings)
    device, rest = linear_at_capstan(_overridden(base, own) if base else own, units, findings)
    other = tables.get("follower")
    if isinstance(other, Mapping) and "from" in other:
        found = _referred(other, folder)
        if isinstance(found, tuple):
            return ("follower", *found[0][1:]), found[1]
        kept = {key: value for key, value in other.items() if key != "from"}
        tables = {**tables, "follower": _overridden(found, kept)}
    return problem_words(tables, device, (units, rest), findings)


def _referred(table: str | Mapping[str, Any], folder: Path | None) -> dict[str, Any] | Finding:
    """Return the device that a table refers to, or the fault of the reference."""
    key: KeyPath = ("device",) if isinstance(table, str) else ("device", "from")
    named = table if isinstance(table, str) else table["from"]
    if not isinstance(named, str):
        return key, f"is {shown(named)}; allowed: the name of a device of `avc list`, or a path ending in .toml"
    path = device_path(named, folder)
    if isinstance(path, str):
        return key, path
    if not _exists(path):
        return key, f"is {shown(named)}, where there is no file; allowed: a path relative to this file, or a name"
    return load_device(path).device.model_dump(exclude_unset=True)


def _overridden(base: dict[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """Override keys of a table; an overridden value loses its old range."""
    ranges = base.get("range", {})
    whole = {key: value for key, value in base.items() if key != "range"}
    for key, value in own.items():
        if key == "range":
            continue
        if isinstance(value, Mapping) and isinstance(whole.get(key), Mapping):
            whole[key] = {**whole[key], **value}
            kept = {inner: ends for inner, ends in ranges.get(key, {}).items() if inner not in value}
        else:
            whole[key], kept = value, {}
        ranges = {**ranges, key: kept} if kept else {name: ends for name, ends in ranges.items() if name != key}
    given = own.get("range", {})
    if not isinstance(given, Mapping):
        return {**whole, "range": given}
    for key, value in given.items():
        both = isinstance(value, Mapping) and isinstance(ranges.get(key), Mapping)
        ranges = {**ranges, key: {**ranges[key], **value} if both else value}
    return {**whole, "range": ranges} if ranges else whole


def _exists(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):  # too long for a path, or with a NUL in it
        return False
