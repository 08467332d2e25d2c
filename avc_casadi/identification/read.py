"""Logs as files: CSV and other text, NPZ and MAT v5; columns and units from headers and options."""

from __future__ import annotations

import csv
import difflib
import math
import re
import zipfile
import zlib
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import scipy.io
from scipy.io.matlab import MatReadError

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.arrays import FloatArray, IndexArray
from avc_casadi._util.files import open_bounded
from avc_casadi.identification.log import Columns, Record, faults_of, faults_of_rows, records_of

MOST_BYTES = 2**27
"""Largest log that is read, and largest content of a compressed one, bytes."""
_SAME_PERIOD = 1e-4
"""Sample times of logs that differ by no more than this share are one."""
_QUANTITIES = ("time", "position", "force")
_TEXTS = (".csv", ".txt", ".dat", ".tsv")
_NAMES = {
    "time": ("time", "t", "timestamp", "stamp", "clock"),
    "position": ("position", "pos", "x", "q", "displacement", "y", "angle", "theta", "phi"),
    "force": ("force", "f", "u", "command", "force_command", "cmd_force", "effort", "torque", "tau", "moment"),
}
"""Headers of each quantity, in lower case and without their unit."""
_UNITS: Mapping[str, Mapping[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "position": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "nm": 1e-9}
    | {"rad": 1.0, "mrad": 1e-3, "urad": 1e-6, "deg": math.pi / 180},
    "force": {"n": 1.0, "mn": 1e-3, "kn": 1e3}
    | {"n.m": 1.0, "mn.m": 1e-3, "kn.m": 1e3, "nm": 1.0, "mnm": 1e-3, "unm": 1e-6},
}
"""Units of each quantity in SI units: m or rad, s, N or N.m."""
_SPELT = {
    **dict.fromkeys(("sec", "seconds"), "s"),
    **dict.fromkeys(("degrees", "degree", "°"), "deg"),
    **dict.fromkeys(("n*m", "n·m"), "n.m"),
    **dict.fromkeys(("micros", "µs"), "us"),
    "millis": "ms",
    "µm": "um",
    "newton": "n",
    "radians": "rad",
    "µrad": "urad",
}
"""Other spellings of units."""
_USUAL = {
    "time": "s, ms, us, ns, in the header as time_s",
    "position": "m, cm, mm, um (counts times the encoder's step), rad, deg, in the header as position_m or angle_rad",
    "force": "N, mN, kN, or N.m, mN.m (a current times the motor's constant), in the header as force_n or torque_nm",
}
"""Usual units of each quantity, as faults name them."""
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,(\d+)(?:[eE][+-]?\d+)?")
"""A number with a comma in place of a decimal point."""
_THOUSANDS = 3
"""Digits of a group of thousands."""
# Exceptions of libraries at a file that is not of their kind.
_UNREADABLE: tuple[type[Exception], ...] = (
    *(ValueError, TypeError, LookupError, NotImplementedError, EOFError, MemoryError, OverflowError),
    *(csv.Error, zlib.error, zipfile.BadZipFile, MatReadError),
)

_CLOCKS_ALIKE = 0.05
"""Share by which a given sample time may differ from the mean step of the times that it replaces."""


@dataclass(frozen=True)
class Layout:
    """Columns (headers, or numbers from 1) and units by quantity, and the sample time of a log without time."""

    columns: Mapping[str, str | int] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    sample_time_s: float | None = None


def pairs_of(texts: Sequence[str], key: str) -> tuple[dict[str, str], list[Fault]]:
    """Parse ``time=1,position=2`` as the columns and units of an option; an angle is a position, a torque a force."""
    pairs: dict[str, str] = {}
    faults = []
    for part in (part.strip() for text in texts for part in text.split(",") if part.strip()):
        name, _, value = (text.strip() for text in part.partition("="))
        quantity = {"angle": "position", "torque": "force"}.get(name, name)
        if quantity in _QUANTITIES and value:
            fault = f"states {quantity} twice; allowed: once" if quantity in pairs else ""
            pairs[quantity] = value
        elif value:
            near = difflib.get_close_matches(name, (*_QUANTITIES, "angle", "torque"), n=1)
            hint = f"; did you mean {near[0]}?" if near else ""
            fault = f"{name!r} is not a quantity of a log; allowed: {', '.join(_QUANTITIES)}, angle, torque{hint}"
        else:
            allowed = ", ".join(f"{quantity}=..." for quantity in _QUANTITIES)
            fault = f"{part!r} has no value; allowed: {allowed}"
        if fault:
            faults.append(Fault("", None, key, fault))
    return pairs, faults


