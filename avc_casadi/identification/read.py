"""Logs as files: CSV, JSON, NPY, NPZ and MAT v5; every fault of a file at once."""

from __future__ import annotations

import csv
import json
import re
import zipfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
from scipy.io.matlab import MatReadError

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.arrays import FloatArray
from avc_casadi._util.units import units_for
from avc_casadi.identification.record import Columns, Record, backwards_of, faults_of_rows, implausible, records_of
from avc_casadi.identification.repair import filled
from avc_casadi.identification.units import QUANTITIES, Column, Layout, chosen_columns, motion_of

_MOST_FAULTS = 6
_COMMA = re.compile(r"\d,\d+'$")
_LARGEST_BYTES = 1_000_000_000
# What is longer is no row of numbers; a hundred channels are a thousand characters.
_LONGEST_ROW = 50_000
_REMARKS = ("#", "%")
# Steps of time that say what the clock was, and how even they are.
_FEW_STEPS, _EVEN = 20, 0.02
# A step so long lacks a row; a share of them that is no chance of a slow clock.
_GAP, _FEW_GAPS = 1.5, 2e-3


def read_logs(
    paths: Sequence[str | Path], layout: Layout | None = None, added_mass_kg: Sequence[float] = ()
) -> tuple[list[Record], list[str]]:
    """Read the logs of one device.

    Args:
        paths: files that end in ``.csv``, ``.txt``, ``.json``, ``.npy``, ``.npz`` or ``.mat``.
        layout: what is said of their columns.
        added_mass_kg: known mass on the device, one of each file, or none.

    Returns:
        Records, and what the user should know of them.

    Raises:
        InputError: every fault of every file, each with its line.
    """
    layout = layout or Layout()
    if added_mass_kg and len(added_mass_kg) != len(paths):
        raise InputError.of(
            f"has {_counted(len(added_mass_kg), 'mass', 'masses')} for {_counted(len(paths), 'log', 'logs')}; allowed: "
            "one for each",
            key="added_mass_kg",
        )
    records: list[Record] = []
    faults = _given_twice(paths)
    told: list[str] = []
    for index, path in enumerate(paths):
        found, wrong = _columns(Path(path), str(path), layout)
        for columns in found:
            cut, broken, said = records_of(columns, added_mass_kg[index] if added_mass_kg else 0.0)
            records += cut
            wrong += _worded(broken, columns)
            told += said
        faults += _few(wrong, str(path))
    periods = {record.sample_time_s for record in records}
    if not faults and periods and max(periods) > min(periods) * (1 + 1e-4):
        seconds = ", ".join(f"{period:g}" for period in sorted(periods))
        faults.append(Fault("", None, "LOG", f"have sample times of {seconds} s; allowed: one sample time for all"))
    if len({record.motion for record in records}) > 1:
        faults.append(Fault("", None, "LOG", "are of a device that turns and of one that does not; allowed: one kind"))
    if faults:
        raise InputError(faults)
    return [replace(record, sample_time_s=records[0].sample_time_s) for record in records], told


def read_columns(path: str | Path, layout: Layout | None = None) -> list[Columns]:
    """Read a log with its time stamps as they are: gaps, uneven steps and a device that rests are no faults of it.

    A few samples that were lost are filled in, and told.

    Args:
        path: a file that ends in ``.csv``, ``.txt``, ``.json``, ``.npy``, ``.npz`` or ``.mat``.
        layout: what is said of its columns.

    Returns:
        The columns, of each record where a column counts records.

    Raises:
        InputError: every fault of the file, each with its line.
    """
    found, faults = _columns(Path(path), str(path), layout or Layout())
    whole = []
    for columns in found:
        mended, told = filled(columns)
        whole.append(replace(mended, told=(*columns.told, *told)))
        faults += _worded(implausible(mended, idle=True), mended) or backwards_of(mended)
    if faults:
        raise InputError(_few(faults, str(path)))
    return whole


def _given_twice(paths: Sequence[str | Path]) -> list[Fault]:
    """Refuse a file that is given again: it says nothing new, and intervals would narrow."""
    known: set[Path] = set()
    faults = []
    for path in paths:
        if (real := Path(path).resolve()) in known:
            faults.append(Fault(str(path), None, "", "is given twice; allowed: each log once"))
        known.add(real)
    return faults


