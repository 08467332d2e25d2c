"""Columns of a log: their quantities and units, from headers and options."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from avc_casadi._errors import Fault
from avc_casadi._util.units import MotionKind

QUANTITIES = ("time", "position", "force")
_NAMES = {
    "time": ("time", "t", "timestamp", "stamp", "clock"),
    "position": ("position", "pos", "x", "q", "displacement", "y", "angle", "theta", "phi"),
    "force": ("force", "f", "u", "command", "force_command", "cmd_force", "effort", "torque", "tau", "moment"),
}
# What to do where a log holds something else.
_ELSE = {
    "time": "; of a log without time --sample-time S",
    "position": "; of a velocity its integral, added as a column",
    "force": "; of a current that times the motor's constant, in N or N.m, added as a column",
}
_ALSO = {"angle": "position", "torque": "force"}
# Size in SI units, and the motion of the device that has the unit.
_UNITS: Mapping[str, Mapping[str, tuple[float, MotionKind | None]]] = {
    "time": {"s": (1.0, None), "ms": (1e-3, None), "us": (1e-6, None), "ns": (1e-9, None)},
    "position": {
        **{
            name: (size, "linear")
            for name, size in (("m", 1.0), ("cm", 1e-2), ("mm", 1e-3), ("um", 1e-6), ("nm", 1e-9))
        },
        **{name: (size, "rotary") for name, size in (("rad", 1.0), ("mrad", 1e-3), ("urad", 1e-6))},
        "deg": (math.pi / 180, "rotary"),
    },
    "force": {
        **{name: (size, "linear") for name, size in (("n", 1.0), ("mn", 1e-3), ("kn", 1e3))},
        **{name: (size, "rotary") for name, size in (("n.m", 1.0), ("mn.m", 1e-3), ("kn.m", 1e3))},
        **{name: (size, "rotary") for name, size in (("nm", 1.0), ("mnm", 1e-3), ("unm", 1e-6))},
    },
}
_SPELT = {
    **dict.fromkeys(("sec", "seconds"), "s"),
    **dict.fromkeys(("degrees", "degree", "°"), "deg"),
    **dict.fromkeys(("n*m", "n·m"), "n.m"),
    "micros": "us",
    "µs": "us",
    "millis": "ms",
    "µm": "um",
    "newton": "n",
    "radians": "rad",
    "µrad": "urad",
}
_USUAL = {
    "time": "s, ms, us, ns, in the header as time_s",
    "position": "m, cm, mm, um (counts times the encoder's step), rad, deg, in the header as position_m or angle_rad",
    "force": "N, mN, kN, or N.m, mN.m (a current times the motor's constant), in the header as force_n or torque_nm",
}


@dataclass(frozen=True)
class Column:
    """Column and unit of a quantity: its size in SI units, and the motion of the device that has it."""

    index: int
    size: float
    motion: MotionKind | None


@dataclass(frozen=True)
class Layout:
    """Columns (headers, or numbers from 1) and units by quantity, and the sample time of a log without time."""

    columns: Mapping[str, str | int] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    sample_time_s: float | None = None


def pairs_of(texts: Sequence[str], key: str) -> tuple[dict[str, str], list[Fault]]:
    """Parse ``time=1,position=2`` as the columns and units of an option; an angle is a position, a torque a force."""
    found: dict[str, str] = {}
    faults = []
    for part in (part.strip() for text in texts for part in text.split(",") if part.strip()):
        name, _, value = part.partition("=")
        name = _ALSO.get(name, name)
        if name not in QUANTITIES or not value:
            allowed = ", ".join(f"{one}=..." for one in QUANTITIES)
            faults.append(Fault("", None, key, f"{part!r} is no pair; allowed: {allowed}"))
        else:
            found[name] = value
    return found, faults


def motion_of(chosen: Mapping[str, Column]) -> MotionKind:
    """Return the motion of the device of a log."""
    return "rotary" if any(one.motion == "rotary" for one in chosen.values()) else "linear"


def chosen_columns(
    headers: Sequence[str] | None, width: int, layout: Layout, file: str, line: int | None
) -> tuple[dict[str, Column], list[Fault]]:
    """Return the index and unit of each quantity, and every fault; headers are None where there are none."""
    chosen: dict[str, Column] = {}
    faults: list[Fault] = []
    parsed = [_split(header) for header in headers or ()]
    for quantity in QUANTITIES:
        index = _column(quantity, headers, parsed, width, layout.columns.get(quantity))
        # A sample time replaces a missing time, or one of writing.
        spare = quantity == "time" and layout.sample_time_s is not None and "time" not in layout.columns
        if isinstance(index, str):
            faults += [] if spare else [Fault(file, line, quantity, index)]
            continue
        stated = layout.units.get(quantity, parsed[index][1] if parsed else "").strip()
        unit = _UNITS[quantity].get(_SPELT.get(stated.lower(), stated.lower()))
        if unit is not None:
            chosen[quantity] = Column(index, *unit)
        elif not spare:
            what = f"has the unit {stated!r}" if stated else "has no unit"
            allowed = f"{_USUAL[quantity]}, or with --units {quantity}=UNIT"
            faults.append(Fault(file, line, quantity, f"{what}; allowed: {allowed}"))
    taken = [one.index for one in chosen.values()]
    if len(set(taken)) < len(taken):
        faults.append(Fault(file, line, "", "one column is named for two quantities; allowed: one column each"))
    if len({one.motion for one in chosen.values()} - {None}) > 1:
        turns = next(quantity for quantity, one in chosen.items() if one.motion == "rotary")
        message = "turns and the rest of the log goes in a line, by their units; allowed: rad and N.m, or m and N"
        faults.append(Fault(file, line, turns, message))
    return chosen, faults


def _split(header: str) -> tuple[str, str]:
    """Return name and unit of ``position_mm``, ``position [mm]`` or ``position (mm)``."""
    text = header.strip().strip('"')
    bracket = re.fullmatch(r"(.*?)\s*[\[(]\s*(\S+?)\s*[\])]", text)
    if bracket:
        return bracket[1].strip().lower(), bracket[2]
    stem, _, last = text.rpartition("_")
    known = last.lower() in {*_SPELT, *(unit for units in _UNITS.values() for unit in units)}
    return (stem.lower(), last) if stem and known else (text.lower(), "")


def _column(
    quantity: str,
    headers: Sequence[str] | None,
    parsed: Sequence[tuple[str, str]],
    width: int,
    wanted: str | int | None,
) -> int | str:
    """Return the index of a column, or the fault."""
    if wanted is not None and str(wanted).isdigit():
        number = int(wanted)
        return number - 1 if 1 <= number <= width else f"is column {number}; allowed: 1 to {width}"
    if headers is None:
        return f"is not named, and there is no header; allowed: --columns {quantity}=NUMBER, 1 is the first"
    if wanted is not None:
        exact = [index for index, header in enumerate(headers) if header.strip() == wanted]
        near = difflib.get_close_matches(str(wanted), headers, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        return exact[0] if len(exact) == 1 else f"is {wanted!r}, no column; allowed: {', '.join(headers[:20])}{hint}"
    found = [index for index, (name, _) in enumerate(parsed) if name in _NAMES[quantity]]
    if len(found) == 1:
        return found[0]
    unknown = [header.strip() for header in headers if header.rpartition("_")[0].strip().lower() in _NAMES[quantity]]
    if unknown and not found:
        return f"has a unit that is not known in {', '.join(unknown)}; allowed: {_USUAL[quantity]}"
    many = f"{len(found)} columns" if found else "no column"
    allowed = f"one, or --columns {quantity}=HEADER{_ELSE[quantity]}"
    return f"has {many} among {', '.join(map(repr, headers[:20]))}; allowed: {allowed}"
