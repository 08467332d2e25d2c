"""Gain files: the `solve` document as JSON, or the bare table as CSV."""

from __future__ import annotations

import csv
import io
import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from avc_casadi._errors import Fault, InputError
from avc_casadi.design._gains import ComplexArray, FloatArray, GainSchedule, Status

SCHEMA = "avc-gains/1"
_CSV_HEADER = ("frequency_hz", "damping_ns_per_m", "stiffness_n_per_m")
_MAX_BYTES = 64 * 1024 * 1024


def plain(value: Any) -> Any:
    """Turn arrays, tuples and enumerations into JSON values; a number that is not finite becomes null."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Status) else value


def gain_document(gains: GainSchedule) -> dict[str, Any]:
    """Return the `solve` document without its certificate: JSON values only."""
    return {
        "schema": SCHEMA,
        "problem": gains.problem,
        "method": gains.method,
        "solver": gains.solver,
        "structure": gains.structure,
        "model": gains.model,
        "sample_time_s": gains.sample_time_s,
        "frequency_hz": plain(gains.frequency_hz),
        "damping_ns_per_m": plain(gains.damping_ns_per_m),
        "stiffness_n_per_m": plain(gains.stiffness_n_per_m),
        "contact_damping_ns_per_m": plain(gains.contact_damping_ns_per_m),
        "impedance_re": plain(gains.impedance.real),
        "impedance_im": plain(gains.impedance.imag),
        "target_re": plain(gains.target.real),
        "target_im": plain(gains.target.imag),
        "magnitude_error": plain(gains.magnitude_error),
        "complex_error": plain(gains.complex_error),
        "real_part": plain(gains.real_part),
        "status": plain(gains.status),
        "reason": list(gains.reason),
        "requested_damping_ns_per_m": plain(gains.requested_damping_ns_per_m),
        "requested_stiffness_n_per_m": plain(gains.requested_stiffness_n_per_m),
        "counts": gains.counts(),
        "notes": list(gains.notes),
        "seconds": {"build": gains.build_seconds, "solve": gains.solve_seconds},
    }


def gain_csv(gains: GainSchedule) -> str:
    """Return the usable rows as CSV text; a contact damping column is added in the damped structure."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    damped = gains.structure == "damped"
    writer.writerow((*_CSV_HEADER, "contact_damping_ns_per_m") if damped else _CSV_HEADER)
    for row in np.flatnonzero(gains.usable):
        values = [gains.frequency_hz[row], gains.damping_ns_per_m[row], gains.stiffness_n_per_m[row]]
        if damped:
            values.append(gains.contact_damping_ns_per_m[row])
        writer.writerow([repr(float(value)) for value in values])
    return text.getvalue()


def write_gains(gains: GainSchedule, path: Path) -> None:
    """Write a gain file; the ending of ``path`` chooses JSON or CSV."""
    if path.suffix == ".csv":
        path.write_text(gain_csv(gains), encoding="utf-8")
    else:
        path.write_text(json.dumps(gain_document(gains), indent=1, allow_nan=False) + "\n", encoding="utf-8")


def read_gains(path: Path) -> GainSchedule:
    """Read a gain file, JSON or CSV by its ending.

    Raises:
        InputError: with every fault of the file.
    """
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise InputError.of(
                f"larger than {_MAX_BYTES // 2**20} MiB; a gain file is a table of rows", file=str(path)
            )
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError.of(
            f"cannot be read ({error.strerror}); give a file that `avc solve --out` wrote", file=str(path)
        ) from error
    except UnicodeDecodeError as error:
        raise InputError.of("is not UTF-8 text; give a file that `avc solve --out` wrote", file=str(path)) from error
    return _from_csv(text, path) if path.suffix == ".csv" else _from_json(text, path)


def _from_csv(text: str, path: Path) -> GainSchedule:
    faults: list[Fault] = []
    lines = list(csv.reader(io.StringIO(text)))
    header = tuple(cell.strip() for cell in lines[0]) if lines else ()
    if header not in {_CSV_HEADER, (*_CSV_HEADER, "contact_damping_ns_per_m")}:
        message = (
            f"header is {','.join(header) or 'missing'}; allowed: {','.join(_CSV_HEADER)}[,contact_damping_ns_per_m]"
        )
        raise InputError([Fault(str(path), 1, "", message)])
    columns: list[list[float]] = [[] for _ in header]
    for number, cells in enumerate(lines[1:], start=2):
        if not cells:
            continue
        if len(cells) != len(header):
            faults.append(Fault(str(path), number, "", f"{len(cells)} values; allowed: {len(header)}"))
            continue
        for name, cell, column in zip(header, cells, columns, strict=True):
            value = _number(cell)
            if value is None:
                faults.append(
                    Fault(str(path), number, name, f"{cell!r} is not a number; allowed: a finite number >= 0")
                )
            column.append(math.nan if value is None else value)
    document: dict[str, Any] = dict(zip(header, columns, strict=True))
    document["structure"] = "damped" if len(header) == 4 else "series"
    return _schedule(document, path, faults)


