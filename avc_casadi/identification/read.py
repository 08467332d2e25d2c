"""Logs as files: CSV, JSON, NPY, NPZ and MAT v5; every fault of a file at once."""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from scipy.io.matlab import MatReadError

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.arrays import FloatArray, IndexArray
from avc_casadi._util.files import opened
from avc_casadi._util.units import FORCE, MASS, MASSES, Wording, speaking
from avc_casadi.identification.array_log import MOST_BYTES, mat_arrays, npy_array, npz_arrays
from avc_casadi.identification.record import Columns, Record, backwards_of, implausible, records_of
from avc_casadi.identification.repair import filled, sound
from avc_casadi.identification.text_log import TextLog
from avc_casadi.identification.units import QUANTITIES, Column, Layout, chosen_columns, motion_of

# A text is read row by row, JSON whole.
_LARGEST_TEXT, _LARGEST_JSON = 2**30, 2**22
# Number of time steps that determine the clock, and their tolerance.
_FEW_STEPS, _EVEN = 20, 0.02
# A step so long lacks a row; a larger share of them is no jitter of a slow clock.
_GAP, _FEW_GAPS = 1.5, 2e-3


def read_logs(
    paths: Sequence[str | Path], layout: Layout | None = None, added_mass_kg: Sequence[float] = ()
) -> tuple[list[Record], list[str]]:
    """Read the logs of one device.

    Args:
        paths: files that end in ``.csv``, ``.txt``, ``.json``, ``.npy``, ``.npz`` or ``.mat``.
        layout: columns and units, as given by the user.
        added_mass_kg: known mass on the device, one of each file, or none.

    Returns:
        Records, and notes for the user.

    Raises:
        InputError: every fault of every file, each with its line.
    """
    layout = layout or Layout()
    if added_mass_kg and len(added_mass_kg) != len(paths):
        raise InputError.of(
            f"has {_counted(len(added_mass_kg), MASS, MASSES)} for {_counted(len(paths), 'log', 'logs')}; allowed: one "
            "for each",
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
            wrong += broken
            told += said
        faults += wrong
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
    """Read a log with its own time stamps: gaps, jitter and a device at rest are no faults.

    A few lost samples are filled in, with a note.

    Args:
        path: a file that ends in ``.csv``, ``.txt``, ``.json``, ``.npy``, ``.npz`` or ``.mat``.
        layout: columns and units, as given by the user.

    Returns:
        The columns, one set per record where a column counts records.

    Raises:
        InputError: every fault of the file, each with its line.
    """
    found, faults = _columns(Path(path), str(path), layout or Layout())
    whole = []
    for columns in found:
        with speaking(columns.units):
            mended, told = filled(columns)
            whole.append(replace(mended, told=(*columns.told, *told)))
            faults += implausible(mended, idle=True) or backwards_of(mended)
    if faults:
        raise InputError(faults)
    return whole


def _given_twice(paths: Sequence[str | Path]) -> list[Fault]:
    """Refuse a file that is given twice: it adds no information, and intervals would narrow."""
    known: set[tuple[int, int]] = set()
    faults = []
    for path in paths:
        with suppress(OSError, ValueError):  # reported where it is read
            info = Path(path).stat()
            if (info.st_dev, info.st_ino) in known:
                faults.append(Fault(str(path), None, "", "is given twice; allowed: each log once"))
            known.add((info.st_dev, info.st_ino))
    return faults


def _counted(count: int, one: str | Wording, many: str | Wording) -> str:
    return f"{count} {one if count == 1 else many}"


def _columns(path: Path, file: str, layout: Layout) -> tuple[list[Columns], list[Fault]]:
    """Return the logs of a file (several where a column counts records), or its faults."""
    ending = path.suffix.lower()
    if ending not in _READERS:
        return [], [Fault(file, None, "", f"ends in {path.suffix!r}; allowed: {', '.join(_READERS)}")]
    most_bytes, read = _READERS[ending]
    try:
        with opened(path, most_bytes) as stream:
            return read(stream, file, layout)
    except InputError as error:
        return [], list(error.faults)
    except (*_UNREADABLE, MemoryError) as error:
        first = _PLAIN.get(type(error)) or str(error).partition("\n")[0][:200] or type(error).__name__
        hint = "; save it with -v7" if isinstance(error, NotImplementedError) and ending == ".mat" else ""
        return [], [Fault(file, None, "", f"is not read as {ending} ({first}){hint}")]


def _npy(stream: BinaryIO, file: str, layout: Layout) -> tuple[list[Columns], list[Fault]]:
    return _arrays({"rows": npy_array(stream)}, file, layout)


def _npz(stream: BinaryIO, file: str, layout: Layout) -> tuple[list[Columns], list[Fault]]:
    return _arrays(npz_arrays(stream, file), file, layout)


def _mat(stream: BinaryIO, file: str, layout: Layout) -> tuple[list[Columns], list[Fault]]:
    return _arrays(mat_arrays(stream, file), file, layout)


def _json(stream: BinaryIO, file: str, layout: Layout) -> tuple[list[Columns], list[Fault]]:
    """Read JSON: an object of arrays, a list of (nested) objects or of rows, or one per line."""
    content = stream.read(_LARGEST_JSON + 1)
    if len(content) > _LARGEST_JSON:
        why = f"is larger than {_LARGEST_JSON} bytes, which JSON may have as it is read whole; write it as CSV or NPZ"
        return [], [Fault(file, None, "", why)]
    text = content.decode("utf-8-sig")
    lines = [line for line in text.splitlines() if line.strip()]
    of_lines = len(lines) > 1 and lines[0].rstrip()[-1] in "}]"
    held = json.loads("[" + ",\n".join(lines) + "]" if of_lines else text, parse_int=float)
    if isinstance(held, dict):
        inner = [one for one in held.values() if isinstance(one, list) and one and isinstance(one[0], dict)]
        held = inner[0] if len(inner) == 1 else held
    if isinstance(held, list) and held and all(isinstance(row, dict) for row in held):
        held = {name: [row.get(name) for row in held] for name in held[0]}
    named = held if isinstance(held, dict) else {"rows": held}
    arrays: dict[str, FloatArray] = {}
    for name, values in named.items():
        # Non-numeric entries, such as a title, are no columns; a null is a lost sample.
        with suppress(ValueError, TypeError, OverflowError):
            arrays[name] = np.array(values, dtype=np.float64)
    return _arrays(arrays, file, layout)


def _arrays(named: Mapping[str, Any], file: str, layout: Layout) -> tuple[list[Columns], list[Fault]]:
    """Return columns from named vectors, or by number from the one matrix of a file."""
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
            return [], [Fault(file, None, "", f"holds {held}; allowed: vectors of time, position and {FORCE}")]
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
    lines: IndexArray | None,
) -> tuple[Columns, list[Fault]]:
    with np.errstate(over="ignore", invalid="ignore"):  # reported where numbers are looked at
        values = {
            quantity: np.asarray(columns[one.index], dtype=np.float64) * one.unit.size
            for quantity, one in chosen.items()
        }
    faults = []
    if "time" not in values or (layout.sample_time_s is not None and "time" not in layout.columns):
        period = float(layout.sample_time_s or 0.0)
        faults = _other_clock(file, values.get("time"), period)
        values["time"] = np.arange(values["position"].size, dtype=np.float64) * period
    return Columns(file, values["time"], values["position"], values["force"], lines, motion_of(chosen)), faults


