"""Gain files: the `solve` document as JSON, or the bare table as CSV."""

from __future__ import annotations

import csv
import io
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.files import read_text
from avc_casadi._util.json_values import plain
from avc_casadi._util.units import LINEAR, ROTARY, Units, spoken
from avc_casadi.files.gain_document import CONTACT, GAINS, SCHEMA, GainCheck
from avc_casadi.model.quantity import MOST_FREQUENCIES
from avc_casadi.model.schedule import GainSchedule

_CSV_HEADER = ("frequency_hz", *GAINS)
_MAX_BYTES = 2**23
_DEEPEST = 50
_NEXT_STEP = "give a coupling file: avc recommend P --out FILE writes one, and avc solve P --out FILE that of a method"


def gain_document(gains: GainSchedule) -> dict[str, Any]:
    """Return the `solve` document without its certificate: JSON values only."""
    return {
        "schema": SCHEMA,
        "problem": gains.problem,
        "method": gains.method,
        "solver": gains.solver,
        "structure": gains.structure,
        "model": gains.model,
        "sample_time_s": plain(gains.sample_time_s),
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
        "requested_contact_damping_ns_per_m": plain(gains.requested_contact_damping_ns_per_m),
        "requested_rigid": plain(gains.requested_rigid),
        "counts": gains.counts(),
        "notes": list(gains.notes),
        "state_feedback": None if gains.state_feedback is None else asdict(gains.state_feedback),
        "seconds": {"build": gains.build_seconds, "solve": gains.solve_seconds},
    }


def gain_csv(gains: GainSchedule) -> str:
    """Return the usable rows as CSV text; a contact damping column is added in the damped structure."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    damped = gains.structure == "damped"
    writer.writerow(map(spoken().key, (*_CSV_HEADER, CONTACT) if damped else _CSV_HEADER))
    for row in np.flatnonzero(gains.usable):
        values = [gains.frequency_hz[row], gains.damping_ns_per_m[row], gains.stiffness_n_per_m[row]]
        if damped:
            values.append(gains.contact_damping_ns_per_m[row])
        writer.writerow([repr(float(value)) for value in values])
    return text.getvalue()


def read_document(path: Path) -> dict[str, Any]:
    """Read the document of a JSON gain or coupling file; its values are not checked yet.

    Raises:
        InputError: no such file, no JSON table, or a duplicate key in a table.
    """
    repeated: list[str] = []

    def table(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        repeated.extend(key for key, count in Counter(key for key, _ in pairs).items() if count > 1)
        return dict(pairs)

    try:
        document = json.loads(read_text(path, _MAX_BYTES, _NEXT_STEP), object_pairs_hook=table)
    except (ValueError, RecursionError) as error:  # ValueError: also an integer of more digits than Python reads
        line = getattr(error, "lineno", None)
        if isinstance(error, InputError):
            raise
        raise InputError([Fault(str(path), line, "", f"is not JSON ({error}); {_NEXT_STEP}")]) from error
    if repeated:
        message = "stands more than once in a table; allowed: once, or the file means two things"
        raise InputError([Fault(str(path), None, key, message) for key in dict.fromkeys(repeated)])
    if not isinstance(document, dict):
        raise InputError.of(f"holds no gain document; {_NEXT_STEP}", file=str(path))
    if _is_deep(document):
        raise InputError.of(f"is nested too deeply; {_NEXT_STEP}", file=str(path))
    return document


def units_of_document(document: Mapping[str, Any]) -> Units:
    """Return the units of a document that was read, as it declares them."""
    return ROTARY if document.get("motion") == ROTARY.motion else LINEAR


def _is_deep(document: Any) -> bool:
    level = [document]
    for _ in range(_DEEPEST):
        level = [
            inner
            for one in level
            for inner in (one.values() if isinstance(one, dict) else one)
            if isinstance(inner, dict | list)
        ]
    return bool(level)


def unsound_tables(document: Mapping[str, Any], file: str, keys: Sequence[str]) -> list[Fault]:
    """Return which of the tables that are passed through unchanged hold no JSON values."""
    faults = []
    for key in keys:
        found = document.get(key)
        if not isinstance(found, Mapping | None):
            faults.append(Fault(file, None, key, "must be a table or null"))
            continue
        try:
            json.dumps(found, allow_nan=False)
        except ValueError:
            faults.append(Fault(file, None, key, "holds a number that is not finite; allowed: JSON values"))
    return faults


def read_csv(path: Path) -> GainSchedule:
    """Read the bare table of a CSV file.

    Raises:
        InputError: with every fault of the file.
    """
    faults: list[Fault] = []
    reader = csv.reader(io.StringIO(read_text(path, _MAX_BYTES, _NEXT_STEP)))
    try:
        lines = [(reader.line_num, cells) for cells in islice(reader, MOST_FREQUENCIES + 2)]
    except csv.Error as error:
        raise InputError.of(f"is not CSV ({error}); {_NEXT_STEP}", file=str(path)) from error
    header = tuple(ROTARY.inner(cell.strip()) for cell in lines[0][1]) if lines else ()
    if header not in {_CSV_HEADER, (*_CSV_HEADER, CONTACT)}:
        message = f"header is {','.join(header) or 'missing'}; allowed: {','.join(_CSV_HEADER)}[,{CONTACT}]"
        raise InputError([Fault(str(path), 1, "", message)])
    if len(lines) > MOST_FREQUENCIES + 1:
        raise InputError.of(f"has more rows than a gain table; allowed: at most {MOST_FREQUENCIES}", file=str(path))
    rows: list[tuple[int, list[float]]] = []
    for number, cells in lines[1:]:
        if not cells:
            continue
        if len(cells) != len(header):
            faults.append(Fault(str(path), number, "", f"{len(cells)} values; allowed: {len(header)}"))
            continue
        values = []
        for name, cell in zip(header, cells, strict=True):
            try:
                values.append(float(cell))
            except ValueError:
                faults.append(
                    Fault(str(path), number, name, f"{cell!r} is not a number; allowed: a finite number >= 0")
                )
        if len(values) == len(cells):
            rows.append((number, values))
    document: dict[str, Any] = {name: [values[i] for _, values in rows] for i, name in enumerate(header)}
    document["structure"] = "damped" if CONTACT in header else "series"
    return GainCheck(document, path, [number for number, _ in rows], faults).schedule()
