"""An answer: rows of values, each with its quantity; units, marks and layout are known here alone."""

from __future__ import annotations

import math
import os
import shutil
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from string import Formatter
from typing import TYPE_CHECKING, Any, TextIO, get_args

from avc_casadi._util.open_end import AboveZero
from avc_casadi._util.text import number, percent, quantity
from avc_casadi._util.units import LINEAR, Quantity, Units

if TYPE_CHECKING:
    from avc_casadi._util.arrays import Interval

# Numbers that differ by this share are the same.
_SAME_NUMBER = 1e-9
# Ending of keys and unit of each quantity, the longest ending first.
QUANTITIES: dict[Quantity, tuple[str, str]] = {
    "damping": ("_ns_per_m", "N.s/m"),
    "stiffness": ("_n_per_m", "N/m"),
    "integral": ("_n_per_m_s", "N/m/s"),
    "speed": ("_m_per_s", "m/s"),
    "mass": ("_kg", "kg"),
    "frequency": ("_hz", "Hz"),
    "force": ("_n", "N"),
    "length": ("_m", "m"),
    "time": ("_s", "s"),
    "energy": ("_j", "J"),
    "phase": ("_deg", ""),
    "samples": ("_samples", ""),
    "share": ("share", ""),
}
MOST_ROWS = 15
"""Rows of an answer on a terminal."""
MOST_LINES = 23
"""Lines of it."""
WIDTH = 100
"""Length of a line."""
_ALL_DIGITS = 9
"""Digits of a number of things."""
_KEPT_ROWS = 5
"""First rows of an answer, which are never left out."""


class Mark(Enum):
    """Verdict of a row."""

    PASS = "✓"  # noqa: S105 - no password
    FAIL = "✗"
    CAUTION = "!"
    NONE = " "


_COLOURS = {Mark.PASS: "32", Mark.FAIL: "31", Mark.CAUTION: "33"}
"""Colours of marks on a terminal, by their ANSI numbers."""


_NAMED: dict[str, Quantity] = {name: name for name in get_args(Quantity)}
"""Quantities by their names."""


def quantity_of(key: str) -> Quantity:
    """Return what a value measures by the ending of its key."""
    return next((of for of, (ending, _) in QUANTITIES.items() if key.endswith(ending)), "number")


@dataclass(frozen=True)
class Value:
    """A number and what it measures, in SI units of a linear device; `how` rounds it up or down where it is printed.

    `beside` is a number with whose unit it is printed, where the unit of an inertia depends on its size.
    """

    number: float | None
    quantity: Quantity
    digits: int = 3
    how: Callable[[float], int] | None = None
    beside: float | None = None

    @classmethod
    def of(cls, key: str, number: float | None, digits: int = 3) -> Value:
        """Return the value of a key, which measures what its ending says."""
        return cls(number, quantity_of(key), digits)

    @property
    def printed(self) -> float | None:
        """The number as it is printed."""
        if self.number is None or self.how is None:
            return self.number
        return _rounded(self.number, self.digits, self.how)

    def text(self, units: Units) -> str:
        """Return the number with its unit for a device that slides or turns."""
        value, unit = self.printed, QUANTITIES.get(self.quantity, ("", ""))[1]
        if unit:
            return quantity(value, units.unit(unit), self.digits, self.beside)
        if self.quantity == "share":
            return percent(value)
        if self.quantity == "number":
            return number(value, self.digits)
        if value is None or math.isinf(value):
            return "unlimited"
        if self.quantity == "gain":
            return f"{20 * math.log10(value):.1f} dB" if value > 0 else "-"
        text, of = number(value, self.digits), "deg" if self.quantity == "phase" else self.quantity
        return f"{text} {of.removesuffix('s') if text == '1' else of}"


def count(number: int) -> Value:
    """Return a number of things, with all its digits."""
    return Value(number, "number", _ALL_DIGITS)


Part = Value | str
Parts = Part | None | Iterable["Parts"]


def parts(*given: Parts) -> tuple[Part, ...]:
    """Return values and texts in one sequence, without those that are empty."""
    flat: list[Part] = []
    for part in given:
        if isinstance(part, Value | str):
            flat += [part] if part != "" else []
        elif part is not None:
            flat += parts(*part)
    return tuple(flat)