def _number(cell: str) -> float | None:
    try:
        value = float(cell)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _from_json(text: str, path: Path) -> GainSchedule:
    try:
        document = json.loads(text)
    except (json.JSONDecodeError, RecursionError) as error:
        line = getattr(error, "lineno", None)
        raise InputError(
            [Fault(str(path), line, "", f"is not JSON ({error}); give a file that `avc solve --out` wrote")]
        ) from error
    if not isinstance(document, dict):
        raise InputError.of("holds no gain document; give a file that `avc solve --out` wrote", file=str(path))
    faults: list[Fault] = []
    schema = document.get("schema", SCHEMA)
    if schema != SCHEMA:
        faults.append(Fault(str(path), None, "schema", f"{schema!r} is not known; allowed: {SCHEMA!r}"))
    if document.get("structure", "series") not in {"series", "damped"}:
        faults.append(Fault(str(path), None, "structure", f"{document['structure']!r}; allowed: 'series', 'damped'"))
    return _schedule(document, path, faults)


def _column(document: dict[str, Any], key: str, rows: int | None, path: Path, faults: list[Fault]) -> FloatArray:
    values = document.get(key)
    if values is None and rows is not None:
        return np.full(rows, np.nan)
    allowed = "a list of finite numbers >= 0, null where a row has no gains"
    is_list = isinstance(values, list) and all(
        item is None or (isinstance(item, int | float) and not isinstance(item, bool)) for item in values
    )
    if not is_list:
        faults.append(Fault(str(path), None, key, f"is missing or no list of numbers; allowed: {allowed}"))
        return np.full(rows or 0, np.nan)
    assert isinstance(values, list)  # noqa: S101 - for the type checker
    column = np.array([np.nan if item is None else float(item) for item in values])
    if rows is not None and len(column) != rows:
        faults.append(Fault(str(path), None, key, f"has {len(column)} values; allowed: {rows}, as frequency_hz"))
        return np.full(rows, np.nan)
    if np.isinf(column).any() or any(isinstance(item, float) and math.isnan(item) for item in values):
        faults.append(Fault(str(path), None, key, f"holds a number that is not finite; allowed: {allowed}"))
    return column


def _schedule(document: dict[str, Any], path: Path, faults: list[Fault]) -> GainSchedule:
    frequency = _column(document, "frequency_hz", None, path, faults)
    n = len(frequency)
    if n == 0 and not faults:
        faults.append(Fault(str(path), None, "frequency_hz", "is empty; allowed: at least one row"))
    if not np.all(frequency > 0):
        faults.append(Fault(str(path), None, "frequency_hz", "holds a value that is not > 0; allowed: positive Hz"))
    gains: dict[str, FloatArray] = {}
    for key in ("damping_ns_per_m", "stiffness_n_per_m", "contact_damping_ns_per_m"):
        gains[key] = _column(document, key, n, path, faults)
        if np.any(gains[key] < 0):
            row = int(np.flatnonzero(gains[key] < 0)[0])
            faults.append(Fault(str(path), None, key, f"is {gains[key][row]:g} in row {row}; allowed: >= 0"))
    status = document.get("status")
    known = {item.value for item in Status}
    if status is not None and (not isinstance(status, list) or len(status) != n or not set(map(str, status)) <= known):
        faults.append(Fault(str(path), None, "status", f"must be {n} of {', '.join(sorted(known))}"))
        status = None
    if faults:
        raise InputError(faults)
    present = np.isfinite(gains["damping_ns_per_m"]) & np.isfinite(gains["stiffness_n_per_m"])
    states = tuple(
        (Status.SOLVED if ok else Status.INFEASIBLE) if status is None else Status(status[row])
        for row, ok in enumerate(present)
    )
    contact = np.where(present & np.isnan(gains["contact_damping_ns_per_m"]), 0.0, gains["contact_damping_ns_per_m"])
    reason = document.get("reason")
    return GainSchedule(
        problem=str(document.get("problem", path.stem)),
        method=str(document.get("method", "file")),
        solver=document.get("solver"),
        structure="damped" if document.get("structure") == "damped" else "series",
        model=str(document.get("model", "paper")),
        sample_time_s=float(document.get("sample_time_s", math.nan)),
        frequency_hz=frequency,
        damping_ns_per_m=gains["damping_ns_per_m"],
        stiffness_n_per_m=gains["stiffness_n_per_m"],
        contact_damping_ns_per_m=contact,
        impedance=_complex(document, "impedance", n, path),
        target=_complex(document, "target", n, path),
        status=states,
        reason=tuple(map(str, reason)) if isinstance(reason, list) and len(reason) == n else ("",) * n,
        requested_damping_ns_per_m=_column(document, "requested_damping_ns_per_m", n, path, []),
        requested_stiffness_n_per_m=_column(document, "requested_stiffness_n_per_m", n, path, []),
    )


def _complex(document: dict[str, Any], key: str, n: int, path: Path) -> ComplexArray:
    return np.asarray(
        _column(document, f"{key}_re", n, path, []) + 1j * _column(document, f"{key}_im", n, path, []),
        dtype=np.complex128,
    )
