"""Logs as files: CSV, NPZ and MAT v5; every fault of a file at once."""

from __future__ import annotations

import csv
import math
import re
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import scipy.io
from scipy.io.matlab import MatReadError

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.arrays import FloatArray, IndexArray
from avc_casadi._util.files import opened
from avc_casadi.identification.record import Columns, Record, backwards_of, faults_of_rows, implausible, records_of
from avc_casadi.identification.repair import filled
from avc_casadi.identification.units import QUANTITIES, Column, Layout, chosen_columns, motion_of

MOST_BYTES = 2**27
# A longer line is no row of numbers; a hundred channels are a thousand characters.
_LONGEST_ROW = 50_000
_MARKS = ("#", "%")
_COMMA = re.compile(r"\d,\d+'$")
_NUMBERS = {"double", "single", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64))}
# Exceptions of libraries at a file that is not of their kind.
_UNREADABLE = (
    ValueError,
    TypeError,
    IndexError,
    KeyError,
    NotImplementedError,
    EOFError,
    MemoryError,
    OverflowError,
    zlib.error,
    zipfile.BadZipFile,
    MatReadError,
)


def read_logs(
    paths: Sequence[str | Path], layout: Layout | None = None, added_mass_kg: Sequence[float] = ()
) -> tuple[list[Record], list[str]]:
    """Read the logs of one device."""
    if added_mass_kg and len(added_mass_kg) != len(paths):
        raise InputError.of(f"has {len(added_mass_kg)} for {len(paths)} logs; allowed: one for each", key="added_mass")
    records: list[Record] = []
    faults: list[Fault] = []
    notes: list[str] = []
    for index, path in enumerate(paths):
        columns, wrong = _columns(Path(path), str(path), layout or Layout())
        faults += wrong
        if columns is not None:
            cut, broken, told = records_of(columns, added_mass_kg[index] if added_mass_kg else 0.0)
            records += cut
            faults += broken
            notes += told
    periods = {record.sample_time_s for record in records}
    if not faults and periods and max(periods) > min(periods) * (1 + 1e-4):
        seconds = ", ".join(f"{period:g}" for period in sorted(periods))
        faults.append(Fault("", None, "LOG", f"have sample times of {seconds} s; allowed: one sample time for all"))
    if faults:
        raise InputError(faults)
    return [replace(record, sample_time_s=records[0].sample_time_s) for record in records], notes


def read_columns(path: str | Path, layout: Layout | None = None) -> list[Columns]:
    """Read a log with its own time stamps: gaps, jitter and a device at rest are no faults.

    A few lost samples are filled in, with a note.
    """
    columns, faults = _columns(Path(path), str(path), layout or Layout())
    if columns is not None:
        columns = filled(columns)
        faults += implausible(columns, idle=True) or backwards_of(columns)
    if faults or columns is None:
        raise InputError(faults)
    return [columns]


def _columns(path: Path, file: str, layout: Layout) -> tuple[Columns | None, list[Fault]]:
    """Return the log of a file, or its faults."""
    ending = path.suffix.lower()
    texts = (".csv", ".txt", ".dat", ".tsv")
    if ending not in (*texts, ".npz", ".mat"):
        return None, [Fault(file, None, "", f"ends in {path.suffix!r}; allowed: {', '.join(texts)}, .npz, .mat")]
    try:
        with opened(path, MOST_BYTES) as stream:
            if ending in texts:
                return _text(stream.read(), file, layout)
            return _arrays(_npz(stream) if ending == ".npz" else _mat(stream), file, layout)
    except InputError as error:
        return None, list(error.faults)
    except UnicodeDecodeError:
        return None, [Fault(file, None, "", "is no UTF-8 text; allowed: UTF-8: save it as such")]
    except _UNREADABLE as error:
        first = str(error).partition("\n")[0][:200] or type(error).__name__
        hint = "; save it with -v7" if isinstance(error, NotImplementedError) else ""
        return None, [Fault(file, None, "", f"is not read as {ending} ({first}){hint}")]


def _npz(stream: BinaryIO) -> Mapping[str, Any]:
    with zipfile.ZipFile(stream) as archive:
        _bound(sum(one.file_size for one in archive.infolist()))
    stream.seek(0)
    with np.load(stream, allow_pickle=False) as held:
        return {name: held[name] for name in held.files}


def _mat(stream: Any) -> Mapping[str, Any]:
    sizes = {name: math.prod(shape) for name, shape, kind in scipy.io.whosmat(stream) if kind in _NUMBERS}
    _bound(8 * sum(sizes.values()))
    stream.seek(0)
    held = scipy.io.loadmat(stream, squeeze_me=True, variable_names=list(sizes))
    return {name: held[name] for name in sizes if name in held}


def _bound(size: int) -> None:
    if size > MOST_BYTES:
        raise ValueError(f"it holds {size} bytes; allowed: at most {MOST_BYTES}; cut it")


def _arrays(named: Mapping[str, Any], file: str, layout: Layout) -> tuple[Columns | None, list[Fault]]:
    """Return the columns of named arrays: a vector is one by its name, a matrix ``data`` is data:1, data:2, ..."""
    columns: dict[str, FloatArray] = {}
    for name, held in named.items():
        value: Any = np.squeeze(np.asarray(held))
        if value.dtype.kind not in "fiu" or value.ndim not in {1, 2} or value.size < 2:
            continue
        if value.ndim == 1:
            columns[name] = value
        else:
            table = value if value.shape[0] >= value.shape[1] else value.T
            columns |= {f"{name}:{at}": column for at, column in enumerate(table.T, start=1)}
    names = list(columns)
    if not names:
        return None, [Fault(file, None, "", "holds no numbers; allowed: vectors of time, position and force")]
    chosen, faults = chosen_columns(names, len(names), layout, file, None)
    if faults:
        return None, faults
    values = {quantity: columns[names[one.index]] for quantity, one in chosen.items()}
    if len({one.size for one in values.values()}) > 1:
        sizes = ", ".join(f"{quantity} {one.size}" for quantity, one in values.items())
        return None, [Fault(file, None, "", f"has columns of unequal length: {sizes}; allowed: equal lengths")]
    return _quantities(file, values, chosen, layout, None), []