def read_logs(paths: Sequence[str | Path], layout: Layout | None = None) -> tuple[list[Record], list[str]]:
    """Read the logs of one device; return their records, all of one sample time, and notes for the user.

    Raises:
        InputError: with every fault of all logs.
    """
    records: list[Record] = []
    faults: list[Fault] = []
    notes: list[str] = []
    for path in paths:
        try:
            log = records_of(_columns(path, layout or Layout()))
        except InputError as error:
            faults += error.faults
        else:
            records += log.records
            faults += log.faults
            notes += log.notes
    periods = sorted({record.sample_time_s for record in records})
    if not faults and periods and periods[-1] > periods[0] * (1 + _SAME_PERIOD):
        seconds = ", ".join(f"{period:g}" for period in periods)
        faults.append(Fault("", None, "LOG", f"have sample times of {seconds} s; allowed: one sample time for all"))
    if faults:
        raise InputError(faults)
    return [replace(record, sample_time_s=records[0].sample_time_s) for record in records], notes


def read_columns(path: str | Path, layout: Layout | None = None) -> Columns:
    """Read a log of a swing with its own time stamps: gaps, jitter and a device at rest are no faults."""
    columns = _columns(path, layout or Layout()).complete()
    faults = faults_of(columns, swing=True)
    if faults:
        raise InputError(faults)
    return columns


def _columns(path: str | Path, layout: Layout) -> Columns:
    """Return the columns of a file in SI units."""
    file, ending = str(path), Path(path).suffix.lower()
    if ending not in (*_TEXTS, ".npz", ".mat") and not Path(path).is_dir():
        order = "; give the log first, then the problem or device" if ending in (".toml", ".json") else ""
        raise InputError.of(f"ends in {ending!r}; allowed: {', '.join(_TEXTS)}, .npz, .mat{order}", file=file)
    try:
        with open_bounded(path, MOST_BYTES, "give a log of the device, such as log.csv") as stream:
            if ending in _TEXTS:
                return _text(stream.read().decode("utf-8-sig"), file, layout)
            return _arrays(_npz(stream) if ending == ".npz" else _mat(stream), file, layout)
    except InputError:
        raise
    except UnicodeDecodeError:
        raise InputError.of("is not UTF-8 text; save it as UTF-8", file=file) from None
    except _UNREADABLE as error:
        first = str(error).partition("\n")[0][:200] or type(error).__name__
        hint = "; save it with -v7" if isinstance(error, NotImplementedError) else ""
        raise InputError.of(f"cannot be read as {ending} ({first}){hint}", file=file) from error


def _npz(stream: BinaryIO) -> Mapping[str, Any]:
    """Return the arrays of a file of NumPy by name, without those that are no numbers; refuse one that is too large."""
    with zipfile.ZipFile(stream) as archive:
        _bound(sum(member.file_size for member in archive.infolist()))
    stream.seek(0)
    with np.load(stream, allow_pickle=False) as arrays:
        columns = {}
        for name in arrays.files:
            with suppress(ValueError):  # an array of objects, which is no column
                columns[name] = arrays[name]
        return columns


def _mat(stream: Any) -> Mapping[str, Any]:
    numbers = {"double", "single", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64))}
    sizes = {name: math.prod(shape) for name, shape, kind in scipy.io.whosmat(stream) if kind in numbers}
    _bound(8 * sum(sizes.values()))
    stream.seek(0)
    arrays = scipy.io.loadmat(stream, squeeze_me=True, variable_names=list(sizes))
    return {name: arrays[name] for name in sizes if name in arrays}


def _bound(size: int) -> None:
    if size > MOST_BYTES:
        raise ValueError(f"it has {size} bytes; allowed: at most {MOST_BYTES}; shorten the log")


