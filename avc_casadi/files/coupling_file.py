"""The file of a coupling: problem, table, runtime, certificate and trial; and tables of gains alone."""

from __future__ import annotations

import csv
import hashlib
import io
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import singledispatch
from itertools import pairwise
from os import PathLike
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, ConfigDict, Field

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.files import read_text, write_file
from avc_casadi._util.json_values import Document, json_text, plain, plain_table
from avc_casadi._util.units import LINEAR, ROTARY
from avc_casadi.coupling import Coupling, TrialRecord, require_coupling, schedule_of, thinned
from avc_casadi.files.border import in_keys_of
from avc_casadi.files.catalogue import require_source
from avc_casadi.files.kinds import require_coupling_text
from avc_casadi.files.problem_file import AnyProblem, problem_document, require_device
from avc_casadi.model import quantity as q
from avc_casadi.model import table as t
from avc_casadi.model.ends import End, ToolGains, Wall
from avc_casadi.model.gains import TABLE_COLUMNS, GainSchedule, GainTable
from avc_casadi.model.problem import Problem
from avc_casadi.model.runtime import Runtime

MOST_BYTES = 2**23
"""Largest coupling file that is read, bytes."""
NEXT_STEP = "give a coupling file, as written by avc recommend P --out FILE or avc solve P --out FILE"
"""Advice on an unreadable coupling file."""
_LEAST_GAIN = 1e-300
"""Smallest gain of a table other than 0, in its SI unit."""

_Damping = Annotated[float, BeforeValidator(q.Quantity("N.s/m", _LEAST_GAIN, q.LARGEST_DAMPING_NS_PER_M))]
_Dampings = Annotated[tuple[_Damping, ...], BeforeValidator(q.sequence)]
_Stiffness = Annotated[float, BeforeValidator(q.Quantity("N/m", _LEAST_GAIN, q.LARGEST_STIFFNESS_N_PER_M))]
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


_GAIN_KEYS = (
    "problem",
    "method",
    "solver",
    "structure",
    "model",
    "sample_time_s",
    *TABLE_COLUMNS,
    "status",
    "reason",
    "requested_rigid",
    "requested_damping_ns_per_m",
    "requested_stiffness_n_per_m",
    "requested_contact_damping_ns_per_m",
    "notes",
    "magnitude_error",
    "complex_error",
    "real_part",
)
"""Attributes of a schedule that the `solve` document holds under their names."""


def gain_document(gains: GainSchedule) -> dict[str, Any]:
    """Return the `solve` document without its certificate: JSON values only."""
    law = gains.state_feedback
    return {
        "schema": "avc-gains/1",
        **{key: plain(getattr(gains, key)) for key in _GAIN_KEYS},
        "impedance_re": plain(gains.impedance.real),
        "target_re": plain(gains.target.real),
        "impedance_im": plain(gains.impedance.imag),
        "target_im": plain(gains.target.imag),
        "counts": gains.counts(),
        "state_feedback": None if law is None else law.model_dump(exclude={"kind"}),
        "seconds": {"build": gains.build_seconds, "solve": gains.solve_seconds},
    }


