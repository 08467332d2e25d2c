"""A table of values, and its two renderings: aligned text and HTML, with one way to write a number."""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from avc_casadi._errors import MissingExtraError
from avc_casadi._util.arrays import Comparable
from avc_casadi._util.units import Wording

_OF_PROBLEM = re.compile(r"\b(avc [a-z][a-z0-9-]*) P\b")


def with_problem(text: str, problem: str) -> str:
    """Return a text whose commands name the problem in place of ``P``.

    Args:
        text: plain or HTML.
        problem: file, or name of the catalogue.
    """
    return _OF_PROBLEM.sub(lambda found: f"{found[1]} {problem}", text)


Cell = float | str | None

ROWS_SHOWN = 20
_VERDICTS = {"pass": "pass", "proved": "pass", "fail": "fail", "FAIL": "fail", "refuted": "fail"}


def number(value: float | None, digits: int = 4) -> str:
    """Return a number to so many significant digits; a dash where it is undefined."""
    return "-" if value is None or math.isnan(value) else f"{value + 0.0:.{digits}g}"  # -0 is 0


def counts_text(found: Mapping[str, int]) -> str:
    """Return counts as "187 solved, 13 infeasible", without zeros."""
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
        rows: cells: numbers, whole numbers, texts, booleans, or None where empty.
        left: columns of text, aligned to the left; all others to the right.
        title: of the table.
        notes: sentences below the table.
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
        heads = [_in_a_line(cell) for cell in self.header]

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
    heads = [cell.split("\n") for cell in header]
    height = max(len(lines) for lines in heads)
    head_rows = [[lines[i] if i < len(lines) else "" for lines in heads] for i in range(height)]
    body = [[*row] for row in rows]
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
    """Return the class of a cell: that of its column, and its verdict."""
    found = " ".join(filter(None, (kind, _VERDICTS.get(cell, ""))))
    return f' class="{found}"' if found else ""


def _in_a_line(cell: str) -> str:
    return ", ".join(part for part in cell.split("\n") if part)


NOTEBOOK_ROWS = 8

Columns = dict[str, np.ndarray[Any, Any]]


def short(values: ArrayLike, unit: str | Wording = "") -> str:
    """Return the span of an array, as "0.3 to 41 N/m", or its one value; a dash where none is finite."""
    array = np.asarray(values, dtype=np.float64)
    known = array[np.isfinite(array)]
    if not known.size:
        return "-"
    low, high = float(known.min()), float(known.max())
    span = number(low) if low == high else f"{number(low)} to {number(high)}"
    return f"{span} {unit}".rstrip()


def columns_html(title: str, columns: Mapping[str, np.ndarray[Any, Any]]) -> str:
    """Return some rows of columns as an HTML table under a title, escaped."""
    rows = len(next(iter(columns.values())))
    shown = sample_rows(rows, NOTEBOOK_ROWS)
    body = tuple(tuple(_cell(column[row]) for column in columns.values()) for row in shown)
    left = tuple(index for index, column in enumerate(columns.values()) if column.dtype.kind not in "fciu")
    below = f"<p>{len(shown)} of {rows} rows</p>" if len(shown) < rows else ""
    return f"<p>{escape(title)}</p>\n{Table(tuple(columns), body, left).html()}{below}"


def _cell(value: Any) -> Cell:
    if isinstance(value, complex | np.complexfloating):
        return f"{number(float(value.real))}{'-' if value.imag < 0 else '+'}{number(abs(float(value.imag)))}j"
    if isinstance(value, np.generic):
        value = value.item()
    return value if isinstance(value, float | int | str) or value is None else str(value)


class Tabular(Comparable, ABC):
    """Base of results that are columns of equal length; dataclasses declare ``eq=False, repr=False`` with it."""

    @abstractmethod
    def to_dict(self) -> Columns:
        """Return the columns by name with unit, each of shape (rows,); the first is the index."""

    @abstractmethod
    def _summary(self) -> str:
        """Return a one-line summary."""

    def to_pandas(self) -> Any:
        """Return a pandas.DataFrame of the columns, indexed by the first; ``.to_xarray()`` makes an xarray.Dataset.

        Raises:
            MissingExtraError: pandas is not installed.
        """
        columns = self.to_dict()
        return data_frame(columns, next(iter(columns)))

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self._summary()})"

    def _repr_html_(self) -> str:
        return columns_html(repr(self), self.to_dict())


def data_frame(columns: Columns, index: str) -> Any:
    """Return columns as a pandas.DataFrame.

    Raises:
        MissingExtraError: pandas is not installed.
    """
    try:
        pandas = import_module("pandas")
    except ImportError as error:
        raise MissingExtraError(
            "to_pandas() needs pandas, which is not installed: pip install pandas; to_dict() gives the same columns "
            "without it"
        ) from error
    return pandas.DataFrame(columns).set_index(index)