def _worded(faults: Sequence[Fault], columns: Columns) -> list[Fault]:
    """Return faults in the words of the device that a log is of."""
    units = units_for(columns.motion)
    return [replace(one, key=units.text(one.key), message=units.text(one.message)) for one in faults]


def _counted(count: int, one: str, many: str) -> str:
    return f"{count} {one if count == 1 else many}"


def _few(faults: list[Fault], file: str) -> list[Fault]:
    if len(faults) <= _MOST_FAULTS:
        return faults
    return [*faults[:_MOST_FAULTS], Fault(file, None, "", f"has {len(faults) - _MOST_FAULTS} more faults")]


def _columns(path: Path, file: str, layout: Layout) -> tuple[list[Columns], list[Fault]]:
    """Return the logs of a file (several where a column counts records), or its faults."""
    ending = path.suffix.lower()
    try:
        size = path.stat().st_size
        if size <= _LARGEST_BYTES and ending in _READERS:
            return _READERS[ending](path, file, layout)
    except OSError as error:
        why = f"cannot be read ({error.strerror or error})"
    except UnicodeDecodeError as error:
        why = f"is no UTF-8 text (byte {error.start}); allowed: UTF-8: save it as such, or iconv -f FROM -t UTF-8"
    except (ValueError, NotImplementedError, zipfile.BadZipFile, TypeError, MatReadError, RecursionError) as error:
        first = str(error).partition("\n")[0][:200]
        hint = "; save it with -v7" if isinstance(error, NotImplementedError) else ""
        why = f"is not read as {ending} ({first}){hint}"
    else:
        why = f"ends in {path.suffix!r}; allowed: {', '.join(_READERS)}"
        if ending in _READERS:
            why = f"has {size} bytes; allowed: {_LARGEST_BYTES}"
    return [], [Fault(file, None, "", why)]


def _npz(path: Path, file: str, layout: Layout) -> tuple[list[Columns], list[Fault]]:
    held = np.load(path, allow_pickle=False)
    if isinstance(held, np.ndarray):
        return _arrays({"rows": held}, file, layout)
    with held as archive:
        return _arrays({name: archive[name] for name in archive.files}, file, layout)


def _mat(path: Path, file: str, layout: Layout) -> tuple[list[Columns], list[Fault]]:
    found = scipy.io.loadmat(path, squeeze_me=True)
    return _arrays({name: value for name, value in found.items() if not name.startswith("__")}, file, layout)


def _json(path: Path, file: str, layout: Layout) -> tuple[list[Columns], list[Fault]]:
    """Read an object of arrays, a list of objects of numbers (in an object, too) or of rows, or a line for each."""
    text = path.read_text(encoding="utf-8-sig")
    lines = [line for line in text.splitlines() if line.strip()]
    of_lines = len(lines) > 1 and lines[0].rstrip()[-1] in "}]"
    held = [json.loads(line) for line in lines] if of_lines else json.loads(text)
    if isinstance(held, dict):
        inner = [one for one in held.values() if isinstance(one, list) and one and isinstance(one[0], dict)]
        held = inner[0] if len(inner) == 1 else held
    if isinstance(held, list) and held and all(isinstance(row, dict) for row in held):
        held = {name: [row.get(name) for row in held] for name in held[0]}
    named = held if isinstance(held, dict) else {"rows": held}
    arrays: dict[str, FloatArray] = {}
    for name, values in named.items():
        # What is no array of numbers, as a title beside them, is no column; a null is a sample that was lost.
        with suppress(ValueError, TypeError):
            arrays[name] = np.array(values, dtype=np.float64)
    return _arrays(arrays, file, layout)