def _other_clock(file: str, time_s: FloatArray | None, period_s: float) -> list[Fault]:
    """Refuse a given sample time that contradicts evenly spaced times; uneven ones are those of writing."""
    steps = np.zeros(0) if time_s is None else np.diff(time_s[sound(time_s)])
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


def _text(stream: BinaryIO, file: str, layout: Layout) -> tuple[list[Columns], list[Fault]]:
    log = TextLog.of(stream, file, layout)
    faults = log.faults
    units = {
        quantity: Column(at, log.chosen[quantity].unit)
        for at, quantity in enumerate(QUANTITIES)
        if quantity in log.chosen
    }
    logs = []
    for name, table, lines in log.records():
        one, wrong_clock = _quantities(f"{file}[{name}]" if name else file, list(table.T), units, layout, lines)
        logs.append(one)
        faults += wrong_clock
    return [*logs[:-1], *(replace(one, told=log.told) for one in logs[-1:])], faults


_UNREADABLE = (
    ValueError,
    TypeError,
    IndexError,
    NotImplementedError,
    RecursionError,
    EOFError,
    zlib.error,
    zipfile.BadZipFile,
    MatReadError,
)
"""Exceptions of libraries at a file that is not of their kind."""
_PLAIN: Mapping[type[Exception], str] = {
    RecursionError: "it is nested too deeply",
    MemoryError: "it is too large or nested too deeply",
    UnicodeDecodeError: "it is no UTF-8 text; save it as such, or iconv -f FROM -t UTF-8",
}
_READERS: Mapping[str, tuple[int, Callable[[BinaryIO, str, Layout], tuple[list[Columns], list[Fault]]]]] = {
    **dict.fromkeys((".csv", ".txt", ".dat", ".tsv"), (_LARGEST_TEXT, _text)),
    **dict.fromkeys((".json", ".jsonl"), (_LARGEST_TEXT, _json)),
    ".npy": (MOST_BYTES, _npy),
    ".npz": (MOST_BYTES, _npz),
    ".mat": (MOST_BYTES, _mat),
}
