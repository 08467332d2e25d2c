"""An answer on a terminal: a headline, aligned rows with a mark each, and quantities with SI prefixes."""

from __future__ import annotations

import math
import os
import shutil
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import TextIO

_PREFIXES = {-9: "n", -6: "u", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
# Less than that in SI units is told as such.
_LEAST = 1e-12
# Lines are no longer than that where nobody says how wide the terminal is, nor on a very wide one.
_WIDTH, _WIDEST, _NARROWEST = 110, 140, 60
_COLOURS = {"✓": "32", "✗": "31", "!": "33"}
_ASCII = str.maketrans({"✓": "+", "✗": "X", "·": ";", "±": "+"})


class Mark(Enum):
    """What a row says of what it tells."""

    PASS = "✓"  # noqa: S105 - no password
    FAIL = "✗"
    CAUTION = "!"
    NONE = " "


@dataclass(frozen=True)
class Row:
    """One fact.

    Attributes:
        label: what it is of.
        text: the fact.
        mark: whether it passes.
    """

    label: str
    text: str
    mark: Mark = Mark.NONE


@dataclass(frozen=True)
class Page:
    """Where an answer is printed.

    Attributes:
        width: longest line.
        colour: whether marks have one.
        plain: whether it takes ASCII alone.
    """

    width: int = _WIDTH
    colour: bool = False
    plain: bool = False

    @classmethod
    def of(cls, stream: TextIO | None) -> Page:
        """Return that of a stream; a colour only on a terminal and without NO_COLOR (https://no-color.org)."""
        if stream is None:
            return cls()
        terminal = stream.isatty()
        width = shutil.get_terminal_size((_WIDTH, 24)).columns if terminal else _WIDTH
        colour = terminal and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"
        return cls(min(max(width, _NARROWEST), _WIDEST), colour, not _takes_marks(stream.encoding))

    def rendered(self, headline: str, rows: Sequence[Row], commands: Sequence[str] = ()) -> str:
        """Return an answer as text.

        Args:
            headline: what it is about.
            rows: facts, one a line; a long one goes on below itself.
            commands: what to type next.
        """
        label = max((len(row.label) for row in rows), default=0)
        lines = [headline, ""]
        for row in rows:
            first, *more = textwrap.wrap(row.text, self.width - label - 6, break_on_hyphens=False) or [""]
            lines.append(f"  {self._marked(row.mark)} {row.label:<{label}}  {first}".rstrip())
            lines += [f"{'':{label + 6}}{line}" for line in more]
        if commands:
            lines += ["", f"  next: {'    '.join(commands)}"]
        text = "\n".join(lines)
        return text.translate(_ASCII) if self.plain else text

    def _marked(self, mark: Mark) -> str:
        colour = _COLOURS.get(mark.value) if self.colour else None
        return mark.value if colour is None else f"\x1b[{colour}m{mark.value}\x1b[0m"


def _takes_marks(encoding: str | None) -> bool:
    try:
        "✓✗·±".encode(encoding or "utf-8")
    except (UnicodeEncodeError, LookupError):
        return False
    return True


def quantity(value: float | None, unit: str, digits: int = 3) -> str:
    """Return a value with its unit, to so many significant digits: 99 040 N/m as ``99.0 kN/m``; a dash for none.

    Args:
        value: in the unit, which may have a prefix of its own only where it is the kilogram.
        unit: such as ``N/m``; a mass is told in grams.
        digits: significant ones.
    """
    if value is None or math.isnan(value):
        return "-"
    if unit.startswith("kg"):
        value, unit = 1e3 * value, unit[1:]
    if math.isinf(value):
        return f"{'-' if value < 0 else ''}unbounded"
    if value == 0:
        return f"0 {unit}"
    if abs(value) < _LEAST:
        return f"below 0.001 n{unit}"
    exponent = int(f"{value:.{digits - 1}e}".partition("e")[2])
    group = min(max(3 * (exponent // 3), min(_PREFIXES)), max(_PREFIXES))
    decimals = max(0, digits - 1 - (exponent - group))
    return f"{value / 10.0**group:.{decimals}f} {_PREFIXES[group]}{unit}"


def percent(share: float | None) -> str:
    """Return a share as a percentage to two significant digits, or three above 99 %."""
    if share is None or math.isnan(share):
        return "-"
    value = 100 * share
    return f"{value:.1f} %" if 99 <= value < 99.95 else f"{value:.2g} %" if value < 99 else f"{value:.0f} %"
