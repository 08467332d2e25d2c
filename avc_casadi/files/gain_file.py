"""Gain files: the `solve` document as JSON, or the bare table as CSV."""

from __future__ import annotations

import csv
import io
import json
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, ConfigDict
from pydantic_core import PydanticCustomError

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.arrays import BoolArray, FloatArray
from avc_casadi._util.files import read_text
from avc_casadi._util.json_values import plain
from avc_casadi._util.units import LINEAR, ROTARY, Units
from avc_casadi.model import quantity as q
from avc_casadi.model.effects import StateFeedbackEffect
from avc_casadi.model.findings import checked
from avc_casadi.model.problem import Model, Structure
from avc_casadi.model.runtime import StateFeedback
from avc_casadi.model.schedule import GainSchedule, Status

SCHEMA = "avc-gains/1"
GAINS = ("damping_ns_per_m", "stiffness_n_per_m")
CONTACT = "contact_damping_ns_per_m"
_CSV_HEADER = ("frequency_hz", *GAINS)
_MAX_BYTES = 2**23
_DEEPEST = 50
_NEXT_STEP = "give a coupling file: avc recommend P --out FILE writes one, and avc solve P --out FILE that of a method"


@dataclass(frozen=True)
class _Column:
    """Validator of a value for each row; null, a row without, becomes NaN."""

    one: q.Quantity

    @property
    def allowed(self) -> str:
        return f"a list of numbers, {self.one.allowed}, null where a row has no gains"

    def __call__(self, value: Any) -> FloatArray:
        if not isinstance(value, list):
            raise q.refusal(f"is {q.shown(value)}; allowed: {self.allowed}")
        if len(value) > q.MOST_FREQUENCIES:
            raise q.refusal(f"has {len(value)} rows; allowed: at most {q.MOST_FREQUENCIES}")
        found, faults = np.full(len(value), np.nan), list[dict[str, Any]]()
        for row, number in enumerate(value):
            try:
                found[row] = np.nan if number is None else math.copysign(self.one(number), number)
            except PydanticCustomError as error:
                faults.append({"type": "refused", "loc": (row,), "msg": error.message(), "input": number})
        if faults:
            raise PydanticCustomError("inner", "{text}", {"text": "", "faults": faults})
        return found


def _line(value: Any) -> str:
    if not isinstance(value, str) or not value.isprintable():
        raise q.refusal(f"is {q.shown(value)}; allowed: text in one line")
    return value


_Line = Annotated[str, BeforeValidator(_line)]
_Values = np.ndarray[Any, Any]
_Hz = Annotated[_Values, BeforeValidator(_Column(q.Quantity("Hz", *q.FREQUENCIES_HZ, zero=False)))]
_Damping = Annotated[_Values, BeforeValidator(_Column(q.Quantity("N.s/m", 1e-300, q.LARGEST_DAMPING_NS_PER_M)))]
_Stiffness = Annotated[_Values, BeforeValidator(_Column(q.Quantity("N/m", 1e-300, q.LARGEST_STIFFNESS_N_PER_M)))]
_Signed = Annotated[_Values, BeforeValidator(_Column(q.Quantity("", 1e-300, 1e300, signed=True)))]
_SampleTime = Annotated[float, BeforeValidator(q.Quantity("s", 1e-300, 1e300, zero=False))]
_Time = Annotated[float, BeforeValidator(q.Quantity("s", 1e-300, 1e300))]


def _texts(value: Any) -> tuple[str, ...]:
    if not isinstance(value, list) or not all(isinstance(one, str) for one in value):
        raise q.refusal(f"is {q.shown(value)}; allowed: a list of texts")
    return tuple(value)


def _flags(value: Any) -> Any:
    if value is not None and not (isinstance(value, list) and all(isinstance(one, bool) for one in value)):
        raise q.refusal(f"is {q.shown(value)}; allowed: a list of true and false")
    return value and np.array(value)


Texts = Annotated[tuple[str, ...], BeforeValidator(_texts)]
_Flags = Annotated[Any, BeforeValidator(_flags)]