def _arrays(named: Mapping[str, Any], file: str, layout: Layout) -> tuple[list[Columns], list[Fault]]:
    """Take columns from vectors by their names, or from the one matrix of a file by their numbers."""
    arrays = {name: np.asarray(value) for name, value in named.items()}
    vectors = {
        name: value.ravel()
        for name, value in arrays.items()
        if value.dtype.kind in "fiu" and value.size > 1 and value.ndim - value.shape.count(1) <= 1
    }
    matrices = [
        value for value in arrays.values() if value.dtype.kind in "fiu" and value.ndim == 2 and 1 not in value.shape
    ]
    if len(matrices) == 1 and not vectors:
        table = matrices[0] if matrices[0].shape[0] >= matrices[0].shape[1] else matrices[0].T
        chosen, faults = chosen_columns(None, table.shape[1], layout, file, None)
        columns = [table[:, index] for index in range(table.shape[1])]
    else:
        names = list(vectors)
        if not names:
            held = ", ".join(f"{name} {value.dtype} {value.shape}" for name, value in arrays.items()) or "nothing"
            return [], [Fault(file, None, "", f"holds {held}; allowed: vectors of time, position and force")]
        chosen, faults = chosen_columns(names, len(names), layout, file, None)
        columns = [vectors[name] for name in names]
    if faults:
        return [], faults
    lengths = {quantity: columns[one.index].size for quantity, one in chosen.items()}
    if len(set(lengths.values())) > 1:
        told = ", ".join(f"{quantity} {length}" for quantity, length in lengths.items())
        return [], [Fault(file, None, "", f"has columns of unequal length: {told}; allowed: equal lengths")]
    found, faults = _quantities(file, columns, chosen, layout, None)
    return [found], faults


def _quantities(
    file: str,
    columns: Sequence[Any],
    chosen: Mapping[str, Column],
    layout: Layout,
    lines: Sequence[int] | None,
) -> tuple[Columns, list[Fault]]:
    values = {
        quantity: np.asarray(columns[one.index], dtype=np.float64) * one.unit.size for quantity, one in chosen.items()
    }
    faults = []
    if "time" not in values or (layout.sample_time_s is not None and "time" not in layout.columns):
        period = float(layout.sample_time_s or 0.0)
        faults = _other_clock(file, values.get("time"), period)
        values["time"] = np.arange(values["position"].size, dtype=np.float64) * period
    return Columns(file, values["time"], values["position"], values["force"], lines, motion_of(chosen)), faults


def _other_clock(file: str, time_s: FloatArray | None, period_s: float) -> list[Fault]:
    """Refuse a sample time beside times that are even, and step otherwise or have gaps; uneven ones tell of writing."""
    steps = np.zeros(0) if time_s is None else np.diff(time_s[np.isfinite(time_s)])
    if steps.size < _FEW_STEPS:
        return []
    low, usual, high = np.quantile(steps, (0.1, 0.5, 0.9))
    if usual <= 0 or high - low > _EVEN * usual:
        return []
    if abs(usual - period_s) <= _EVEN * usual:
        missing = int(np.sum(steps > _GAP * usual))
        if missing <= _FEW_GAPS * steps.size:
            return []
        message = (
            f"has {missing} gaps, which even ticks would hide; allowed: --sample-time left out, or a log with every"
        )
        return [Fault(file, None, "time", f"{message} row")]
    message = f"steps of {usual:.4g} s, and the sample time is said to be {period_s:.4g} s; allowed: the same, or "
    return [Fault(file, None, "time", f"{message}--sample-time left out, or a log without its times")]


