"""Logs as text, parsed in pieces to bound the memory."""

from __future__ import annotations

import csv
import re
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import BinaryIO

import numpy as np

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.arrays import FloatArray, IndexArray
from avc_casadi._util.units import FORCE
from avc_casadi.identification.record import TOLD, faults_of_rows
from avc_casadi.identification.units import QUANTITIES, Column, Layout, chosen_columns

_COMMA = re.compile(r"\d,\d+'$")
# A longer line is no row of numbers; a hundred channels are a thousand characters.
_LONGEST_ROW = 50_000
_PIECE_BYTES = 2**20
_MOST_ROWS, _MOST_RECORDS = 10_000_000, 1000
_MARKS = ("#", "%")
# Comment lines above the first row that may name its columns.
_REMARKS = 100

_Row = tuple[int, str]


@dataclass
class TextLog:
    """The columns of a text log while it is parsed.

    Attributes:
        file: name in faults.
        layout: columns and units, as given by the user.
        chosen: column of each quantity.
        faults: of the text.
        told: notes for the user on what was changed.
    """

    file: str
    layout: Layout
    chosen: dict[str, Column] = field(default_factory=dict)
    faults: list[Fault] = field(default_factory=list)
    told: tuple[str, ...] = ()
    _mark: str | None = None
    _width: int = 0
    _group: int | None = None
    _may_lack_clock: bool = False
    _rows: int = 0
    _last: list[_Row] = field(default_factory=list)
    _values: dict[str, list[tuple[FloatArray, IndexArray]]] = field(default_factory=dict)
    _wrong: dict[str, list[tuple[int | None, str]]] = field(default_factory=dict)
    _counts: Counter[str] = field(default_factory=Counter)

    @classmethod
    def of(cls, stream: BinaryIO, file: str, layout: Layout) -> TextLog:
        """Parse a text.

        Raises:
            InputError: it is no text of rows, or has too many.
        """
        log, remarks = cls(file, layout), deque[_Row](maxlen=_REMARKS)
        pieces = _pieces(stream, file, remarks)
        first: list[_Row] = []
        for piece in pieces:
            first += piece
            if len(first) > 1:
                break
        if not first:
            raise InputError.of(f"is empty; allowed: columns of time, position and {FORCE}", file=file)
        log._begin(first, remarks)
        for piece in pieces:
            if log.faults:
                break
            log._take(piece)
        if not log.faults:
            log._end()
        return log

    def records(self) -> Iterator[tuple[str, FloatArray, IndexArray]]:
        """Yield each record: its name, shape (rows, 3) in the order of the quantities, and the line of each row."""
        for name in list(self._values):
            tables, lines = zip(*self._values.pop(name), strict=True)
            yield name, np.concatenate(tables), np.concatenate(lines)

    def _begin(self, rows: list[_Row], remarks: Sequence[_Row]) -> None:
        """Find delimiter and headers: in the first row, or in the comment above, as numpy writes it."""
        self._mark = _delimiter(rows[1 if len(rows) > 1 else 0][1])
        line, first = rows[0][0], self._cells(rows[0][1])
        self._width = len(first)
        headers, header_line = None, None
        if not all(map(_is_stated, first)):
            headers, header_line, rows = first, line, rows[1:]
        else:
            above = [(number, self._cells(row.lstrip(" #%"))) for number, row in remarks if number < line]
            named = [(number, names) for number, names in above if len(names) == len(first)]
            if named:
                header_line, headers = named[-1]
        self.chosen, self.faults = chosen_columns(headers, self._width, self.layout, self.file, header_line)
        groups = [at for at, name in enumerate(headers or ()) if name.strip().lower() in {"record", "run", "trial"}]
        self._group = groups[0] if groups else None
        unnamed = "time" in self.chosen and "time" not in self.layout.columns
        self._may_lack_clock = unnamed and self.layout.sample_time_s is not None
        if not self.faults:
            self._take(rows)

    def _take(self, rows: list[_Row]) -> None:
        """Parse rows, but for the last, which may have been cut short while writing."""
        rows = [*self._last, *rows]
        self._last, rows = rows[-1:], rows[:-1]
        if rows:
            self._rows += len(rows)
            if self._rows > _MOST_ROWS:
                raise InputError.of(f"has more rows than are read; allowed: {_MOST_ROWS}", file=self.file)
            if not self._at_once(rows):
                self._one_by_one(rows)

    def _end(self) -> None:
        if self._last and self._rows and len(self._cells(self._last[0][1])) < self._width:
            self.told = (f"{self.file}: its last line, {self._last[0][0]}, is cut short and left out",)
        elif self._last:
            self._one_by_one(self._last)
        for quantity, found in self._wrong.items():
            allowed = "a number" if quantity else f"{self._width}, as the first row"
            if quantity and all(_COMMA.search(what) for _, what in found):
                allowed += ", with a decimal point"
            self.faults += faults_of_rows(self.file, quantity, found, allowed, self._counts[quantity])
        if not self.faults and not self._values:
            self.faults = [Fault(self.file, None, "", "has headers and no samples")]

    def _at_once(self, rows: list[_Row]) -> bool:
        """Parse rows that are numbers throughout; return False where any is not."""
        texts, mark = [text for _, text in rows], self._mark
        if self._group is not None or not all(
            (len(text.split()) if mark is None else text.count(mark) + 1) == self._width and '"' not in text
            for text in texts
        ):
            return False
        columns = {QUANTITIES.index(quantity): one.index for quantity, one in self.chosen.items()}
        try:
            found = np.loadtxt(texts, delimiter=mark, usecols=list(columns.values()), comments=None, ndmin=2)
        except ValueError:
            return False
        table = np.zeros((len(rows), len(QUANTITIES)))
        table[:, list(columns)] = found
        self._keep("", table, [number for number, _ in rows])
        return True

    def _one_by_one(self, rows: Sequence[_Row]) -> None:
        """Parse rows with empty or quoted cells, or a fault."""
        kept: dict[str, tuple[list[list[float]], list[int]]] = {}
        for number, text in rows:
            cells = self._cells(text)
            if len(cells) != self._width:
                self._fault("", number, f"has {len(cells)} columns")
                continue
            bad = [quantity for quantity, one in self.chosen.items() if not _is_number(cells[one.index])]
            if self._may_lack_clock and "time" in bad:
                del self.chosen["time"]  # a time of day, replaced by a given sample time
                bad.remove("time")
            for quantity in bad:
                self._fault(quantity, number, f"is {cells[self.chosen[quantity].index][:40]!r}")
            if not bad:
                values, lines = kept.setdefault("" if self._group is None else cells[self._group], ([], []))
                values.append(
                    [float(cells[self.chosen[one].index] or "nan") if one in self.chosen else 0.0 for one in QUANTITIES]
                )
                lines.append(number)
        for name, (values, lines) in kept.items():
            self._keep(name, np.array(values), lines)

    def _keep(self, name: str, table: FloatArray, lines: Sequence[int]) -> None:
        self._values.setdefault(name, []).append((table, np.array(lines, dtype=np.intp)))
        if len(self._values) > _MOST_RECORDS:
            message = f"counts more records than are read of one file; allowed: {_MOST_RECORDS}"
            raise InputError.of(message, file=self.file)

    def _fault(self, quantity: str, line: int, what: str) -> None:
        """Record the first faults of a column and the last."""
        found = self._wrong.setdefault(quantity, [])
        found[TOLD:] = [(line, what)]
        self._counts[quantity] += 1

    def _cells(self, row: str) -> list[str]:
        if self._mark is None:
            return row.split()
        return [cell.strip() for cell in next(csv.reader([row], delimiter=self._mark))]