class GainTableDocument(q.Table):
    """Rows of gains as columns; a row without gains has null in both."""

    model_config = ConfigDict(arbitrary_types_allowed=True)

    frequency_hz: _Hz
    damping_ns_per_m: _Damping
    stiffness_n_per_m: _Stiffness
    contact_damping_ns_per_m: _Damping | None = None

    @property
    def present(self) -> BoolArray:
        """Whether each row has gains."""
        return np.isfinite(self.damping_ns_per_m) & np.isfinite(self.stiffness_n_per_m)

    def faults(self) -> Iterator[q.Finding]:
        """Yield columns of other lengths, or rows that contradict."""
        rows = len(self.frequency_hz)
        lengths = {
            key: len(value)
            for key, value in self
            if isinstance(value, np.ndarray) or (value and key in {"status", "reason"})
        }
        if wrong := {key: length for key, length in lengths.items() if length != rows}:
            yield from (((key,), f"has {n} values; allowed: {rows}, as frequency_hz") for key, n in wrong.items())
        else:
            yield from self._of_rows()

    def _of_rows(self) -> Iterator[q.Finding]:
        frequency = self.frequency_hz
        if len(frequency) == 0:
            yield ("frequency_hz",), "is empty; allowed: at least one row"
        for row, (before, value) in enumerate(zip([0.0, *frequency], frequency, strict=False)):
            if not value > before:
                word = "repeats" if value == before else "is not above"
                message = f"{value:g} Hz {word} the row before ({before:g} Hz); allowed: rising frequencies"
                yield ("frequency_hz", row), message
        for row in np.flatnonzero(np.isfinite(self.damping_ns_per_m) != np.isfinite(self.stiffness_n_per_m)).tolist():
            key = GAINS[int(np.isfinite(self.damping_ns_per_m[row]))]
            yield (key, row), "is null although the other gain is given; allowed: both gains, or neither"


class GainDocument(GainTableDocument):
    """The document of a schedule; keys that follow from others are not read."""

    model_config = ConfigDict(extra="ignore")

    problem: _Line | None = None
    method: _Line | None = None
    solver: _Line | None = None
    structure: Structure = "series"
    model: Model = "paper"
    sample_time_s: _SampleTime | None = None
    status: Texts | None = None
    reason: Texts | None = None
    requested_rigid: _Flags = None
    requested_damping_ns_per_m: _Signed | None = None
    requested_stiffness_n_per_m: _Signed | None = None
    requested_contact_damping_ns_per_m: _Signed | None = None
    impedance_re: _Signed | None = None
    impedance_im: _Signed | None = None
    target_re: _Signed | None = None
    target_im: _Signed | None = None
    notes: Texts = ()
    state_feedback: StateFeedbackEffect | None = None
    seconds: dict[str, _Time] | None = None

    def _of_rows(self) -> Iterator[q.Finding]:
        yield from super()._of_rows()
        present, contact = self.present, self.contact_damping_ns_per_m
        if self.sample_time_s is not None:
            limit = f"below half the sampling rate, {0.5 / self.sample_time_s:g} Hz"
            for row in np.flatnonzero(self.frequency_hz >= 0.5 / self.sample_time_s).tolist():
                message = (
                    f"is {self.frequency_hz[row]:g} Hz; allowed: {limit} at sample_time_s = {self.sample_time_s:g}"
                )
                yield ("frequency_hz", row), message
        if self.structure == "series" and contact is not None:
            for row in np.flatnonzero(contact > 0).tolist():
                message = f"is {contact[row]:g} in the series structure; allowed: 0, or structure 'damped'"
                yield (CONTACT, row), message
        elif self.structure == "damped" and contact is None:
            yield (CONTACT,), "is missing; allowed: a list of numbers, as the structure is damped"
        elif contact is not None:
            for row in np.flatnonzero(present & np.isnan(contact)).tolist():
                yield (CONTACT, row), "is null although the row has gains; allowed: a finite number >= 0"
        known = {one.value: one for one in Status}
        half = np.isnan(self.damping_ns_per_m) != np.isnan(self.stiffness_n_per_m)
        for row, value in enumerate(self.status or ()):
            if value not in known:
                yield ("status", row), f"is {q.shown(value)}; allowed: {', '.join(known)}"
            elif known[value].has_gains != present[row] and not half[row]:
                has = "has gains" if present[row] else "has no gains"
                allowed = ", ".join(name for name, one in known.items() if one.has_gains)
                message = f"is {q.shown(value)} but the row {has}; allowed with gains: {allowed}"
                yield ("status", row), message
        if self.state_feedback is not None:
            try:
                feedback_of(self.state_feedback)
            except InputError as error:
                yield from ((("state_feedback", fault.key), fault.message) for fault in error.faults)


