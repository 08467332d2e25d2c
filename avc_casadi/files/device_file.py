"""A device file: a device that problems refer to, each value with its source, and its gaps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator

from avc_casadi._errors import Fault, InputError
from avc_casadi.files.border import COUNTS, Border, overridden
from avc_casadi.files.catalogue import device_names, device_path, require_source
from avc_casadi.files.key_lines import KeyLines
from avc_casadi.files.toml_text import tables_of, text_of
from avc_casadi.model import quantity as q
from avc_casadi.model.device import Device, radius_findings

Grade = Literal["measured", "computed", "vendor", "example", "assumed"]

# Keys that qualify another key and are no quantities.
_NO_QUANTITY = {"motion", "handle_radius_m", "amplifier_order", "encoder_at", "held", "range"}
_QUANTITIES = tuple(key for key in Device.model_fields if key not in _NO_QUANTITY)
# Not a gap where absent: a lag has none, and most files give a lag.
_NEED_NOT_BE_SAID = {"amplifier_damping_ratio"}


class Source(q.Table):
    """Source and grade of a value and its range."""

    source: q.Text
    grade: Grade


class Sources(q.Table):
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


class SdkExample(q.Table):
    """Example limits shipped with an SDK; neither of a datasheet nor part of the device."""

    source: q.Text
    max_stiffness_n_per_m: q.Stiffness | None = None
    max_damping_ns_per_m: q.Damping | None = None
    wall_stiffness_n_per_m: q.Stiffness | None = None


def _gaps(value: Any) -> tuple[str, ...]:
    if not isinstance(value, list | tuple) or any(name not in _QUANTITIES for name in value):
        raise q.refusal(f"is {q.shown(value)}; allowed: a list of {', '.join(_QUANTITIES)}")
    return tuple(value)


class DeviceFile(q.Table):
    """A device of the catalogue or of a user.

    Attributes:
        name: catalogue name or file stem.
        title: one line.
        device: the device; unknown properties have cautious values.
        gaps: keys of unknown properties.
        sources: of every value; or of none, in a file of one's own estimates.
        sdk_example: limits shipped with an SDK.
    """

    name: q.Text = ""
    title: q.Text = ""
    device: Device
    gaps: Annotated[tuple[str, ...], BeforeValidator(_gaps)] = ()
    sources: Sources = Sources()
    sdk_example: SdkExample | None = None

    def faults(self) -> Iterator[q.Finding]:
        """Require a source of every value, every gap named and its value graded assumed; or no sources at all."""
        yield from radius_findings(self.device)
        if not {"sources", "gaps"} & self.model_fields_set:
            return
        stated_keys = self.device.model_fields_set | self.device.range.model_fields_set
        for key in _QUANTITIES:
            stated, source = key in stated_keys, getattr(self.sources, key)
            if not stated and key not in self.gaps and key not in _NEED_NOT_BE_SAID:
                yield ("device", key), f"is neither given nor a gap; allowed: a value with its source, or {key} in gaps"
            if stated and source is None:
                yield ("sources", key), "is missing; allowed: a source and a grade of every value of [device]"
            if source is not None and not stated:
                yield ("sources", key), "is the source of a value that is not given; allowed: beside the value"
            if stated and source is not None and key in self.gaps and source.grade != "assumed":
                yield ("sources", key, "grade"), f'is {q.shown(source.grade)}, but {key} is a gap; allowed: "assumed"'


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
    require_source(source, "the path of a device file, or a name as `avc list` shows them")
    path = device_path(source)
    if isinstance(path, str):
        raise InputError.of(path, file=str(source))
    return parse_device(
        text_of(path, "give the path of a device file or the name of a device from `avc list`"),
        file=str(source),
        name=path.stem,
    )


def parse_device(text: str, *, file: str = "device.toml", name: str = "") -> DeviceFile:
    """Validate the text of a device file."""
    tables = tables_of(text, file)
    if "environment" in tables:
        message = "is that of a problem; allowed: a device file, of the problem's [device] and what is known of it"
        raise InputError.of(message, file=file, key="environment")
    border = Border()
    device, units = border.device_table(tables.get("device"), {})
    gaps = tables.get("gaps")
    if isinstance(gaps, list) and all(isinstance(gap, str) for gap in gaps):
        named = ("encoder_resolution_m" if gap == COUNTS else units.inner(gap) for gap in gaps)
        tables = {**tables, "gaps": list(named)}
    border.read(tables, device, units)
    found = border.checked(DeviceFile, name)
    if isinstance(found, DeviceFile):
        return found
    lines = KeyLines(text.replace("\r\n", "\n"))
    raise InputError([Fault(file, lines[key], q.dotted(key), message) for key, message in found])


def device_catalogue() -> tuple[DeviceFile, ...]:
    """Return every device of the catalogue."""
    return tuple(map(load_device, device_names()))


def with_device(tables: Mapping[str, Any], folder: Path | None) -> Border | q.Finding:
    """Return the tables of a problem file in the common keys, with the devices that they refer to."""
    table, bases = tables.get("device"), dict[str, Any]()
    own: Any = {} if isinstance(table, str) else table
    for name in ("device", "follower"):
        given = tables.get(name)
        if (name == "device" and isinstance(given, str)) or (isinstance(given, Mapping) and "from" in given):
            found = _referred(given, folder, name)
            if isinstance(found, tuple):
                return found
            bases[name] = found
            if isinstance(given, Mapping):
                rest = {key: value for key, value in given.items() if key != "from"}
                own, tables = (rest, tables) if name == "device" else (own, {**tables, name: rest})
    border = Border()
    border.read(tables, *border.device_table(own, bases.get("device", {})))
    if "follower" in bases:
        border.tables["follower"] = overridden(bases["follower"], border.tables["follower"])
    return border


def _referred(table: str | Mapping[str, Any], folder: Path | None, name: str) -> dict[str, Any] | q.Finding:
    """Return the device that a table refers to, or the fault of the reference."""
    key: q.Path = (name,) if isinstance(table, str) else (name, "from")
    named = table if isinstance(table, str) else table["from"]
    if not isinstance(named, str):
        return key, f"is {q.shown(named)}; allowed: the name of a device of `avc list`, or a path ending in .toml"
    path = device_path(named, folder)
    if isinstance(path, str):
        return key, path
    try:
        found = path.is_file()
    except (OSError, ValueError):  # too long for a path, or with a NUL in it
        found = False
    if not found:
        return key, f"is {q.shown(named)}, where there is no file; allowed: a path relative to this file, or a name"
    return load_device(path).device.model_dump(exclude_unset=True)