def _arrays(arrays: Mapping[str, Any], file: str, layout: Layout) -> Columns:
    """Return the columns of named arrays: a vector is one by its name, a matrix ``data`` is data:1, data:2, ..."""
    vectors: dict[str, Any] = {}
    for name, array in arrays.items():
        value: Any = np.squeeze(np.asarray(array))
        if value.dtype.kind not in "fiu" or value.ndim not in {1, 2} or value.size < 2:
            continue
        if value.ndim == 1:
            vectors[name] = value
        else:
            table = value if value.shape[0] >= value.shape[1] else value.T
            vectors |= {f"{name}:{index}": column for index, column in enumerate(table.T, start=1)}
    if not vectors:
        raise InputError.of("has no vector of numbers; allowed: vectors, a matrix (a struct: save -struct)", file=file)
    sources = _sources(list(vectors), len(vectors), layout, file, None)
    columns = list(vectors.values())
    written = _replaced_clock(list(vectors), layout)
    if written is not None:
        _require_same_clock(columns[written.index] * _UNITS["time"][written.unit], layout, file)
    values = {quantity: columns[source.index] for quantity, source in sources.items()}
    if len({column.size for column in values.values()}) > 1:
        sizes = ", ".join(f"{quantity} {column.size}" for quantity, column in values.items())
        raise InputError.of(f"has columns of unequal length: {sizes}; allowed: equal lengths", file=file)
    return _in_si(file, values, sources, layout)


@dataclass(frozen=True)
class _TextTable:
    """Rows of a text as cells, each with its line; headers are None where the text has none."""

    cells: list[list[str]]
    lines: list[int]
    width: int
    headers: list[str] | None
    header_line: int | None


def _table_of(content: str, file: str) -> _TextTable:
    """Cut a text into cells; headers stand in its first row, or in the comment above it, as numpy writes it."""
    lines = [(number, line) for number, line in enumerate(content.splitlines(), start=1) if line.strip()]
    rows = [(number, line) for number, line in lines if not line.lstrip().startswith(("#", "%"))]
    if not rows:
        raise InputError.of("is empty; allowed: columns of time, position and force", file=file)
    _, sample = rows[min(1, len(rows) - 1)]
    mark = next((mark for mark in (";", "\t", ",") if mark in sample), None)
    row_lines = [number for number, _ in rows]
    cells = _with_points(list(_cells((row for _, row in rows), mark)))
    width = len(cells[0])
    if any(_number(cell) is None for cell in cells[0]):
        return _TextTable(cells[1:], row_lines[1:], width, headers=cells[0], header_line=row_lines[0])
    above = [(number, line.lstrip(" #%")) for number, line in lines if number < row_lines[0]]
    headers, header_line = None, None
    for (number, _), names in zip(above, _cells((line for _, line in above), mark), strict=True):
        if len(names) == width:
            headers, header_line = names, number
    return _TextTable(cells, row_lines, width, headers, header_line)


def _with_points(cells: list[list[str]]) -> list[list[str]]:
    """Return cells with decimal points in place of decimal commas, as spreadsheets of some languages write them.

    A comma in each place is that of decimals where no number has a point, and where one has other than three digits
    behind it, as no group of thousands has.
    """
    rest = [cell for row in cells for cell in row if _number(cell) is None]
    behind = [match[1] for match in map(_DECIMAL_COMMA.fullmatch, rest) if match]
    with_point = any("." in cell for row in cells for cell in row if _number(cell) is not None)
    if with_point or all(len(digits) == _THOUSANDS for digits in behind):
        return cells
    return [[cell.replace(",", ".") if _DECIMAL_COMMA.fullmatch(cell) else cell for cell in row] for row in cells]


