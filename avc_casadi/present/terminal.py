"""Layout of results on a terminal: a headline, and aligned rows with a mark each."""

from __future__ import annotations

import os
import shutil
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import TextIO

# Default line width where the terminal's is unknown, its maximum, and its minimum.
_WIDTH, _WIDEST, _NARROWEST = 110, 140, 60
MOST_LINES = 15
"""Lines of a summary."""
_COLOURS = {"✓": "32", "✗": "31", "!": "33"}
_ASCII = str.maketrans({"✓": "+", "✗": "X", "·": ";", "±": "+"})


class Mark(Enum):
    """Verdict of a row."""

    PASS = "✓"  # noqa: S105 - no password
    FAIL = "✗"
    CAUTION = "!"
    NONE = " "


@dataclass(frozen=True)
class Row:
    """One row."""

    label: str
    text: str
    mark: Mark = Mark.NONE


@dataclass(frozen=True)
class Page:
    """Properties of the output stream."""

    width: int = _WIDTH
    colour: bool = False
    plain: bool = False

    @classmethod
    def of(cls, stream: TextIO | None) -> Page:
        """Return the page of a stream; a colour only on a terminal and without NO_COLOR (https://no-color.org)."""
        if stream is None:
            return cls()
        terminal = stream.isatty()
        width = shutil.get_terminal_size((_WIDTH, 24)).columns if terminal else _WIDTH
        colour = terminal and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"
        return cls(min(max(width, _NARROWEST), _WIDEST), colour, not _takes_marks(stream.encoding))

    def rendered(
        self, headline: str, rows: Sequence[Row], commands: Sequence[str] = (), spare: Sequence[str] = ()
    ) -> str:
        """Return a result as text."""
        lines = self._lines(headline, rows, commands)
        for label in spare:
            if len(lines) <= MOST_LINES:
                break
            rows = [row for row in rows if row.label != label or row.mark is not Mark.NONE]
            lines = self._lines(headline, rows, commands)
        text = "\n".join(lines)
        return text.translate(_ASCII) if self.plain else text

    def _lines(self, headline: str, rows: Sequence[Row], commands: Sequence[str]) -> list[str]:
        label = max((len(row.label) for row in rows), default=0)
        lines = [headline, ""]
        for row in rows:
            first, *more = textwrap.wrap(row.text, self.width - label - 6, break_on_hyphens=False) or [""]
            lines.append(f"  {self._marked(row.mark)} {row.label:<{label}}  {first}".rstrip())
            lines += [f"{'':{label + 6}}{line}" for line in more]
        if commands:
            lines += ["", f"  next: {'    '.join(commands)}"]
        return lines

    def _marked(self, mark: Mark) -> str:
        colour = _COLOURS.get(mark.value) if self.colour else None
        return mark.value if colour is None else f"\x1b[{colour}m{mark.value}\x1b[0m"


def _takes_marks(encoding: str | None) -> bool:
    try:
        "✓✗·±".encode(encoding or "utf-8")
    except (UnicodeEncodeError, LookupError):
        return False
    return True