def _pieces(stream: BinaryIO, file: str, remarks: deque[_Row]) -> Iterator[list[_Row]]:
    """Yield the rows of a text with their line numbers, piece by piece; comments are set aside."""
    line, rest = 1, b""
    while piece := stream.read(_PIECE_BYTES):
        text = rest + piece
        end = b"\r" if text.endswith(b"\r") else b""  # half of a CRLF
        text = text[: len(text) - len(end)].replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        whole, feed, rest = text.rpartition(b"\n")
        if len(rest) > _LONGEST_ROW:
            raise _too_long(file, line + (whole + feed).count(b"\n"), len(rest))
        rest += end
        if feed:
            yield _rows(whole, line, file, remarks)
            line += whole.count(b"\n") + 1
    if rest:
        yield _rows(rest.replace(b"\r", b"\n"), line, file, remarks)


def _rows(text: bytes, line: int, file: str, remarks: deque[_Row]) -> list[_Row]:
    try:
        lines = text.decode("utf-8-sig" if line == 1 else "utf-8").split("\n")
    except UnicodeDecodeError as error:
        why = "is no UTF-8 text; allowed: UTF-8: save it as such, or iconv -f FROM -t UTF-8"
        raise InputError([Fault(file, line + text[: error.start].count(b"\n"), "", why)]) from error
    rows = [(number, row) for number, row in enumerate(lines, start=line) if row and not row.isspace()]
    longest = max(rows, key=lambda row: len(row[1]), default=(0, ""))
    if len(longest[1]) > _LONGEST_ROW:
        raise _too_long(file, longest[0], len(longest[1]))
    remarks.extend(row for row in rows if row[1].lstrip().startswith(_MARKS))
    return [row for row in rows if not row[1].lstrip().startswith(_MARKS)]


def _too_long(file: str, line: int, length: int) -> InputError:
    why = f"has {length} characters; allowed: rows of numbers, {_LONGEST_ROW} characters at most"
    return InputError([Fault(file, line, "", why)])


def _delimiter(row: str) -> str | None:
    counts = {mark: row.count(mark) for mark in (";", "\t", ",")}
    return next((mark for mark, count in counts.items() if count), None)


def _is_number(cell: str) -> bool:
    return not cell or _is_stated(cell)


def _is_stated(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