def _text(content: str, file: str, layout: Layout) -> Columns:
    """Return the columns of a text."""
    table = _table_of(content, file)
    cells, lines = table.cells, table.lines
    width = table.width
    sources = _sources(table.headers, width, layout, file, table.header_line)
    notes: tuple[str, ...] = ()
    if len(cells) > 1 and len(cells[-1]) < width:
        notes = (f"{file}: its last line, {lines[-1]}, is cut short and left out",)
        cells, lines = cells[:-1], lines[:-1]
    if not cells:
        raise InputError.of("has headers and no samples", file=file)
    uneven = [(line, f"has {len(row)} columns") for line, row in zip(lines, cells, strict=True) if len(row) != width]
    faults = faults_of_rows(file, "", uneven, f"{width}, as the first row")
    values = {}
    for quantity, source in sources.items():
        # An empty cell is a lost sample; a row of another width is a fault already.
        texts = [row[source.index] or "nan" if len(row) == width else "nan" for row in cells]
        values[quantity] = [_number(text) for text in texts]
        faults += _faults_of_cells(file, quantity, lines, texts, values[quantity])
    if faults:
        raise InputError(sorted(faults, key=lambda fault: fault.line or 0))
    written = _replaced_clock(table.headers, layout)
    if written is not None:
        times = [_number(row[written.index]) for row in cells]
        seconds = np.array([math.nan if time is None else time for time in times]) * _UNITS["time"][written.unit]
        _require_same_clock(seconds, layout, file)
    return _in_si(file, values, sources, layout, np.array(lines, dtype=np.intp), notes)


def _faults_of_cells(
    file: str, quantity: str, lines: Sequence[int], texts: Sequence[str], values: Sequence[float | None]
) -> list[Fault]:
    """Return the cells of a column that hold no number, as a fault."""
    wrong = [
        (line, f"is {text[:40]!r}") for line, text, value in zip(lines, texts, values, strict=True) if value is None
    ]
    decimal_comma = bool(wrong) and all(re.search(r"\d,\d+'$", fact) for _, fact in wrong)
    allowed = "a number, with a decimal point" if decimal_comma else "a number"
    return faults_of_rows(file, quantity, wrong, allowed)


def _cells(rows: Iterable[str], mark: str | None) -> Iterable[list[str]]:
    if mark is None:
        return (row.split() for row in rows)
    return ([cell.strip() for cell in next(csv.reader([row], delimiter=mark))] for row in rows)


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None


def _in_si(
    file: str,
    columns: Mapping[str, Any],
    sources: Mapping[str, _Source],
    layout: Layout,
    lines: IndexArray | None = None,
    notes: tuple[str, ...] = (),
) -> Columns:
    """Return columns in SI units, under a given clock where the log has none."""
    with np.errstate(over="ignore", invalid="ignore"):  # reported where numbers are looked at
        values = {
            quantity: np.asarray(column, dtype=np.float64) * _UNITS[quantity][sources[quantity].unit]
            for quantity, column in columns.items()
        }
    if "time" not in values:
        values["time"] = float(layout.sample_time_s or 0.0) * np.arange(values["position"].size, dtype=np.float64)
    turns = any(_turns(quantity, source.unit) for quantity, source in sources.items())
    return Columns(
        file=file,
        time_s=values["time"],
        position_m=values["position"],
        force_n=values["force"],
        line=lines,
        motion="rotary" if turns else "linear",
        notes=notes,
    )


def _turns(quantity: str, unit: str) -> bool:
    """Return whether a unit is of a device that turns."""
    return unit.endswith(("rad", "deg")) or (quantity == "force" and unit.endswith("m"))


@dataclass(frozen=True)
class _Source:
    """Index and unit of the column that holds a quantity."""

    index: int
    unit: str


def _sources(
    headers: Sequence[str] | None, width: int, layout: Layout, file: str, line: int | None
) -> dict[str, _Source]:
    """Return the column of each quantity; headers are None where there are none."""
    sources: dict[str, _Source] = {}
    faults: list[Fault] = []
    names = [_split(header) for header in headers or ()]
    # A sample time replaces a missing time, or one of writing.
    given_clock = layout.sample_time_s is not None and "time" not in layout.columns
    wanted = [quantity for quantity in _QUANTITIES if quantity != "time" or not given_clock]
    for quantity in wanted:
        index = _column(quantity, headers, names, width, layout.columns.get(quantity))
        if isinstance(index, str):
            faults.append(Fault(file, line, quantity, index))
            continue
        unit = layout.units.get(quantity, names[index][1] if names else "").strip()
        spelling = _SPELT.get(unit.lower(), unit.lower())
        if spelling in _UNITS[quantity]:
            sources[quantity] = _Source(index, spelling)
        else:
            fact = f"has the unit {unit!r}" if unit else "has no unit"
            allowed = f"{_USUAL[quantity]}, or with --units {quantity}=UNIT"
            faults.append(Fault(file, line, quantity, f"{fact}; allowed: {allowed}"))
    if len({source.index for source in sources.values()}) < len(sources):
        faults.append(Fault(file, line, "", "one column is named for two quantities; allowed: one column each"))
    turning = [quantity for quantity, source in sources.items() if _turns(quantity, source.unit)]
    if len(turning) == 1 and {"position", "force"} <= sources.keys():
        message = "has a rotary unit, and the rest of the log linear units; allowed: rad and N.m, or m and N"
        faults.append(Fault(file, line, turning[0], message))
    if faults:
        raise InputError(faults)
    return sources


