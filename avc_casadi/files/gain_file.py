"""Tables of gains: the document of a schedule, and a table alone as CSV."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.files import read_text
from avc_casadi._util.json_values import plain
from avc_casadi._util.units import ROTARY
from avc_casadi.model import quantity as q
from avc_casadi.model import table as t
from avc_casadi.model.gains import GainTable
from avc_casadi.model.schedule import GainSchedule
from avc_casadi.model.table import checked

MOST_BYTES = 2**23
NEXT_STEP = "give a coupling file: avc recommend P --out FILE writes one, and avc solve P --out FILE that of a method"


class _Gain(q.Quantity):
    """Validator of a gain, which keeps the sign of a zero: the id of a coupling is that of its bits."""

    def __call__(self, value: Any) -> float:
        return math.copysign(super().__call__(value), value)


_Damping = Annotated[float, BeforeValidator(_Gain("N.s/m", 1e-300, q.LARGEST_DAMPING_NS_PER_M))]
_Dampings = Annotated[tuple[_Damping, ...], BeforeValidator(q.sequence)]
_Stiffness = Annotated[float, BeforeValidator(_Gain("N/m", 1e-300, q.LARGEST_STIFFNESS_N_PER_M))]
_Stiffnesses = Annotated[tuple[_Stiffness, ...], BeforeValidator(q.sequence)]


class GainColumns(t.Table):
    """Rows of gains as columns."""

    frequency_hz: q.Frequencies
    damping_ns_per_m: _Dampings
    stiffness_n_per_m: _Stiffnesses
    contact_damping_ns_per_m: _Dampings | None = None

    def faults(self) -> Iterator[t.Finding]:
        """Yield columns of other lengths, and frequencies that do not rise."""
        rows = len(self.frequency_hz)
        for key, column in self:
            if column is not None and len(column) != rows:
                yield (key,), f"has {len(column)} values; allowed: {rows}, as frequency_hz"
        for row, (before, value) in enumerate(pairwise(self.frequency_hz), start=1):
            if value <= before:
                yield ("frequency_hz", row), f"is {value:g} Hz after {before:g} Hz; allowed: rising frequencies"

    def table(self) -> GainTable:
        """Return the table; without a contact damper where there is no column of it."""
        contact = self.contact_damping_ns_per_m or (0.0,) * len(self.frequency_hz)
        columns = (self.frequency_hz, self.damping_ns_per_m, self.stiffness_n_per_m, contact)
        return GainTable(np.array(columns, dtype=np.float64).T)


_COLUMNS = tuple(GainColumns.model_fields)
_HEADERS = (_COLUMNS[:3], _COLUMNS)


def gain_document(gains: GainSchedule) -> dict[str, Any]:
    """Return the `solve` document without its certificate: JSON values only."""
    keys = (
        *("problem", "method", "solver", "structure", "model", "sample_time_s", *_COLUMNS, "status", "reason"),
        *("requested_rigid", "requested_damping_ns_per_m", "requested_stiffness_n_per_m"),
        *("requested_contact_damping_ns_per_m", "notes", "magnitude_error", "complex_error", "real_part"),
    )
    curves = {"impedance": gains.impedance, "target": gains.target}
    return (
        {"schema": "avc-gains/1"}
        | {key: plain(getattr(gains, key)) for key in keys}
        | {f"{name}_re": plain(curve.real) for name, curve in curves.items()}
        | {f"{name}_im": plain(curve.imag) for name, curve in curves.items()}
        | {
            "counts": gains.counts(),
            "state_feedback": gains.state_feedback and gains.state_feedback.model_dump(exclude={"kind"}),
            "seconds": {"build": gains.build_seconds, "solve": gains.solve_seconds},
        }
    )


def gain_csv(gains: GainSchedule) -> str:
    """Return the usable rows as CSV text; a contact damping column is added in the damped structure."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    keys = _HEADERS[gains.structure == "damped"]
    writer.writerow(map(gains.units.key, keys))
    for row in np.flatnonzero(gains.usable).tolist():
        writer.writerow([repr(float(getattr(gains, key)[row])) for key in keys])
    return text.getvalue()


def read_csv(path: Path) -> GainTable:
    """Read a table of gains."""
    file, reader = str(path), csv.reader(io.StringIO(read_text(path, MOST_BYTES, NEXT_STEP)))
    try:
        rows = [(reader.line_num, cells) for cells in reader if cells]
    except csv.Error as error:
        raise InputError.of(f"is not CSV ({error}); {NEXT_STEP}", file=file) from error
    header = tuple(ROTARY.inner(cell.strip()) for cell in rows[0][1]) if rows else ()
    if header not in _HEADERS:
        message = f"header is {','.join(header) or 'missing'}; allowed: {','.join(_HEADERS[0])}[,{_COLUMNS[3]}]"
        raise InputError([Fault(file, 1, "", message)])
    lines = [line for line, _ in rows[1:]]
    faults = [
        Fault(file, line, "", f"has {len(cells)} values; allowed: {len(header)}")
        for line, cells in rows[1:]
        if len(cells) != len(header)
    ]
    if faults:
        raise InputError(faults)
    columns = zip(header, zip(*(map(_number, cells) for _, cells in rows[1:]), strict=True), strict=False)
    found = checked(GainColumns, dict(columns))
    if isinstance(found, GainColumns):
        return found.table()
    raise InputError(
        [
            Fault(file, lines[row[0]] if row and isinstance(row[0], int) else None, str(key), message)
            for (key, *row), message in found
        ]
    )


def _number(cell: str) -> float | str:
    try:
        return float(cell)
    except ValueError:
        return cell
