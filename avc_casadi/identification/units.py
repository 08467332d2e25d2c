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
    "force": (
        "force",
        "f",
        "u",
        "command",
        "commanded_force",
        "force_command",
        "force_cmd",
        "cmd_force",
        "effort",
        "torque",
        "tau",
        "moment",
    ),
}
# What to do where a log holds something else.
_ELSE = {
    "time": "; of a log without time --sample-time S",
    "position": "; of a velocity its integral, added as a column",
    "force": "; of a current that times the motor's constant, in N or N.m, added as a column",
}
_ALSO = {"angle": "position", "torque": "force"}
UNITS: Mapping[str, Mapping[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "position": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "nm": 1e-9},
    "force": {"n": 1.0, "mn": 1e-3, "kn": 1e3},
}
TURNED: Mapping[str, Mapping[str, float]] = {
    "time": {},
    "position": {"rad": 1.0, "deg": math.pi / 180, "mrad": 1e-3, "urad": 1e-6},
    "force": {"n.m": 1.0, "mn.m": 1e-3, "kn.m": 1e3, "nm": 1.0, "mnm": 1e-3, "unm": 1e-6},
}
"""Units of a rotary device; no unit of a quantity belongs to both kinds of motion."""
_SPELT = {"sec": "s", "seconds": "s", "micros": "us", "millis": "ms", "µs": "us", "µm": "um", "newton": "n"} | {
    "degrees": "deg",
    "degree": "deg",
    "°": "deg",
    "radians": "rad",
    "µrad": "urad",
    "n*m": "n.m",
    "n·m": "n.m",
    "mn*m": "mn.m",
}


@dataclass(frozen=True)
class Unit:
    """A unit of a quantity.

    Attributes:
        size: in SI units.
        motion: of the device that has it; None of a time.
    """

    size: float
    motion: MotionKind | None = None


@dataclass(frozen=True)
class Column:
    """Column and unit of a quantity."""

    index: int
    unit: Unit


@dataclass(frozen=True)
class Layout:
    """Columns and units of a log, as given by the user.

    Attributes:
        columns: by quantity, a header or a number (1 is the first column); others are found by their headers.
        units: by quantity; others are found in the header, ``position_mm`` or ``position [mm]``.
        sample_time_s: where the log has no time.
    """

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


def named_unit(quantity: str, unit: str) -> Unit | None:
    """Return a unit by its name, or None."""
    plainly = unit.strip().lower()
    plainly = _SPELT.get(plainly, plainly)
    if plainly in UNITS[quantity]:
        return Unit(UNITS[quantity][plainly], None if quantity == "time" else "linear")
    return Unit(TURNED[quantity][plainly], "rotary") if plainly in TURNED[quantity] else None


def motion_of(chosen: Mapping[str, Column]) -> MotionKind:
    """Return the motion of the device of a log."""
    return "rotary" if any(one.unit.motion == "rotary" for one in chosen.values()) else "linear"


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
            if spare:
                continue
            faults.append(Fault(file, line, quantity, index))
            continue
        stated = layout.units.get(quantity, parsed[index][1] if parsed else "")
        unit = named_unit(quantity, stated) if stated else None
        if unit is None and spare:
            continue
        if unit is None:
            what = f"has the unit {stated!r}" if stated else "has no unit"
            example = {"time": "time_s", "position": "position_m or angle_rad", "force": "force_n or torque_nm"}
            faults.append(
                Fault(
                    file,
                    line,
                    quantity,
                    f"{what}; allowed: {_allowed(quantity)}, in the header as {example[quantity]} or with --units "
                    f"{quantity}=UNIT",
                )
            )
        else:
            chosen[quantity] = Column(index, unit)
    taken = [one.index for one in chosen.values()]
    if len(set(taken)) < len(taken):
        faults.append(Fault(file, line, "", "one column is named for two quantities; allowed: one column each"))
    motions = {one.unit.motion for one in chosen.values()} - {None}
    if len(motions) > 1:
        turns, goes = ("position", "force") if chosen["position"].unit.motion == "rotary" else ("force", "position")
        message = (
            f"turns and {goes} goes in a line, by their units; allowed: both of a device that turns (rad or deg, N.m), "
            "or both of one that does not (m, N)"
        )
        faults.append(Fault(file, line, turns, message))
    return chosen, faults


def _allowed(quantity: str) -> str:
    """Return the usual units of a quantity."""
    if quantity == "force":
        return "N, mN, kN, or N.m, mN.m of a device that turns (a current times the motor's constant)"
    units = ", ".join(UNITS[quantity]) + (" (counts times the encoder's step)" if quantity == "position" else "")
    return units if quantity == "time" else f"{units}, or {', '.join(TURNED[quantity])} of a device that turns"


def _split(header: str) -> tuple[str, str]:
    """Return name and unit of ``position_mm``, ``position [mm]`` or ``position (mm)``."""
    text = header.strip().strip('"')
    bracket = re.fullmatch(r"(.*?)\s*[\[(]\s*(\S+?)\s*[\])]", text)
    if bracket:
        return bracket[1].strip().lower(), bracket[2]
    stem, _, last = text.rpartition("_")
    known = {*_SPELT, *(unit for kind in (UNITS, TURNED) for units in kind.values() for unit in units)}
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
    """Return the index of a column, or the fault."""
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
    allowed = f"one, or --columns {quantity}=HEADER{_ELSE[quantity]}"
    if found:
        why = f"has {len(found)} columns among {', '.join(map(repr, headers[:20]))}"
    elif unknown:
        why = f"has a unit that is not known in {', '.join(map(repr, unknown))}"
        allowed = f"{_allowed(quantity)}, or --columns {quantity}=HEADER --units {quantity}=UNIT"
    return f"{why}; allowed: {allowed}"


def _stem(header: str) -> str:
    return header.strip().rpartition("_")[0].lower()