def text_of(values: Iterable[Part], units: Units, tie: str = " ") -> str:
    """Return values and texts as one line; ``tie`` stands between a number and its unit."""
    line = ""
    for value in values:
        text = value if isinstance(value, str) else value.text(units).replace(" ", tie)
        close = not line or line.endswith("(") or text[:1] in {",", ";", ")", ":"}
        line += text if close else f" {text}"
    return line


def fill(template: str, values: Mapping[str, Any]) -> tuple[Part, ...]:
    """Return a template with the value of each {key} in its quantity; a colon begins its digits, or its quantity."""
    filled: list[Parts] = []
    for text, key, how, _ in Formatter().parse(template):
        filled.append(text.strip())
        if key is not None:
            value = values[key]
            quantity = _NAMED.get(how or "", quantity_of(key))
            digits = int(how) if how and how.isdigit() else 3
            filled.append(value if isinstance(value, str) else Value(value, quantity, digits))
    return parts(*filled)


def commas(groups: Iterable[Parts], between: str = ",") -> tuple[Part, ...]:
    """Return groups with a comma between them."""
    joined: list[Part] = []
    for group in groups:
        flat = parts(group)
        if flat:
            joined += [between] if joined else []
            joined += flat
    return tuple(joined)


def span(values: Iterable[float | None], of: Quantity) -> tuple[Part, ...]:
    """Return the lowest and the highest value, or the only one."""
    known = [value for value in values if value is not None]
    low, high = min(known), max(known)
    return (Value(low, of),) if low == high else (Value(low, of), "to", Value(high, of))


def stable_ends(ends: Interval, of: Quantity, digits: int = 3) -> tuple[Parts, Value]:
    """Return the ends of a stable interval, rounded into it, so that a value that is typed as printed is stable."""
    lowest, highest = ends
    low: Parts = least_value(lowest, of, digits)
    if isinstance(lowest, AboveZero):
        low = ("above", Value(0.0, of))
    return low, largest_value(highest, of, digits)


def largest_value(value: float, of: Quantity, digits: int = 3) -> Value:
    """Return a value up to which all is well, rounded down, so that it is well as it is printed too."""
    return Value(value, of, digits, math.floor)


def least_value(value: float, of: Quantity, digits: int = 3) -> Value:
    """Return a value from which on all is well, rounded up, so that it is well as it is printed too."""
    return Value(value, of, digits, math.ceil)


def beyond_limit(value: float, limit: float, of: Quantity, *, is_lower: bool) -> tuple[Value, Value]:
    """Return a value and the limit that it is beyond, rounded into what is stable, with digits that tell them apart."""
    rounded = least_value if is_lower else largest_value
    beyond, at_limit = Value(value, of), rounded(limit, of)
    while beyond.text(LINEAR) == at_limit.text(LINEAR) and at_limit.digits < _ALL_DIGITS:
        beyond = replace(beyond, digits=beyond.digits + 1)
        at_limit = replace(at_limit, digits=at_limit.digits + 1)
    return beyond, at_limit


def _rounded(value: float, digits: int, how: Callable[[float], int]) -> float:
    """Return a value with so many significant digits, up or down; a value that has no more of them as it is."""
    if value == 0 or not math.isfinite(value):
        return value
    nearest = float(f"{value:.{digits}g}")
    if math.isclose(nearest, value, rel_tol=_SAME_NUMBER):
        return nearest
    power = digits - 1 - math.floor(math.log10(abs(value)))
    return float(f"{how(value * 10.0**power)}e{-power}")


@dataclass(frozen=True)
class Row:
    """A fact of an answer: its subject, its values, whether it passes; rank 0 is printed, 1 with -v, -1 always."""

    label: str
    values: tuple[Part, ...]
    mark: Mark = Mark.NONE
    rank: int = 0

    def name(self, units: Units) -> str:
        """Return its label; a device that turns has torques and an inertia."""
        named = self.label
        for word, turning in () if units.linear else (("Force", "Torque"), ("force", "torque"), ("mass", "inertia")):
            named = named.replace(word, turning)
        return named

    def text(self, units: Units) -> str:
        """Return its values as one line."""
        return text_of(self.values, units)


def row(label: str, *values: Parts, mark: Mark = Mark.NONE, rank: int = 0) -> Row:
    """Return a row of values and texts."""
    return Row(label, parts(*values), mark, rank)


def grade(passed: bool, otherwise: Mark = Mark.FAIL) -> Mark:
    """Return the mark of a verdict."""
    return Mark.PASS if passed else otherwise


