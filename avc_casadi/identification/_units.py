"""Columns of a log: which is which, and in what unit, from headers and options."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from avc_casadi._errors import Fault

QUANTITIES = ("time", "position", "force")

_NAMES = {
    "time": ("time", "t", "timestamp", "stamp", "clock"),
    "position": ("position", "pos", "x", "q", "displacement", "y"),
    "force": ("force", "f", "u", "command", "commanded_force", "force_command", "effort"),
}
UNITS: Mapping[str, Mapping[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "position": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "nm": 1e-9},
    "force": {"n": 1.0, "mn": 1e-3, "kn": 1e3},
}
_OF_A_TURN = {"rad", "mrad", "urad", "deg", "nm", "n.m", "n*m", "mnm"}
_SPELT = {"sec": "s", "seconds": "s", "micros": "us", "millis": "ms", "µs": "us", "µm": "um", "newton": "n"}


@dataclass(frozen=True)
class Layout:
    """What the user says of the columns of a log.

    Attributes:
        columns: by quantity, a header or a number (1 is the first column); what is not named is found by its header.
        units: by quantity; what is not named is found in the header, ``position_mm`` or ``position [mm]``.
        sample_time_s: where the log has no time.
    """

    columns: Mapping[str, str | int] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    sample_time_s: float | None = None


def pairs_of(texts: Sequence[str], key: str) -> tuple[dict[str, str], list[Fault]]:
    """Read ``time=1,position=2`` as the columns and units of an option.

    Args:
        texts: of the option, each with one or more pairs.
        key: the option, for the faults.
    """
    found: dict[str, str] = {}
    faults = []
    for part in (part.strip() for text in texts for part in text.split(",") if part.strip()):
        name, _, value = part.partition("=")
        if name not in QUANTITIES or not value:
            allowed = ", ".join(f"{one}=..." for one in QUANTITIES)
            faults.append(Fault("", None, key, f"{part!r} is no pair; allowed: {allowed}"))
        else:
            found[name] = value
    return found, faults


def named_unit(quantity: str, unit: str) -> float | None:
    """Return the size of a unit in SI, or None."""
    plainly = unit.strip().lower()
    return UNITS[quantity].get(_SPELT.get(plainly, plainly))


def chosen_columns(
    headers: Sequence[str] | None, width: int, layout: Layout, file: str, line: int | None
) -> tuple[dict[str, tuple[int, float]], list[Fault]]:
    """Return the index and unit of each quantity, and every fault.

    Args:
        headers: of the columns, or None where there are none.
        width: number of columns.
        layout: what the user says.
        file: for the faults.
        line: of the headers.
    """
    chosen: dict[str, tuple[int, float]] = {}
    faults: list[Fault] = []
    parsed = [_split(header) for header in headers or ()]
    for quantity in QUANTITIES:
        if quantity == "time" and layout.sample_time_s is not None and "time" not in layout.columns:
            continue
        index = _column(quantity, headers, parsed, width, layout.columns.get(quantity))
        if isinstance(index, str):
            faults.append(Fault(file, line, quantity, index))
            continue
        stated = layout.units.get(quantity, parsed[index][1] if parsed else "")
        size = named_unit(quantity, stated) if stated else None
        if size is None:
            what = f"has the unit {stated!r}" if stated else "has no unit"
            if stated.lower() in _OF_A_TURN:
                what += ", of a device that turns; give what its handle does, x = r theta and F = tau/r"
            units = ", ".join("N" if unit == "n" else unit for unit in UNITS[quantity] if unit not in {"mn", "kn"})
            faults.append(
                Fault(
                    file,
                    line,
                    quantity,
                    f"{what}; allowed: {units}, in the header as {quantity}_{'n' if quantity == 'force' else units[0]} "
                    f"or with --units {quantity}=UNIT",
                )
            )
        else:
            chosen[quantity] = (index, size)
    taken = [index for index, _ in chosen.values()]
    if len(set(taken)) < len(taken):
        faults.append(Fault(file, line, "", "one column is named for two quantities; allowed: one column each"))
    return chosen, faults


def _split(header: str) -> tuple[str, str]:
    """Return name and unit of ``position_mm``, ``position [mm]`` or ``position (mm)``."""
    text = header.strip().strip('"')
    bracket = re.fullmatch(r"(.*?)\s*[\[(]\s*(\S+?)\s*[\])]", text)
    if bracket:
        return bracket[1].strip().lower(), bracket[2]
    stem, _, last = text.rpartition("_")
    known = {*_SPELT, *(unit for units in UNITS.values() for unit in units)}
    if stem and last.lower() in known:
        return stem.lower(), last
    return text.lower(), ""


def _column(
    quantity: str,
    headers: Sequence[str] | None,
    parsed: Sequence[tuple[str, str]],
    width: int,
    wanted: str | int | None,
) -> int | str:
    """Return the index of a column, or what is wrong."""
    if wanted is not None and str(wanted).isdigit():
        number = int(wanted)
        return number - 1 if 1 <= number <= width else f"is column {number}; allowed: 1 to {width}"
    if headers is None:
        return f"is not named, and there is no header; allowed: --columns {quantity}=NUMBER, 1 is the first"
    if wanted is not None:
        exact = [index for index, header in enumerate(headers) if header.strip() == wanted]
        if len(exact) == 1:
            return exact[0]
        near = difflib.get_close_matches(str(wanted), headers, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        return f"is {wanted!r}, no column; allowed: {', '.join(map(repr, headers))}{hint}"
    found = [index for index, (name, _) in enumerate(parsed) if name in _NAMES[quantity]]
    if len(found) == 1:
        return found[0]
    unknown = [header.strip() for header in headers if _stem(header) in _NAMES[quantity]]
    why = f"has no column among {', '.join(map(repr, headers[:20]))}"
    allowed = f"one, or --columns {quantity}=HEADER"
    if found:
        why = f"has {len(found)} columns among {', '.join(map(repr, headers[:20]))}"
    elif unknown:
        why = f"has a unit that is not known in {', '.join(map(repr, unknown))}"
        if any(header.rpartition("_")[2].lower() in _OF_A_TURN for header in unknown):
            why += ", that of a device that turns"
        allowed = f"{', '.join(UNITS[quantity])}, or --columns {quantity}=HEADER --units {quantity}=UNIT"
    return f"{why}; allowed: {allowed}"


def _stem(header: str) -> str:
    return header.strip().rpartition("_")[0].lower()
