"""A device file: a device that problems refer to, each value with its source, and its gaps."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from avc_casadi._errors import Fault, InputError
from avc_casadi.files.border import COUNTS, Border, overridden
from avc_casadi.files.catalogue import device_path, require_source
from avc_casadi.files.toml import KeyLines, tables_of, text_of
from avc_casadi.model import quantity as q
from avc_casadi.model import table as t
from avc_casadi.model.device import Device

Grade = Literal["measured", "computed", "vendor", "example", "assumed"]

# The other keys qualify one of these.
_QUANTITIES = tuple(
    key
    for key in Device.model_fields
    if key not in {"motion", "handle_radius_m", "amplifier_order", "encoder_at", "held", "range"}
)


class Source(t.Table):
    """Source and grade of a value and its range."""

    source: t.Text
    grade: Grade


class SdkExample(t.Table):
    """Example limits shipped with an SDK; neither of a datasheet nor part of the device."""

    source: t.Text
    max_stiffness_n_per_m: q.Stiffness | None = None
    max_damping_ns_per_m: q.Damping | None = None
    wall_stiffness_n_per_m: q.Stiffness | None = None


class DeviceFile(t.Table):
    """A device of the catalogue or of a user."""

    name: t.Text = ""
    title: t.Text = ""
    device: Device
    gaps: tuple[str, ...] = Field((), strict=False)
    sources: dict[str, Source] = Field(default_factory=dict)
    sdk_example: SdkExample | None = None

    def faults(self) -> Iterator[t.Finding]:
        """Require a source of every value, every gap named and its value graded assumed; or no sources at all."""
        allowed = f"allowed: {', '.join(_QUANTITIES)}"
        unknown = [("sources", key) for key in self.sources if key not in _QUANTITIES]
        yield from ((path, f"{t.UNKNOWN}{allowed}") for path in unknown)
        if any(gap not in _QUANTITIES for gap in self.gaps):
            yield ("gaps",), f"is {t.shown(self.gaps)}; {allowed}"
        if not {"sources", "gaps"} & self.model_fields_set:
            return
        stated_keys = self.device.model_fields_set | self.device.range.model_fields_set
        for key in _QUANTITIES:
            stated = key in stated_keys
            source = self.sources.get(key)
            # A lag has no damping ratio, and most files give a lag.
            if not stated and key not in (*self.gaps, "amplifier_damping_ratio"):
                yield ("device", key), f"is missing; give a value and its source, or add {key} to gaps (unknown values)"
            if stated != (source is not None):
                fact = "is missing" if stated else "is the source of no value in [device]; delete it, or give the value"
                yield ("sources", key), f"{fact}; allowed: source and grade of every value of [device]"
            elif source is not None and key in self.gaps and source.grade != "assumed":
                yield (
                    ("sources", key, "grade"),
                    f'is {t.shown(source.grade)}, but {key} is listed in gaps; allowed: "assumed"',
                )


def load_device(source: str | Path) -> DeviceFile:
    """Load a device file: a device that problems refer to, with the source and grade of each value.

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
    text = text_of(path, "give the path of a device file or the name of a device from `avc list`")
    return parse_device(text, file=str(source), name=path.stem)


def parse_device(text: str, *, file: str = "device.toml", name: str = "") -> DeviceFile:
    """Validate the text of a device file."""
    tables = tables_of(text, file)
    if "environment" in tables:
        message = "belongs to a problem file; a device file has [device] and its sources only"
        raise InputError.of(message, file=file, key="environment")
    border = Border()
    device, units = border.device_table(tables.get("device"), {})
    gaps = tables.get("gaps")
    if isinstance(gaps, list):
        inner = ["encoder_resolution_m" if gap == COUNTS else units.inner(str(gap)) for gap in gaps]
        tables = {**tables, "gaps": inner}
    border.read(tables, device, units)
    result = border.checked(DeviceFile, name)
    if isinstance(result, DeviceFile):
        return result
    lines = KeyLines(text)
    raise InputError([Fault(file, lines[path], t.dotted(path), message) for path, message in result])


def with_device(tables: Mapping[str, Any], folder: Path | None) -> Border | t.Finding:
    """Return the tables of a problem file in the common keys, with the devices that they refer to.

    Or the fault of a reference. A device may be a name alone, or a table with `from`.
    """
    tables = dict(tables)
    bases: dict[str, Any] = {}
    name_alone = isinstance(tables.get("device"), str)
    if name_alone:
        tables["device"] = {"from": tables["device"]}
    for name in ("device", "follower"):
        table = tables.get(name)
        if isinstance(table, Mapping) and "from" in table:
            base = _referred(table["from"], folder)
            if isinstance(base, str):
                return (name,) if name_alone else (name, "from"), base
            bases[name] = base
            tables[name] = {key: value for key, value in table.items() if key != "from"}
    border = Border()
    border.follower_base = bases.get("follower", {})
    if "device" not in tables and isinstance(tables.get("simulation"), Mapping):
        border.read_joint(tables)
        return border
    border.read(tables, *border.device_table(tables.get("device"), bases.get("device", {})))
    if "follower" in bases:
        border.tables["follower"] = overridden(bases["follower"], border.tables["follower"])
    return border


def _referred(named: Any, folder: Path | None) -> dict[str, Any] | str:
    """Return the device that a table refers to, or the fault of the reference."""
    if not isinstance(named, str):
        return f"is {t.shown(named)}; allowed: the name of a device of `avc list`, or a path ending in .toml"
    path_or_fault = device_path(named, folder)
    if isinstance(path_or_fault, str):
        return path_or_fault
    path = path_or_fault
    if not os.path.isfile(path):  # noqa: PTH113 - of pathlib a name that is too long raises
        return f"is {t.shown(named)}, which does not exist; give a path relative to this file, or a name"
    return load_device(path).device.model_dump(exclude_unset=True)
