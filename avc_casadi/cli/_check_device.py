"""Check a device file and show what is known of the device."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from avc_casadi import InputError
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._subject import load_device


def is_device(source: str) -> bool:
    """Return whether a name or a file is that of a device rather than a problem."""
    from avc_casadi.files.catalogue import catalogue_names, device_names
    from avc_casadi.files.device_file import DeviceFile
    from avc_casadi.files.toml_text import tables_of, text_of

    if source.startswith("devices/") and not source.endswith(".toml"):
        return True
    if not source.endswith(".toml"):
        return source in device_names() and source not in catalogue_names()
    try:
        tables = tables_of(text_of(Path(source)), source)
    except InputError:  # reported where it is loaded as a problem
        return False
    return isinstance(tables.get("device"), dict) and set(tables) <= set(DeviceFile.model_fields)


def check_device(source: str, console: Console) -> Answer:
    """Load the device file; its faults are raised."""
    from avc_casadi._util.units import spoken_key
    from avc_casadi.present.pages.catalogue import device_lines, device_page

    file = load_device(source)
    values = file.device.model_dump(mode="json", exclude_unset=True)
    ranges = values.pop("range", {})
    document: dict[str, Any] = {
        "schema": "avc-check/2",
        "valid": True,
        "device": file.name,
        "title": file.title,
        "values": values,
        "range": ranges,
        "sources": file.sources.model_dump(exclude_none=True),
        "gaps": [*map(spoken_key, file.gaps)],
        "referred_as": _reference(source, file.name),
        "sdk_example": None if file.sdk_example is None else file.sdk_example.model_dump(exclude_none=True),
    }
    units = file.device.units
    return Answer(document, device_page(document, units, console.page), more="\n".join(device_lines(document, units)))


def _reference(source: str, name: str) -> str:
    """Return the reference to the device in a problem file beside it."""
    from avc_casadi.files.catalogue import device_names

    known = device_names().get(name)
    elsewhere = source.endswith(".toml") and (known is None or Path(source).resolve() != Path(str(known)).resolve())
    return Path(source).name if elsewhere else name
