"""Bounds of a problem file that refer to measured frequency responses, which are read here."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.units import NS_PER_M, Wording
from avc_casadi.files.toml_text import text_of
from avc_casadi.model.findings import checked
from avc_casadi.model.measured_bounds import MeasuredImpedance
from avc_casadi.model.quantity import plain

_NAMES = {
    "frequency_hz": ("f", "freq", "frequency", "f_hz", "freq_hz", "frequency_hz", "hz"),
    "real": ("re", "real", "re_z", "real_ns_per_m"),
    "imag": ("im", "imag", "im_z", "imag_ns_per_m"),
    "magnitude": ("magnitude", "mag", "abs", "|z|", "magnitude_ns_per_m"),
    "phase_deg": ("phase_deg",),
    "phase_rad": ("phase_rad",),
    "error": ("error", "uncertainty", "error_ns_per_m", "uncertainty_ns_per_m"),
}
_MOST = 200
_SOME = {"damping_ns_per_m": 1.0, "stiffness_n_per_m": 1.0}
# A larger phase must be in degrees.
_LARGEST_RAD = 10.0
_UNIT = re.compile(r"\s*[\[(]\s*n[ .*]?s[ ]?/[ ]?m\s*[\])]")
_FORMS = (("real", "imag"), ("magnitude", "phase_deg"), ("magnitude", "phase_rad"))
_HEADER = Wording.of(
    lambda: (
        f"a header with f and Re, Im, or f, magnitude and phase_deg or phase_rad, in Hz and {NS_PER_M}, and error if "
        "it is known"
    )
)


def with_measured_bounds(tables: Mapping[str, Any], folder: Path | None) -> Mapping[str, Any]:
    """Read ``[boundaries] measured = {upper = "file.csv", lower = "file.csv"}``; other tables are unchanged.

    Without upper and lower beside it, these are the best-fitting springs and dampers, for methods that need one, such
    as a tuning.

    Args:
        tables: parsed tables of a problem file.
        folder: of the problem file.

    Raises:
        InputError: with every fault of the files.
    """
    table = tables.get("boundaries")
    measured = table.get("measured") if isinstance(table, Mapping) else None
    if not isinstance(table, Mapping) or not isinstance(measured, Mapping):
        return tables
    read = dict(measured)
    faults: list[Fault] = []
    for side, source in measured.items():
        if isinstance(source, str):
            path = (folder or Path()) / source
            try:
                read[side] = response_of(text_of(path, "give a path relative to the problem file"), str(path))
            except InputError as error:
                faults += error.faults
    if faults:
        raise InputError(faults)
    whole = {**table, "measured": read}
    for side in ("upper", "lower"):
        found = checked(MeasuredImpedance, read[side], "", ()) if isinstance(read.get(side), Mapping) else None
        if side not in table:
            # Faults of the responses are reported once, where they are checked.
            whole[side] = found.spring_and_damper() if isinstance(found, MeasuredImpedance) else _SOME
    return {**tables, "boundaries": whole}


def response_of(text: str, file: str) -> dict[str, list[float]]:
    """Read a frequency response as the keys of a `MeasuredImpedance`.

    Args:
        text: CSV with a header, comments after ``#``; separated by commas, semicolons or tabs.
        file: name in faults.

    Raises:
        InputError: with every fault, each with its line.
    """
    lines = [(number, line) for number, line in enumerate(text.splitlines(), start=1) if line.partition("#")[0].strip()]
    if not lines:
        raise InputError.of(f"is empty; allowed: {_HEADER}", file=file)
    mark = max(",;\t", key=lines[0][1].count)
    rows = [(number, _cells(line.partition("#")[0], mark)) for number, line in lines]
    named = [_UNIT.sub("", name.strip().lower()) for name in rows[0][1]]
    header = [re.sub(r"[\s()\[\]]+", "_", name).strip("_") for name in named]
    place = {key: header.index(name) for key, names in _NAMES.items() for name in names if name in header}
    form = next((form for form in _FORMS if set(form) <= set(place)), None)
    if "frequency_hz" not in place or form is None:
        raise InputError([Fault(file, rows[0][0], "", f"has columns {', '.join(header)}; allowed: {_HEADER}")])
    faults: list[Fault] = []
    values: list[dict[str, float]] = []
    for number, cells in rows[1:]:
        try:
            row = {key: float(cells[column]) for key, column in place.items()}
        except (ValueError, IndexError):
            faults.append(Fault(file, number, "", f"is {mark.join(cells)[:60]!r}; allowed: {len(header)} numbers"))
            continue
        if not all(map(math.isfinite, row.values())):
            faults.append(Fault(file, number, "", "holds a value that is not finite; allowed: numbers"))
        elif abs(row.get("phase_rad", 0.0)) > _LARGEST_RAD:
            told = f"is {plain(row['phase_rad'])}; allowed: -{_LARGEST_RAD:g} to {_LARGEST_RAD:g}, or phase_deg"
            faults.append(Fault(file, number, "phase_rad", told))
        values.append(row)
    if faults:
        more = [] if len(faults) <= _MOST else [Fault(file, None, "", f"has {len(faults) - _MOST} more faults")]
        raise InputError(faults[:_MOST] + more)
    values.sort(key=lambda row: row["frequency_hz"])
    parts = [_cartesian(row, form) for row in values]
    found = {
        "frequency_hz": [row["frequency_hz"] for row in values],
        "real_ns_per_m": [real for real, _ in parts],
        "imag_ns_per_m": [imag for _, imag in parts],
    }
    if "error" in place:
        found["error_ns_per_m"] = [row["error"] for row in values]
    return found


def _cells(line: str, mark: str) -> list[str]:
    return next(csv.reader(io.StringIO(line), delimiter=mark, skipinitialspace=True))


def _cartesian(row: Mapping[str, float], form: tuple[str, str]) -> tuple[float, float]:
    first, second = (row[key] for key in form)
    if form[0] == "real":
        return first, second
    angle = math.radians(second) if form[1] == "phase_deg" else second
    return first * math.cos(angle), first * math.sin(angle)
