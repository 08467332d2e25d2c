"""The device of a problem file as a reference to a device file, with keys that override it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from avc_casadi.problem._device_file import device_path, load_device
from avc_casadi.problem._quantity import shown

if TYPE_CHECKING:
    from avc_casadi.problem._rules import Finding
    from avc_casadi.problem._values import Path as KeyPath


def with_device(tables: Mapping[str, Any], folder: Path | None) -> Mapping[str, Any] | Finding:
    """Put the device in the place of a reference to it, ``device = "name"`` or ``[device]`` with ``from = "name"``.

    Keys beside `from` override those of the device and its ranges of them.

    Args:
        tables: parsed tables of a problem file.
        folder: of the problem file.

    Returns:
        The tables with the whole device, or what is wrong with the reference.

    Raises:
        InputError: with every fault of the device file.
    """
    table = tables.get("device")
    key: KeyPath = ("device",)
    named, own = table, {}
    if isinstance(table, Mapping) and "from" in table:
        key, named, own = ("device", "from"), table["from"], {k: v for k, v in table.items() if k != "from"}
    elif not isinstance(table, str):
        return tables
    if not isinstance(named, str):
        return key, f"is {shown(named)}; allowed: the name of a device of `avc list`, or a path ending in .toml"
    path = device_path(named, folder)
    if isinstance(path, str):
        return key, path
    if not _exists(path):
        return key, f"is {shown(named)}, where there is no file; allowed: a path relative to this file, or a name"
    base = load_device(path).device.model_dump(exclude_unset=True)
    return {**tables, "device": _overridden(base, own)}


def _overridden(base: dict[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """Lay keys over a table; a value that is given anew is no longer in doubt as the old one was."""
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