def verdict_mark(passed: bool, sound: bool) -> Mark:
    """Return the mark of a verdict on deployment: a caution where it may be deployed, but something is doubted."""
    return grade(sound, Mark.CAUTION) if passed else Mark.FAIL


def caution(doubt: object) -> Mark:
    """Return the mark of what is only noted unless there is a doubt."""
    return Mark.CAUTION if doubt else Mark.NONE


@dataclass(frozen=True)
class Answer:
    """What a command has found: the same rows on terminal, report, page and notebook, and JSON values.

    ``commands`` are to be typed next; with a complaint the answer is no; ``code`` is of one that is no by its rows.
    """

    kind: str
    data: Mapping[str, Any]
    title: tuple[Part, ...] = ()
    rows: tuple[Row, ...] = ()
    commands: tuple[str, ...] = ()
    units: Units = LINEAR
    whole: bool = False
    complaint: str = ""
    code: int = 0

    def document(self) -> dict[str, Any]:
        """Return the JSON document in the names of the device's motion."""
        head = {"schema": "avc/1", "kind": self.kind}
        return self.units.document({**head, **self.data, **head})


@dataclass(frozen=True)
class Page:
    """Properties of an output stream: longest line, whether marks have a colour, whether it takes ASCII alone."""

    width: int = WIDTH
    colour: bool = False
    plain: bool = False

    @classmethod
    def of(cls, stream: TextIO | None) -> Page:
        """Return the page of a stream; a colour only on a terminal and without NO_COLOR (https://no-color.org)."""
        if stream is None:
            return cls()
        terminal = stream.isatty()
        width = min(max(shutil.get_terminal_size((WIDTH, 24)).columns, 60), WIDTH) if terminal else WIDTH
        colour = terminal and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"
        try:
            "✓✗·±".encode(stream.encoding or "utf-8")
        except (UnicodeEncodeError, LookupError):
            return cls(width, colour, plain=True)
        return cls(width, colour)

    def rendered(self, answer: Answer, *, verbose: bool = False) -> str:
        """Return an answer as text; without verbose it ends with a screen, but for five rows and those with a mark."""
        rows = [fact for fact in answer.rows if verbose or fact.rank <= 0]
        spare: list[Row] = []
        if not verbose and not answer.whole:
            spare = [fact for fact in rows[_KEPT_ROWS:] if fact.mark is Mark.NONE and fact.rank == 0]
        lines = self._lines(answer, rows)
        labels: list[str] = []
        while spare and (len(rows) > MOST_ROWS or len(lines) > MOST_LINES):
            rows.remove(spare[-1])
            labels.insert(0, spare.pop().name(answer.units))
            left_out = f"left out: {', '.join(dict.fromkeys(labels))}; -v shows all"
            lines = [*self._lines(answer, rows), *textwrap.wrap(left_out, self.width, initial_indent="  ")]
        text = "\n".join(lines)
        return text.translate(str.maketrans("✓✗·±", "+X;+")) if self.plain else text

    def _lines(self, answer: Answer, rows: Sequence[Row]) -> list[str]:
        """Return the lines of an answer with these rows: title, marked and labelled rows, next commands."""
        label = max((len(fact.name(answer.units)) for fact in rows), default=0)
        lines = [*_broken(answer.title, answer.units, self.width), ""] if answer.title else []
        for fact in rows:
            first, *more = _broken(fact.values, answer.units, self.width - label - 6) or [""]
            colour = _COLOURS.get(fact.mark) if self.colour else None
            mark = fact.mark.value if colour is None else f"\x1b[{colour}m{fact.mark.value}\x1b[0m"
            lines.append(f"  {mark} {fact.name(answer.units):<{label}}  {first}".rstrip())
            lines += [f"{'':{label + 6}}{line}" for line in more]
        if answer.commands:
            onwards = "    ".join(answer.commands)
            between = "    " if len(onwards) + 8 <= self.width else f"\n{'':8}"
            lines += ["", *f"  next: {between.join(answer.commands)}".split("\n")]
        return lines


def _broken(values: Iterable[Part], units: Units, width: int) -> list[str]:
    """Return values and texts as lines; a number keeps its unit."""
    lines = textwrap.wrap(text_of(values, units, tie="\0"), width, break_on_hyphens=False)
    return [line.replace("\0", " ") for line in lines]