def gain_csv(gains: GainSchedule) -> str:
    """Return the usable rows as CSV text; a contact damping column is added in the damped structure."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    keys = TABLE_COLUMNS if gains.structure == "damped" else TABLE_COLUMNS[:3]
    writer.writerow(map(gains.units.key, keys))
    usable = np.flatnonzero(gains.usable).tolist()
    writer.writerows([repr(float(getattr(gains, key)[row])) for key in keys] for row in usable)
    return text.getvalue()


def read_csv(path: Path) -> GainTable:
    """Read a gain table from CSV: a header of `TABLE_COLUMNS` (the last is optional), and a row for each frequency."""
    file = str(path)
    reader = csv.reader(io.StringIO(read_text(path, MOST_BYTES, NEXT_STEP)))
    try:
        rows = [(reader.line_num, cells) for cells in reader if cells]
    except csv.Error as error:
        raise InputError.of(f"is not CSV ({error}); {NEXT_STEP}", file=file) from error
    header = tuple(ROTARY.inner(cell.strip()) for cell in rows[0][1]) if rows else ()
    if header not in (TABLE_COLUMNS[:3], TABLE_COLUMNS):
        required = ",".join(TABLE_COLUMNS[:3])
        message = f"header is {','.join(header) or 'missing'}; allowed: {required}[,{TABLE_COLUMNS[3]}]"
        raise InputError([Fault(file, 1, "", message)])
    lines = [line for line, _ in rows[1:]]
    faults = [
        Fault(file, line, "", f"has {len(cells)} values; allowed: {len(header)}")
        for line, cells in rows[1:]
        if len(cells) != len(header)
    ]
    if faults:
        raise InputError(faults)
    numbers = [[_number(cell) for cell in cells] for _, cells in rows[1:]]
    # Without rows there are no columns either, which the check finds.
    columns = dict(zip(header, zip(*numbers, strict=True), strict=False))
    result = t.checked(GainColumns, columns)
    if isinstance(result, GainColumns):
        return result.table()
    raise InputError([_fault_in_csv(file, lines, path, message) for path, message in result])


def _fault_in_csv(file: str, lines: list[int], path: t.Path, message: str) -> Fault:
    """Return a finding of a column, or of a row in it, with the line of that row."""
    key, *row = path
    line = lines[row[0]] if row and isinstance(row[0], int) else None
    return Fault(file, line, str(key), message)


def _number(cell: str) -> float | str:
    """Return the number of a cell, or its text where it is none."""
    try:
        return float(cell)
    except ValueError:
        return cell


COUPLING_SCHEMA = "avc-coupling/1"
"""Name and version of the layout of a coupling file."""


@dataclass(frozen=True)
class RecordedCertificate(Document):
    """The certificate of a coupling as its file has it; the file's id says nothing of it, so no verdict rests on it."""

    values: Mapping[str, Any]

    def document(self) -> dict[str, Any]:
        """Return the values of the file."""
        return plain_table(self.values)


@dataclass(frozen=True)
class RecordedTrial(TrialRecord):
    """The trial of a coupling as its file has it."""

    values: Mapping[str, Any]

    @property
    def largest_tap_force_n(self) -> float:
        """Largest force of a tap, N; 0 where the file has none."""
        return float(self.values.get("tap_force_n") or 0.0)

    def document(self) -> dict[str, Any]:
        """Return the values of the file."""
        return plain_table(self.values)


class _Document(t.Table):
    """What every coupling file holds; keys that follow from others are not read."""

    model_config = ConfigDict(extra="ignore")

    id: Any = None
    problem_file: Problem
    certificate: dict[str, Any] | None = None
    trial: dict[str, Any] | None = None
    versions: dict[str, Any] = Field(default_factory=dict)


class WallDocument(_Document):
    """The file of a coupling to a wall."""

    method: t.Text
    table: GainColumns
    runtime: Runtime
    without_gains_hz: tuple[q.Hertz, ...] = Field((), strict=False)
    lacks: tuple[t.Text, ...] = Field((), strict=False)

    def coupling(self) -> Coupling:
        """Return the coupling."""
        table = self.table.table()
        runtime = self.runtime
        schedule = schedule_of(self.problem_file, table, self.method, runtime.state_feedback, self.without_gains_hz)
        return Coupling(self.problem_file, schedule, table, runtime, lacks=self.lacks)


def _other_end(value: Any) -> str:
    """Return the name of the table of another end, or refuse what is none."""
    tables = Problem.end_tables()
    if isinstance(value, str) and value in tables:
        return value
    raise t.refusal(f"is {t.shown(value)}; allowed: {t.one_of(tables, value)}")


class PairDocument(_Document):
    """The file of a coupling to another end than a wall: a spring, a damper, and the damper of each local loop."""

    end: Annotated[str, BeforeValidator(_other_end)]
    stiffness_n_per_m: q.Stiffness
    damping_ns_per_m: q.Damping
    local_damping_ns_per_m: q.Damping

    def faults(self) -> Iterator[t.Finding]:
        """Yield a problem without the other end."""
        if self.problem_file.end.kind != self.end:
            yield ("problem_file", self.end), f"is missing; allowed: the table [{self.end}] of the problem"

    def coupling(self) -> Coupling:
        """Return the coupling."""
        gains = ToolGains(self.stiffness_n_per_m, self.damping_ns_per_m, self.local_damping_ns_per_m)
        return Coupling.to_end(self.problem_file, gains)