def _replaced_clock(headers: Sequence[str] | None, layout: Layout) -> _Source | None:
    """Return the column of times that a given sample time replaces; None without one."""
    if layout.sample_time_s is None or "time" in layout.columns or headers is None:
        return None
    names = [_split(header) for header in headers]
    index = _column("time", headers, names, len(headers), None)
    if isinstance(index, str):
        return None
    unit = layout.units.get("time", names[index][1]).strip().lower()
    spelling = _SPELT.get(unit, unit)
    return _Source(index, spelling) if spelling in _UNITS["time"] else None


def _require_same_clock(seconds: FloatArray, layout: Layout, file: str) -> None:
    """Refuse a sample time that is not the mean step of the times, s, that it replaces; those may be rounded."""
    mean_s = float(seconds[-1] - seconds[0]) / max(seconds.size - 1, 1)
    sample_time_s = layout.sample_time_s
    if sample_time_s is None or not mean_s > 0 or abs(sample_time_s / mean_s - 1) <= _CLOCKS_ALIKE:
        return
    allowed = f"the mean step of the times, {mean_s:.4g} s; leave --sample-time out, or remove the column"
    raise InputError.of(f"--sample-time is {sample_time_s:.4g} s; allowed: {allowed}", file=file, key="time")


def _split(header: str) -> tuple[str, str]:
    """Return name and unit of ``position_mm``, ``position [mm]``, ``position (mm)`` or ``position/mm``."""
    text = header.strip().strip('"')
    bracket = re.fullmatch(r"(.*?)\s*[\[(]\s*(\S+?)\s*[\])]", text)
    if bracket:
        return bracket[1].strip().lower(), bracket[2]
    known = {*_SPELT, *(unit for units in _UNITS.values() for unit in units)}
    for mark in ("_", "/"):
        stem, _, last = (part.strip() for part in text.rpartition(mark))
        if stem and last.lower() in known:
            return stem.lower(), last
    return text.lower(), ""


def _column(
    quantity: str,
    headers: Sequence[str] | None,
    names: Sequence[tuple[str, str]],
    width: int,
    choice: str | int | None,
) -> int | str:
    """Return the index of a column, or the fault."""
    if choice is not None and str(choice).isdigit():
        place = int(choice)
        return place - 1 if 1 <= place <= width else f"is column {place}; allowed: 1 to {width}"
    if headers is None:
        return f"is not named, and the log has no header; name its column: --columns {quantity}=NUMBER, 1 is the first"
    if choice is not None:
        return _column_by_header(choice, headers)
    places = [index for index, (name, _) in enumerate(names) if name in _NAMES[quantity]]
    if len(places) == 1:
        return places[0]
    unknown = [header.strip() for header in headers if header.rpartition("_")[0].strip().lower() in _NAMES[quantity]]
    if unknown and not places:
        return f"has a unit that is not known in {', '.join(unknown)}; allowed: {_USUAL[quantity]}"
    matches = f"{len(places)} columns" if places else "no column"
    allowed = f"one, or --columns {quantity}=HEADER" + ("; without time --sample-time S" if quantity == "time" else "")
    return f"has {matches} among {', '.join(map(repr, headers[:20]))}; allowed: {allowed}"


def _column_by_header(choice: str | int, headers: Sequence[str]) -> int | str:
    """Return the index of the column with a header, or the fault."""
    exact = [index for index, header in enumerate(headers) if header.strip() == choice]
    if len(exact) == 1:
        return exact[0]
    near = difflib.get_close_matches(str(choice), headers, n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    return f"is {choice!r}, not a column of the log; allowed: {', '.join(headers[:20])}{hint}"
