"""A table of values, and its two renderings: aligned text and HTML, with one way to write a number."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape

from avc_casadi.support._units import spoken

Cell = float | str | None

ROWS_SHOWN = 20
_VERDICTS = {"pass": "pass", "proved": "pass", "fail": "fail", "FAIL": "fail", "refuted": "fail"}


def number(value: float | None, digits: int = 4) -> str:
    """Return a number to so many significant digits; a dash where it is undefined."""
    return "-" if value is None or math.isnan(value) else f"{value + 0.0:.{digits}g}"  # -0 is 0


def counts_text(found: Mapping[str, int]) -> str:
    """Return counts as "187 solved, 13 infeasible", leaving out what does not occur."""
    return ", ".join(f"{count} {name}" for name, count in found.items() if count) or "none"


def rows_text(rows: int) -> str:
    """Return a number of rows in words: "1 row", "3 rows"."""
    return f"{rows} row{'' if rows == 1 else 's'}"


def sample_rows(rows: int, most: int = ROWS_SHOWN) -> list[int]:
    """Return at most so many row numbers, evenly spread, first and last among them."""
    if rows <= most:
        return list(range(rows))
    return sorted({round(i * (rows - 1) / (most - 1)) for i in range(most)})


@dataclass(frozen=True)
class Table:
    """Values in rows and columns.

    Attributes:
        header: one cell a column: its name, and its unit on a line of its own.
        rows: cells: numbers, whole numbers, texts, yes or no, or None where there is nothing.
        left: columns of text, aligned to the left; all others to the right.
        title: what the table shows.
        notes: sentences that stand beside it.
        digits: significant digits of its numbers.
    """

    header: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    left: tuple[int, ...] = ()
    title: str = ""
    notes: tuple[str, ...] = ()
    digits: int = 4

    def text(self) -> str:
        """Return the header and rows as aligned text."""
        return text_table(self.header, self._cells(), left=self.left)

    def html(self) -> str:
        """Return the header and rows as an HTML table; every text is escaped, verdicts are classes of their cells."""
        right = ["" if column in self.left else "n" for column in range(len(self.header))]
        heads = [_in_a_line(spoken().text(cell)) for cell in self.header]

        def row(cells: Iterable[str], tag: str, more: str) -> str:
            inner = (
                f"<{tag}{more}{_classes(kind, cell)}>{escape(cell)}</{tag}>"
                for kind, cell in zip(right, cells, strict=True)
            )
            return f"<tr>{''.join(inner)}</tr>"

        body = "\n".join(row(cells, "td", "") for cells in self._cells())
        head = row(heads, "th", ' scope="col"')
        return f"<table>\n<thead>{head}</thead>\n<tbody>\n{body}\n</tbody>\n</table>"

    def _cells(self) -> list[list[str]]:
        return [[_shown(cell, self.digits) for cell in row] for row in self.rows]


def text_table(header: Sequence[str], rows: Iterable[Sequence[str]], *, left: Sequence[int] = ()) -> str:
    """Align cells in columns; a header cell may hold several lines.

    Args:
        header: one cell a column.
        rows: cells.
        left: columns aligned to the left; all others to the right.
    """
    heads = [spoken().text(cell).split("\n") for cell in header]
    height = max(len(lines) for lines in heads)
    head_rows = [[lines[i] if i < len(lines) else "" for lines in heads] for i in range(height)]
    body = [[spoken().text(cell) for cell in row] for row in rows]
    widths = [max(len(row[column]) for row in [*head_rows, *body]) for column in range(len(header))]

    def line(row: Sequence[str]) -> str:
        cells = zip(row, widths, range(len(widths)), strict=True)
        return "  ".join(c.ljust(w) if i in left else c.rjust(w) for c, w, i in cells).rstrip()

    return "\n".join([*map(line, head_rows), line(["-" * width for width in widths]), *map(line, body)])


def _shown(cell: Cell, digits: int) -> str:
    if isinstance(cell, bool):
        return "yes" if cell else "no"
    if isinstance(cell, int | str):
        return str(cell)
    return number(cell, digits)


def _classes(kind: str, cell: str) -> str:
    """Return the class of a cell: that of its column, and the verdict that it tells."""
    found = " ".join(filter(None, (kind, _VERDICTS.get(cell, ""))))
    return f' class="{found}"' if found else ""


def _in_a_line(cell: str) -> str:
    return ", ".join(part for part in cell.split("\n") if part)