def coupling_document(coupling: Coupling) -> dict[str, Any]:
    """Return the document of a coupling: JSON values only."""
    return {
        "schema": COUPLING_SCHEMA,
        "end": coupling.end.kind,
        "id": coupling.id,
        "problem_file": problem_document(coupling.problem),
        "certificate": plain(coupling.certificate),
        "trial": plain(coupling.trial),
        "versions": plain(dict(coupling.versions)),
        **_runs(coupling.end, coupling),
    }


@singledispatch
def _runs(end: End, coupling: Coupling) -> dict[str, Any]:  # noqa: ARG001 - a spring and dampers, to any other end
    """Return what runs at an end."""
    return vars(coupling.gains)


@_runs.register
def _runs_at_wall(end: Wall, coupling: Coupling) -> dict[str, Any]:  # noqa: ARG001
    """Return what a coupling to a wall runs, as its file states it: method, table and runtime."""
    return {
        "method": coupling.method,
        "structure": coupling.structure,
        "table": plain(coupling.table.to_dict()),
        "without_gains_hz": plain(coupling.schedule.frequency_hz[~coupling.schedule.usable]),
        "runtime": coupling.runtime.document(),
        "lacks": list(coupling.lacks),
    }


def write_coupling(coupling: Coupling, path: str | Path) -> None:
    """Write a coupling file, JSON: the problem, the gains, what runs beside them, and the certificate.

    Args:
        coupling: as `recommend` returns it, or `Coupling.from_schedule` makes it from the gains of `solve`.
        path: of the file, .json, which is replaced.

    Raises:
        InputError: it is not a coupling, or the file cannot be written.

    Example:
        >>> problem = avc.load_problem("soft")
        >>> avc.write_coupling(avc.Coupling.from_schedule(problem, avc.solve(problem, "static-tuned")), "soft.json")
        >>> avc.read_coupling("soft.json").method
        'static-tuned'
    """
    if not isinstance(coupling, Coupling):
        require_coupling(coupling)
    if not isinstance(path, str | PathLike) or Path(path).suffix.lower() != ".json":
        raise InputError.of(f"is {t.shown(path)}; allowed: the path of a file that ends in .json", key="path")
    text = coupling_text(coupling)
    try:
        write_file(str(path), text)
    except (OSError, ValueError) as error:  # ValueError: a NUL character in the name
        why = getattr(error, "strerror", None) or error
        raise InputError.of(f"cannot be written: {why}", file=str(path)) from error


def coupling_text(coupling: Coupling, **further: Any) -> str:
    """Return the text of a coupling file, with what else stands in it, and the digest of all."""
    document = further | coupling_document(coupling)
    return json_text(document | {_DIGEST: _digest(json_text(document, coupling.units))}, coupling.units)


_DIGEST = "digest"
"""Key of the digest of a coupling file."""
_DIGEST_DIGITS = 16
"""Hexadecimal digits of a digest."""


def _digest(text: str) -> str:
    """Return the digest of all values of a JSON text but its own, whatever their order, their spaces and spelling.

    It finds edits by hand; it does not prove who wrote a file.
    """

    def number(digits: str) -> float:
        return float(digits) + 0.0  # 1, 1.0 and 1e0 are one number, and a zero has no sign

    values = json.loads(text, parse_int=number, parse_float=number)
    values.pop(_DIGEST, None)
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:_DIGEST_DIGITS]