def _quantities(
    file: str,
    columns: Mapping[str, FloatArray],
    chosen: Mapping[str, Column],
    layout: Layout,
    lines: IndexArray | None,
    told: tuple[str, ...] = (),
) -> Columns:
    """Return columns in SI units, under a given clock where the log has none."""
    with np.errstate(over="ignore", invalid="ignore"):  # reported where numbers are looked at
        values = {key: np.asarray(one, dtype=np.float64) * chosen[key].size for key, one in columns.items()}
    if "time" not in values or (layout.sample_time_s is not None and "time" not in layout.columns):
        values["time"] = float(layout.sample_time_s or 0.0) * np.arange(values["position"].size, dtype=np.float64)
    return Columns(file, values["time"], values["position"], values["force"], lines, motion_of(chosen), told)


def _text(content: bytes, file: str, layout: Layout) -> tuple[Columns | None, list[Fault]]:
    """Read a text: headers in its first row, or in the comment above it, as numpy writes it."""
    lines = list(enumerate(content.decode("utf-8-sig").splitlines(), start=1))
    long = [line for line, row in lines if len(row) > _LONGEST_ROW]
    if long:
        return None, [Fault(file, long[0], "", f"is longer than {_LONGEST_ROW} characters; allowed: rows of numbers")]
    written = [(line, row) for line, row in lines if row.strip()]
    rows = [(line, row) for line, row in written if not row.lstrip().startswith(_MARKS)]
    if not rows:
        return None, [Fault(file, None, "", "is empty; allowed: columns of time, position and force")]
    sample = rows[min(1, len(rows) - 1)][1]
    mark = next((mark for mark in (";", "\t", ",") if mark in sample), None)
    line, first = rows[0][0], _cells(rows[0][1], mark)
    width, headers, header_line = len(first), None, None
    if not all(map(_is_number, first)):
        headers, header_line, rows = first, line, rows[1:]
    else:
        for number, row in written:
            names = _cells(row.lstrip(" #%"), mark)
            if number < line and len(names) == width:
                headers, header_line = names, number
    chosen, faults = chosen_columns(headers, width, layout, file, header_line)
    if faults:
        return None, faults
    told: tuple[str, ...] = ()
    if len(rows) > 1 and len(_cells(rows[-1][1], mark)) < width:
        told = (f"{file}: its last line, {rows[-1][0]}, is cut short and left out",)
        rows = rows[:-1]
    if not rows:
        return None, [Fault(file, None, "", "has headers and no samples")]
    places = [one.index for one in chosen.values()]
    numbers = np.array([number for number, _ in rows], dtype=np.intp)
    texts = [row for _, row in rows]
    table = np.zeros((0, 0))
    if all((len(row.split()) if mark is None else row.count(mark) + 1) == width for row in texts):
        with suppress(ValueError):  # parsed one by one then
            table = np.loadtxt(texts, delimiter=mark, usecols=places, comments=None, ndmin=2)
    if not table.size:
        table, chosen, faults = _one_by_one(rows, mark, width, chosen, layout, file)
        if faults:
            return None, faults
    columns = dict(zip(chosen, table.T, strict=True))
    return _quantities(file, columns, chosen, layout, numbers, told), []


def _one_by_one(
    rows: Sequence[tuple[int, str]],
    mark: str | None,
    width: int,
    chosen: dict[str, Column],
    layout: Layout,
    file: str,
) -> tuple[FloatArray, dict[str, Column], list[Fault]]:
    """Parse rows with empty or quoted cells, or a fault; an empty cell is a lost sample."""
    cells = [(line, _cells(row, mark)) for line, row in rows]
    if "time" in chosen and "time" not in layout.columns and layout.sample_time_s is not None:
        spare = chosen["time"].index
        if any(len(row) > spare and not _is_number(row[spare] or "0") for _, row in cells):
            # A time of day, replaced by the given sample time.
            chosen = {key: one for key, one in chosen.items() if key != "time"}
    wrong: dict[str, list[tuple[int | None, str]]] = {}
    for line, row in cells:
        if len(row) != width:
            wrong.setdefault("", []).append((line, f"has {len(row)} columns"))
            continue
        for quantity, one in chosen.items():
            if not _is_number(row[one.index] or "nan"):
                wrong.setdefault(quantity, []).append((line, f"is {row[one.index][:40]!r}"))
    faults = []
    for quantity in ("", *QUANTITIES):
        some = wrong.get(quantity, [])
        allowed = "a number" if quantity else f"{width}, as the first row"
        allowed += ", with a decimal point" if quantity and all(_COMMA.search(what) for _, what in some) else ""
        faults += faults_of_rows(file, quantity, some, allowed)
    if faults:
        return np.zeros((0, 0)), chosen, sorted(faults, key=lambda fault: fault.line or 0)
    table = [[float(row[one.index] or "nan") for one in chosen.values()] for _, row in cells]
    return np.array(table), chosen, []


def _cells(row: str, mark: str | None) -> list[str]:
    return row.split() if mark is None else [cell.strip() for cell in next(csv.reader([row], delimiter=mark))]


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