def feedback_of(table: StateFeedbackEffect | None) -> StateFeedback | None:
    """Return the state feedback of a table of its numbers."""
    return None if table is None else StateFeedback(**table.model_dump(exclude={"kind"}))


def faults_of(
    findings: Sequence[q.Finding], file: str, lines: Sequence[int] | None = None, prefix: tuple[str, ...] = ()
) -> list[Fault]:
    """Return faults of a document; one of a row names its line where the file has a line for each row."""
    found = []
    for path, message in findings:
        if len(path) == 2 and isinstance(path[1], int):
            line = None if lines is None else lines[path[1]]
            found.append(Fault(file, line, q.dotted((*prefix, path[0])), f"row {path[1] + 1}: {message}"))
        else:
            found.append(Fault(file, None, q.dotted((*prefix, *path)), message))
    return found


def schedule_of_document(
    document: Mapping[str, Any], path: Path, lines: Sequence[int] | None = None, faults: Sequence[Fault] = ()
) -> GainSchedule:
    """Return the schedule of a gain document."""
    found = checked(GainDocument, document)
    if isinstance(found, list) or faults:
        more = found if isinstance(found, list) and (document.get("frequency_hz") or not faults) else ()
        raise InputError([*faults, *faults_of(more, str(path), lines)])
    return schedule_of(found, path)


def schedule_of(found: GainDocument, path: Path) -> GainSchedule:
    """Return the schedule of a sound document."""
    nothing = np.full(len(found.frequency_hz), np.nan)

    def given(values: FloatArray | None, default: FloatArray = nothing) -> FloatArray:
        return default if values is None else values

    present = found.present
    contact = given(found.contact_damping_ns_per_m)
    of_series = np.where(np.isnan(contact), 0.0, contact) if found.structure == "series" else contact
    rigid = np.zeros(len(nothing), dtype=bool) if found.requested_rigid is None else found.requested_rigid
    return GainSchedule(
        problem=found.problem or path.stem,
        method=found.method or "file",
        solver=found.solver or None,
        structure=found.structure,
        model=found.model,
        sample_time_s=math.nan if found.sample_time_s is None else found.sample_time_s,
        frequency_hz=found.frequency_hz,
        damping_ns_per_m=found.damping_ns_per_m,
        stiffness_n_per_m=found.stiffness_n_per_m,
        contact_damping_ns_per_m=np.where(present & np.isnan(contact), 0.0, contact),
        impedance=given(found.impedance_re) + 1j * given(found.impedance_im),
        target=given(found.target_re) + 1j * given(found.target_im),
        status=tuple(map(Status, found.status or ()))
        or tuple(Status.SOLVED if has else Status.INFEASIBLE for has in present),
        reason=found.reason or ("",) * len(nothing),
        notes=found.notes,
        state_feedback=feedback_of(found.state_feedback),
        requested_damping_ns_per_m=np.where(rigid, np.inf, given(found.requested_damping_ns_per_m)),
        requested_stiffness_n_per_m=np.where(rigid, np.inf, given(found.requested_stiffness_n_per_m)),
        requested_contact_damping_ns_per_m=given(found.requested_contact_damping_ns_per_m, of_series),
        build_seconds=(found.seconds or {}).get("build", 0.0),
        solve_seconds=(found.seconds or {}).get("solve", 0.0),
    )