def _without_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return a table of JSON, or refuse one in which a key stands twice: a reader would take one of the two."""
    table = dict(pairs)
    if len(table) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in table if keys.count(key) > 1)
        raise InputError.of("stands twice in the same table; allowed: once", key=twice)
    return table


def _edited(text: str, digest: object) -> bool:
    """Return whether a file was changed after avc wrote it; files of earlier releases have no digest to compare."""
    return digest is not None and digest != _digest(text)


def read_file(path: str | Path) -> Coupling | GainTable:
    """Read a file: a coupling, or a table of gains alone as CSV."""
    require_source(path, "the path of a coupling file, .json or .csv")
    path, file = Path(path), str(path)
    if path.suffix.lower() == ".csv":
        return read_csv(path)
    text = read_text(path, MOST_BYTES, NEXT_STEP)
    require_coupling_text(text, file)
    try:
        document = json.loads(text, object_pairs_hook=_without_duplicates)
        edited = isinstance(document, dict) and _edited(text, document.pop(_DIGEST, None))
    except InputError as error:
        raise InputError([replace(fault, file=file) for fault in error.faults]) from error
    except (ValueError, RecursionError) as error:  # ValueError: also an integer of more digits than Python reads
        line = getattr(error, "lineno", None)
        raise InputError([Fault(file, line, "", f"is not JSON ({error}); {NEXT_STEP}")]) from error
    if not isinstance(document, dict):
        raise InputError.of(f"has no coupling; {NEXT_STEP}", file=file)
    units = ROTARY if document.get("motion") == ROTARY.motion else LINEAR
    with in_keys_of(units):
        document = units.read(document)
        if document.pop("schema", None) != COUPLING_SCHEMA:
            raise InputError.of(f'is not "{COUPLING_SCHEMA}", as in a coupling; {NEXT_STEP}', file=file, key="schema")
        to_wall = document.get("end", Wall.kind) == Wall.kind
        kind: type[WallDocument | PairDocument] = WallDocument if to_wall else PairDocument
        valid = t.valid(kind, document, file)
        coupling: Coupling = valid.coupling()
        if valid.id != coupling.id:
            message = f"is {t.shown(valid.id)}, but the content has the id {coupling.id!r}: the file was edited"
            raise InputError.of(f"{message}; make it again: avc recommend P --out FILE", file=file, key="id")
        return replace(
            coupling,
            certificate=None if valid.certificate is None else RecordedCertificate(valid.certificate),
            trial=None if valid.trial is None else RecordedTrial(valid.trial),
            versions=valid.versions,
            edited=edited,
        )


def read_coupling(path: str | Path, problem: AnyProblem | None = None) -> Coupling:
    """Read a coupling file; or a CSV table of gains, with the problem that it was made for.

    Args:
        path: .json or .csv.
        problem: for a table of gains; a coupling file must include the same.

    Returns:
        The coupling, its table as it was written: what was certified is what runs.

    Raises:
        InputError: with every fault of the file; or it has no problem and none is given; or it was made for another
            sample time.

    Example:
        >>> avc.write_coupling(avc.Coupling.from_schedule(avc.load_problem("soft"), avc.solve("soft")), "soft.json")
        >>> avc.read_coupling("soft.json").method
        'direct'
    """
    content = read_file(path)
    file = str(path)
    if problem is None:
        if isinstance(content, Coupling):
            return content
        message = (
            "is a table of gains without the problem (wall, hands, device, force limit); give the problem that it was "
            "made for: --problem P, or read_coupling(path, problem)"
        )
        raise InputError.of(message, file=file)
    stated = require_device(problem)
    if isinstance(content, GainTable):
        return coupling_beside(stated, content, file)
    if same_problem(stated, content.problem):
        return content
    message = f"is {stated.name}, but the coupling file contains another problem, {content.problem.name}; leave it out"
    raise InputError.of(message, file=file, key="problem")


def coupling_beside(problem: Problem, table: GainTable, file: str) -> Coupling:
    """Make a coupling of a table of gains alone and its problem; it states what it lacks."""
    nyquist_hz = 0.5 / problem.device.sample_time_s
    if table.frequency_hz[-1] >= nyquist_hz:
        message = f"is {table.frequency_hz[-1]:g} Hz; allowed: below half the sampling rate, {nyquist_hz:g} Hz"
        raise InputError.of(message, file=file, key="frequency_hz")
    lacks = (
        "the runtime parts (observer, estimator, adaptation, guard): the defaults are used",
        "its certificate on the loop as it is",
    )
    return Coupling(problem, schedule_of(problem, table, "file"), thinned(table), lacks=lacks)


def same_problem(first: Problem, second: Problem) -> bool:
    """Return whether two problems are equal but for their names and titles."""
    words = {"name", "title", "source"}
    return first.model_dump(exclude=words) == second.model_dump(exclude=words)
