"""The device of a problem file as a reference to a device file, with keys that override it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from avc_casadi.problem._catalogue import named_file
from avc_casadi.problem._device_file import load_device
from avc_casadi.problem._motion_words import Worded, device_words, felt_at_handle, problem_words
from avc_casadi.problem._quantity import shown

if TYPE_CHECKING:
    from avc_casadi.problem._rules import Finding
    from avc_casadi.problem._values import Path as KeyPath


def with_device(tables: Mapping[str, Any], folder: Path | None) -> Worded | Finding:
    """Put the device in the place of a reference to it, ``device = "name"`` or ``[device]`` with ``from = "name"``.

    Keys beside `from` override those of the device and its ranges of them. All tables then have the keys that every
    file shares, whatever the motion of the device.

    Args:
        tables: parsed tables of a problem file.
        folder: of the problem file.

    Returns:
        The tables with the whole device, or what is wrong with the reference.

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
    device, rest = felt_at_handle(_overridden(base, own) if base else own, units, findings)
    return problem_words(tables, device, (units, rest), findings)


def _referred(table: str | Mapping[str, Any], folder: Path | None) -> dict[str, Any] | Finding:
    """Return the device that a table refers to, or what is wrong with the reference."""
    key: KeyPath = ("device",) if isinstance(table, str) else ("device", "from")
    named = table if isinstance(table, str) else table["from"]
    if not isinstance(named, str):
        return key, f"is {shown(named)}; allowed: the name of a device of `avc list`, or a path ending in .toml"
    path = named_file(named, "device", folder)
    if isinstance(path, str):
        return key, path
    if not _exists(path):
        return key, f"is {shown(named)}, where there is no file; allowed: a path relative to this file, or a name"
    return load_device(path).device.model_dump(exclude_unset=True)


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