def gain_document(gains: GainSchedule) -> dict[str, Any]:
    """Return the `solve` document without its certificate: JSON values only."""
    same = {key: plain(getattr(gains, key)) for key in GainDocument.model_fields if hasattr(gains, key)}
    derived = {key: plain(getattr(gains, key)) for key in ("magnitude_error", "complex_error", "real_part")}
    curves = {
        f"{name}_{part}": plain(getattr(curve, kind))
        for name, curve in (("impedance", gains.impedance), ("target", gains.target))
        for part, kind in (("re", "real"), ("im", "imag"))
    }
    return {"schema": SCHEMA, **same, **curves, **derived} | {
        "counts": gains.counts(),
        "state_feedback": None if gains.state_feedback is None else asdict(gains.state_feedback),
        "seconds": {"build": gains.build_seconds, "solve": gains.solve_seconds},
    }


def gain_csv(gains: GainSchedule) -> str:
    """Return the usable rows as CSV text; a contact damping column is added in the damped structure."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    keys = (*_CSV_HEADER, CONTACT) if gains.structure == "damped" else _CSV_HEADER
    writer.writerow(map(gains.units.key, keys))
    for row in np.flatnonzero(gains.usable).tolist():
        writer.writerow([repr(float(getattr(gains, key)[row])) for key in keys])
    return text.getvalue()


def read_document(path: Path) -> dict[str, Any]:
    """Read the document of a JSON gain or coupling file; its values are not checked yet."""
    repeated: list[str] = []

    def table(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        repeated.extend(key for key, count in Counter(key for key, _ in pairs).items() if count > 1)
        return dict(pairs)

    text = read_text(path, _MAX_BYTES, _NEXT_STEP)
    try:
        document = json.loads(text, object_pairs_hook=table)
    except (ValueError, RecursionError) as error:  # ValueError: also an integer of more digits than Python reads
        line = getattr(error, "lineno", None)
        raise InputError([Fault(str(path), line, "", f"is not JSON ({error}); {_NEXT_STEP}")]) from error
    if repeated:
        message = "stands more than once in a table; allowed: once, or the file means two things"
        raise InputError([Fault(str(path), None, key, message) for key in dict.fromkeys(repeated)])
    if not isinstance(document, dict):
        raise InputError.of(f"holds no gain document; {_NEXT_STEP}", file=str(path))
    level: list[Any] = [document]
    for _ in range(_DEEPEST):
        held = (one.values() if isinstance(one, dict) else one for one in level)
        level = [inner for values in held for inner in values if isinstance(inner, dict | list)]
    if level:
        raise InputError.of(f"is nested too deeply; {_NEXT_STEP}", file=str(path))
    return document


def units_of_document(document: Mapping[str, Any]) -> Units:
    """Return the units of a document that was read, as it declares them."""
    return ROTARY if document.get("motion") == ROTARY.motion else LINEAR


def _json_table(value: Any) -> Any:
    """Return a table that is kept unchanged, or refuse what no JSON file holds."""
    if not isinstance(value, Mapping | None):
        raise q.refusal("must be a table or null")
    try:
        json.dumps(value, allow_nan=False)
    except ValueError:
        raise q.refusal("holds a number that is not finite; allowed: JSON values") from None
    return value


JsonTable = Annotated[dict[str, Any] | None, BeforeValidator(_json_table)]


def read_csv(path: Path) -> GainSchedule:
    """Read the bare table of a CSV file."""
    faults: list[Fault] = []
    reader = csv.reader(io.StringIO(read_text(path, _MAX_BYTES, _NEXT_STEP)))
    try:
        lines = [(reader.line_num, cells) for cells in islice(reader, q.MOST_FREQUENCIES + 2)]
    except csv.Error as error:
        raise InputError.of(f"is not CSV ({error}); {_NEXT_STEP}", file=str(path)) from error
    header = tuple(ROTARY.inner(cell.strip()) for cell in lines[0][1]) if lines else ()
    if header not in {_CSV_HEADER, (*_CSV_HEADER, CONTACT)}:
        message = f"header is {','.join(header) or 'missing'}; allowed: {','.join(_CSV_HEADER)}[,{CONTACT}]"
        raise InputError([Fault(str(path), 1, "", message)])
    if len(lines) > q.MOST_FREQUENCIES + 1:
        raise InputError.of(f"has more rows than a gain table; allowed: at most {q.MOST_FREQUENCIES}", file=str(path))
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
    return schedule_of_document(document, path, [number for number, _ in rows], faults)
