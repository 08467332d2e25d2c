"""The file of a coupling: the `solve` document with problem, table, runtime, certificate and trial."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, Literal, get_args

import numpy as np
from pydantic import ConfigDict

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.files import write_file
from avc_casadi._util.json_values import json_text, plain
from avc_casadi.coupling import Coupling, End, check_sample_time, require_coupling
from avc_casadi.files.border import in_keys_of
from avc_casadi.files.catalogue import require_source
from avc_casadi.files.gain_file import (
    SCHEMA,
    GainDocument,
    GainTableDocument,
    JsonTable,
    Texts,
    faults_of,
    feedback_of,
    gain_document,
    read_csv,
    read_document,
    schedule_of,
    schedule_of_document,
    units_of_document,
)
from avc_casadi.files.problem_document import problem_document
from avc_casadi.files.problem_file import AnyProblem, as_problem
from avc_casadi.model import quantity as q
from avc_casadi.model.effects import StateFeedbackEffect
from avc_casadi.model.findings import checked
from avc_casadi.model.gains import GainTable
from avc_casadi.model.problem import Problem
from avc_casadi.model.runtime import Runtime
from avc_casadi.model.schedule import GainSchedule
from avc_casadi.model.virtual_tool import ToolGains

COUPLING_SCHEMA = "avc-coupling/1"
_AGAIN = "make it again: avc recommend P --out FILE, or avc solve P --out FILE"
_TABLE = tuple(GainTableDocument.model_fields)
GAINS_ALONE = (
    "is a table of gains alone; it lacks the problem (wall, hands, device, force limit), what runs beside the gains "
    "and the certificate. Give the problem that it was made for beside it"
)
"""What a gain file without a problem lacks."""
_LACKS = (
    "what runs beside the gains: observer, estimator, adaptation, guard; those of a coupling that names none are taken",
    "its certificate on the loop as it is",
)


class RuntimeDocument(q.Table):
    """What runs beside the gains, as a file states it."""

    estimator: Literal["zero-crossing", "spectral-peak", "adaptive-notch", "fused"] = "fused"
    hold_s: q.Wait = 0.2
    slew_per_s: q.Rate | None = 20.0
    passive: bool = True
    observer_mass_kg: q.Mass | None = None
    guard: Literal["passivity-controller", "energy-tank"] | None = None
    state_feedback: StateFeedbackEffect | None = None


class PairDocument(q.Table):
    """The file of a coupling to a simulation or a second device; `in_scene` and `at_follower` follow from the gains."""

    end: Literal["simulation", "follower"]
    id: Any = None
    stiffness_n_per_m: q.Stiffness
    damping_ns_per_m: q.Damping
    local_damping_ns_per_m: q.Damping
    problem_file: Problem
    certificate: JsonTable = None
    trial: JsonTable = None
    versions: JsonTable = None
    in_scene: Any = None
    at_follower: Any = None
    motion: Any = None
    units: Any = None

    def faults(self) -> Iterator[q.Finding]:
        """Yield a problem without the other end."""
        if getattr(self.problem_file, self.end) is None:
            yield ("problem_file", self.end), "is missing; allowed: the table of the other end"


class CouplingDocument(GainDocument):
    """The file of a coupling; keys that follow from others must agree with them."""

    model_config = ConfigDict(extra="forbid")
    follow: ClassVar[tuple[str, ...]] = ("wall", "contact", "max_force_n")

    end: Literal["wall"] = "wall"
    id: Any = None
    problem_file: Problem
    table: GainTableDocument
    runtime: RuntimeDocument
    certificate: JsonTable = None
    trial: JsonTable = None
    versions: JsonTable = None
    lacks: Texts = ()
    wall: Any = None
    contact: Any = None
    max_force_n: Any = None
    title: Any = None
    constant: Any = None
    magnitude_error: Any = None
    complex_error: Any = None
    real_part: Any = None
    counts: Any = None
    deployable: Any = None
    realism: Any = None
    passive_limit_n_per_m: Any = None
    motion: Any = None
    units: Any = None


def coupling_document(coupling: Coupling) -> dict[str, Any]:
    """Return the document of a coupling: JSON values only."""
    kept = {
        "schema": COUPLING_SCHEMA,
        "end": coupling.end,
        "id": coupling.id,
        "problem_file": problem_document(coupling.problem),
        "certificate": None if coupling.certificate is None else plain(dict(coupling.certificate)),
        "trial": None if coupling.trial is None else plain(dict(coupling.trial)),
        "versions": dict(coupling.versions),
    }
    if coupling.end == "simulation":
        there = {key: value for key, value in vars(coupling.in_scene).items() if key != "local_damping_ns_per_m"}
        return {**kept, **vars(coupling.gains), "in_scene": there}
    if coupling.end == "follower":
        return {**kept, **vars(coupling.gains), "at_follower": vars(coupling.at_follower)}
    wall = coupling.wall
    columns = zip(_TABLE, coupling.table.rows.T, strict=True)
    gains = {key: value for key, value in gain_document(coupling.schedule).items() if key != "state_feedback"}
    return {
        **gains,
        **kept,
        "title": coupling.problem.title,
        "structure": coupling.structure,
        "contact": coupling.contact,
        "constant": coupling.table.constant,
        "table": {name: plain(column) for name, column in columns},
        "runtime": coupling.runtime.document(),
        "wall": {"damping_ns_per_m": wall.damping_ns_per_m, "stiffness_n_per_m": wall.stiffness_n_per_m},
        "sample_time_s": coupling.sample_time_s,
        "max_force_n": coupling.max_force_n,
        "lacks": list(coupling.lacks),
    }


def write_coupling(coupling: Coupling, path: str | Path) -> None:
    """Write a coupling file.

    Raises:
        InputError: it is not a coupling.

    Example:
        >>> avc.write_coupling(avc.Coupling.of(avc.load_problem("soft"), avc.solve("soft")), "soft.json")
    """
    if not isinstance(coupling, Coupling):
        require_coupling(coupling)
    write_file(path, json_text(coupling_document(coupling), coupling.units))


def read_file(path: str | Path) -> Coupling | GainSchedule:
    """Read a file: a coupling, checked whole; or a table of gains alone, CSV or of release 0.1.0."""
    require_source(path, "the path of a coupling file, .json or .csv")
    path = Path(path)
    if path.suffix.lower() == ".csv":
        return read_csv(path)
    document = read_document(path)
    units = units_of_document(document)
    with in_keys_of(units):
        document = units.read(document)
        if document.get("schema") == COUPLING_SCHEMA and document.get("end", "wall") != "wall":
            return _pair(document, path)
        if document.get("schema") == COUPLING_SCHEMA or "problem_file" in document:
            return _from_document(document, path)
        if document.get("schema", SCHEMA) != SCHEMA:
            message = f"is {q.shown(document['schema'])}; allowed: {q.shown(SCHEMA)}, {q.shown(COUPLING_SCHEMA)}"
            raise InputError.of(message, file=str(path), key="schema")
        return schedule_of_document(document, path)


def end_of(path: str | Path) -> End | None:
    """Return what the coupling of a file leads to; None of gains alone, of another file and of what cannot be read."""
    try:
        document = read_document(Path(path)) if str(path).lower().endswith(".json") else {}
    except InputError:
        return None
    end: End = document.get("end", "wall")
    return end if document.get("schema") == COUPLING_SCHEMA and end in get_args(End) else None


def read_coupling(path: str | Path, problem: AnyProblem | None = None) -> Coupling:
    """Read a coupling file; or a gain file of release 0.1.0 or a CSV, with the problem that it was made for.

    Args:
        path: .json or .csv.
        problem: for files that do not include it; a file that does must include the same.

    Raises:
        InputError: with every fault of the file; or it has no problem and none is given; or it was made for another
            sample time.

    Example:
        >>> avc.write_coupling(avc.Coupling.of(avc.load_problem("soft"), avc.solve("soft")), "soft.json")
        >>> avc.read_coupling("soft.json").method
        'direct'
    """
    found = read_file(path)
    if isinstance(found, Coupling):
        if problem is not None and not same_problem(as_problem(problem), found.problem):
            raise InputError.of(
                f"carries its own problem, {found.problem.name}, and {as_problem(problem).name} is another; leave it "
                "out",
                file=str(path),
                key="problem",
            )
        return found
    if problem is None:
        raise InputError.of(f"{GAINS_ALONE}: read_coupling(path, problem)", file=str(path))
    return coupling_beside(as_problem(problem), found, str(path))


def coupling_beside(problem: Problem, schedule: GainSchedule, file: str) -> Coupling:
    """Make a coupling of a table of gains alone and its problem; it states what it lacks."""
    check_sample_time(schedule.sample_time_s, problem, file)
    return replace(Coupling.of(problem, schedule), lacks=_LACKS)


def same_problem(one: Problem, other: Problem) -> bool:
    """Return whether two problems are equal but for their names and titles."""
    words = {"name", "title", "source"}
    return one.model_dump(exclude=words) == other.model_dump(exclude=words)


def _from_document(document: Mapping[str, Any], path: Path) -> Coupling:
    if document.get("schema") != COUPLING_SCHEMA:
        message = f"is {q.shown(document.get('schema'))}, beside a problem; allowed: {q.shown(COUPLING_SCHEMA)}"
        raise InputError.of(message, file=str(path), key="schema")
    found = checked(CouplingDocument, {key: value for key, value in document.items() if key != "schema"})
    if isinstance(found, list):
        raise InputError(faults_of(found, str(path)))
    runtime = {**vars(found.runtime), "state_feedback": feedback_of(found.runtime.state_feedback)}
    table = found.table.model_dump()
    coupling = Coupling(
        problem=found.problem_file,
        schedule=replace(schedule_of(found, path), state_feedback=runtime["state_feedback"]),
        table=GainTable(np.stack([np.nan_to_num(table[key]) for key in _TABLE], axis=1)),
        runtime=Runtime(**runtime),
        certificate=found.certificate,
        trial=found.trial,
        versions=found.versions or {},
        lacks=found.lacks,
    )
    check_sample_time(coupling.schedule.sample_time_s, coupling.problem, str(path))
    _check_whole(coupling, found, path)
    return coupling


def _pair(document: Mapping[str, Any], path: Path) -> Coupling:
    found = checked(PairDocument, {key: value for key, value in document.items() if key != "schema"})
    if isinstance(found, list):
        raise InputError(faults_of(found, str(path)))
    gains = ToolGains(found.stiffness_n_per_m, found.damping_ns_per_m, found.local_damping_ns_per_m)
    made = Coupling.between(found.problem_file, gains, found.certificate, found.trial, found.versions)
    coupling = replace(made, end=found.end)
    if found.id != coupling.id:
        raise InputError([_changed(found.id, coupling, path)])
    return coupling


def _changed(given: Any, coupling: Coupling, path: Path) -> Fault:
    message = f"is {q.shown(given)}, and what the file holds is {coupling.id!r}: it was changed since"
    return Fault(str(path), None, "id", f"{message}; {_AGAIN}")


def _check_whole(coupling: Coupling, found: CouplingDocument, path: Path) -> None:
    """Refuse a file that was changed in part: what is certified must be what runs."""
    faults = [] if found.id == coupling.id else [_changed(found.id, coupling, path)]
    beside = GainTable.of(coupling.schedule)(coupling.table.frequency_hz)
    if not np.allclose(beside, coupling.table.gains, rtol=1e-9, atol=0.0):
        faults.append(Fault(str(path), None, "table", f"is not that of the gains beside it; {_AGAIN}"))
    document = coupling_document(coupling)
    for key in CouplingDocument.follow:
        if getattr(found, key) != document[key]:
            message = f"is not that of problem_file and gains, {q.shown(document[key])}; {_AGAIN}"
            faults.append(Fault(str(path), None, key, message))
    if faults:
        raise InputError(faults)