def _text(path: Path, file: str, layout: Layout) -> tuple[list[Columns], list[Fault]]:
    text = path.read_text(encoding="utf-8-sig")
    rows = [(number, row) for number, row in enumerate(text.splitlines(), start=1) if row.strip()]
    remarks = [(number, row) for number, row in rows if row.lstrip().startswith(_REMARKS)]
    rows = [(number, row) for number, row in rows if not row.lstrip().startswith(_REMARKS)]
    longest = max(rows, key=lambda row: len(row[1]), default=(0, ""))
    if len(longest[1]) > _LONGEST_ROW:
        why = f"has {len(longest[1])} characters; allowed: rows of numbers, {_LONGEST_ROW} characters at most"
        return [], [Fault(file, longest[0], "", why)]
    if not rows:
        return [], [Fault(file, None, "", "is empty; allowed: columns of time, position and force")]
    mark = _delimiter(rows[min(1, len(rows) - 1)][1])
    body = [(number, _cells(row, mark)) for number, row in rows]
    width = len(body[0][1])
    headers, header_line, body = _headed(body, [(number, _cells(row.lstrip(" #%"), mark)) for number, row in remarks])
    chosen, faults = chosen_columns(headers, width, layout, file, header_line)
    if faults:
        return [], faults
    groups = [index for index, name in enumerate(headers or ()) if name.strip().lower() in {"record", "run", "trial"}]
    chosen = _without_time_of_day(chosen, body, layout)
    wanted = {quantity: one.index for quantity, one in chosen.items()}
    values: dict[str, list[tuple[int, list[float]]]] = {}
    wrong: dict[str, list[tuple[int | None, str]]] = {}
    body, told = _without_cut_row(body, width, file)
    for number, row in body:
        if len(row) != width:
            wrong.setdefault("", []).append((number, f"has {len(row)} columns"))
            continue
        bad = [quantity for quantity, index in wanted.items() if not _is_number(row[index])]
        for quantity in bad:
            wrong.setdefault(quantity, []).append((number, f"is {row[wanted[quantity]][:40]!r}"))
        if not bad:
            kept = [float(row[wanted[quantity]] or "nan") if quantity in wanted else 0.0 for quantity in QUANTITIES]
            values.setdefault(row[groups[0]] if groups else "", []).append((number, kept))
    for quantity, found in wrong.items():
        allowed = "a number" if quantity else f"{width}, as the first row"
        if quantity and all(_COMMA.search(what) for _, what in found[:_MOST_FAULTS]):
            allowed += ", with a decimal point"
        faults += faults_of_rows(file, quantity, found, allowed)
    if faults:
        return [], faults
    units = {
        quantity: Column(at, chosen[quantity].unit) for at, quantity in enumerate(QUANTITIES) if quantity in chosen
    }
    logs = []
    for name, samples in values.items():
        table = np.array([sample for _, sample in samples])
        lines = [number for number, _ in samples]
        log, wrong_clock = _quantities(f"{file}[{name}]" if name else file, list(table.T), units, layout, lines)
        logs.append(log)
        faults += wrong_clock
    logs = [*logs[:-1], *(replace(log, told=told) for log in logs[-1:])]
    return logs, faults if logs else [Fault(file, None, "", "has headers and no samples")]


def _headed(
    body: list[tuple[int, list[str]]], remarks: Sequence[tuple[int, list[str]]]
) -> tuple[list[str] | None, int | None, list[tuple[int, list[str]]]]:
    """Return the headers, their line, and the rows below: of the first row, or of the remark above, as numpy has it."""
    line, first = body[0]
    if not all(map(_is_stated, first)):
        return first, line, body[1:]
    above = [(number, names) for number, names in remarks if number < line and len(names) == len(first)]
    return (above[-1][1], above[-1][0], body) if above else (None, None, body)


def _without_cut_row(
    body: list[tuple[int, list[str]]], width: int, file: str
) -> tuple[list[tuple[int, list[str]]], tuple[str, ...]]:
    """Leave out a last row that the end of writing cut short; returns what to tell of it."""
    if len(body) < 2 or len(body[-1][1]) >= width:
        return body, ()
    return body[:-1], (f"{file}: its last line, {body[-1][0]}, is cut short and left out",)


def _cells(row: str, mark: str | None) -> list[str]:
    return row.split() if mark is None else [cell.strip() for cell in next(csv.reader([row], delimiter=mark))]


def _without_time_of_day(
    chosen: dict[str, Column], body: Sequence[tuple[int, Sequence[str]]], layout: Layout
) -> dict[str, Column]:
    """Leave the time out where it is no number, and a sample time stands for it."""
    if "time" not in chosen or layout.sample_time_s is None or "time" in layout.columns:
        return chosen
    at = chosen["time"].index
    if all(_is_number(row[at]) for _, row in body if at < len(row)):
        return chosen
    return {quantity: one for quantity, one in chosen.items() if quantity != "time"}


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


_READERS: Mapping[str, Callable[[Path, str, Layout], tuple[list[Columns], list[Fault]]]] = {
    ".csv": _text,
    ".txt": _text,
    ".dat": _text,
    ".tsv": _text,
    ".json": _json,
    ".jsonl": _json,
    ".npy": _npz,
    ".npz": _npz,
    ".mat": _mat,
}
