"""The file of a coupling: the `solve` document with problem, table, runtime, certificate and trial."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import ValidationError

from avc_casadi._errors import Fault, InputError
from avc_casadi._util.files import write_file
from avc_casadi._util.json_values import json_text, plain
from avc_casadi._util.units import speaking, spoken_key
from avc_casadi.coupling import FIRST_CONTACT, Coupling, check_sample_time, require_coupling
from avc_casadi.files.gain_document import COUPLING_SCHEMA, GainCheck, state_feedback_of
from avc_casadi.files.gain_file import gain_document, read_csv, read_document, units_of_document, unsound_tables
from avc_casadi.files.other_end_coupling_file import TELEOPERATOR_SCHEMA, TOOL_SCHEMA
from avc_casadi.files.problem_document import problem_document, problem_of
from avc_casadi.files.problem_file import AnyProblem, as_problem
from avc_casadi.model.gains import GainTable
from avc_casadi.model.problem import Problem
from avc_casadi.model.runtime import Runtime

if TYPE_CHECKING:
    from avc_casadi.model.schedule import GainSchedule

_TABLE = ("frequency_hz", "damping_ns_per_m", "stiffness_n_per_m", "contact_damping_ns_per_m")
# Names in this file of the keys of a scene's effect.
_RUNTIME_KEYS = {"mass_kg": "observer_mass_kg", "method": "estimator"}
GAINS_ALONE = (
    "is a table of gains alone; it lacks the problem (wall, hands, device, force limit), what runs beside the gains "
    "and the certificate. Give the problem that it was made for beside it"
)
"""What a gain file without a problem lacks."""
_TO_SIMULATION = (
    "couples a device to a [simulation]: it has no wall and no gain table, and its tool moves in an engine; "
    "avc export, avc certify and avc simulate take it"
)
_TO_FOLLOWER = (
    "couples a leader to a [follower]: it has no wall and no gain table; avc export takes it, and avc recommend judges "
    "its problem"
)
_WRITTEN = (
    "schema id problem title problem_file method solver structure model contact constant sample_time_s max_force_n "
    "frequency_hz damping_ns_per_m stiffness_n_per_m contact_damping_ns_per_m impedance_re impedance_im target_re "
    "target_im magnitude_error complex_error real_part status reason requested_damping_ns_per_m "
    "requested_stiffness_n_per_m requested_contact_damping_ns_per_m requested_rigid counts notes seconds table "
    "runtime wall certificate trial versions lacks"
)
COUPLING_KEYS = tuple(_WRITTEN.split())
"""Keys of a coupling file: those of `solve`, and its own."""
# Further keys by `avc solve`, and those that mark a rotary device.
_BESIDE = ("state_feedback", "deployable", "realism", "passive_limit_n_per_m", "motion", "units")
_LACKS = (
    "what runs beside the gains: observer, estimator, adaptation, guard; those of a coupling that names none are taken",
    "its certificate on the loop as it is",
)


def coupling_document(coupling: Coupling) -> dict[str, Any]:
    """Return the document of a coupling: JSON values only.

    Beside the `solve` document's keys: ``id``, ``problem_file`` (the whole problem), ``table`` (the rows that run),
    ``contact`` (the law at the wall), ``runtime``, ``wall``, ``max_force_n``, ``certificate``, ``trial``, ``versions``
    and ``lacks``.
    """
    wall = coupling.wall
    columns = zip(_TABLE, coupling.table.rows.T, strict=True)
    gains = {key: value for key, value in gain_document(coupling.schedule).items() if key != "state_feedback"}
    return gains | {
        "schema": COUPLING_SCHEMA,
        "id": coupling.id,
        "title": coupling.problem.title,
        "problem_file": problem_document(coupling.problem),
        "structure": coupling.structure,
        "contact": coupling.contact,
        "constant": coupling.table.constant,
        "table": {name: plain(column) for name, column in columns},
        "runtime": coupling.runtime.document(),
        "wall": {"damping_ns_per_m": wall.damping_ns_per_m, "stiffness_n_per_m": wall.stiffness_n_per_m},
        "sample_time_s": coupling.sample_time_s,
        "max_force_n": coupling.max_force_n,
        "certificate": None if coupling.certificate is None else plain(dict(coupling.certificate)),
        "trial": None if coupling.trial is None else plain(dict(coupling.trial)),
        "versions": dict(coupling.versions),
        "lacks": list(coupling.lacks),
    }


def write_coupling(coupling: Coupling, path: str | Path) -> None:
    """Write a coupling file.

    Raises:
        InputError: it is not a coupling.

    Example:
        >>> avc.write_coupling(avc.Coupling.of(avc.load_problem("soft"), avc.solve("soft")), "soft.json")
    """
    require_coupling(coupling)
    with speaking(coupling.problem.units):
        write_file(path, json_text(coupling_document(coupling)))


def read_file(path: str | Path) -> Coupling | GainSchedule:
    """Read a file: a coupling, checked whole; or a table of gains alone, CSV or of release 0.1.0.

    Args:
        path: .json or .csv.

    Raises:
        InputError: with every fault of the file.
    """
    path = Path(path)
    if path.suffix.lower() == ".csv":
        return read_csv(path)
    document = read_document(path)
    if document.get("schema") == TOOL_SCHEMA:
        raise InputError.of(_TO_SIMULATION, file=str(path))
    if document.get("schema") == TELEOPERATOR_SCHEMA:
        raise InputError.of(_TO_FOLLOWER, file=str(path))
    units = units_of_document(document)
    with speaking(units):
        return _read(units.read(document), path)


def _read(document: Mapping[str, Any], path: Path) -> Coupling | GainSchedule:
    if document.get("schema") == COUPLING_SCHEMA or "problem_file" in document:
        return _from_document(document, path)
    return GainCheck(document, path).schedule()


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
    """Make a coupling of a table of gains alone and its problem; it states what it lacks.

    Raises:
        InputError: the table was made for another sample time, or no row has gains.
    """
    check_sample_time(schedule.sample_time_s, problem, file)
    return replace(Coupling.of(problem, schedule), lacks=_LACKS)


def same_problem(one: Problem, other: Problem) -> bool:
    """Return whether two problems are equal but for their names and titles."""
    words = {"name", "title", "source"}
    return one.model_dump(exclude=words) == other.model_dump(exclude=words)


def _from_document(document: Mapping[str, Any], path: Path) -> Coupling:
    faults: list[Fault] = []
    if document.get("schema") != COUPLING_SCHEMA:
        message = f"is {document.get('schema')!r}, but a problem stands in the file; allowed: {COUPLING_SCHEMA!r}"
        faults.append(Fault(str(path), None, "schema", message))
    faults += _unknown(document, (*COUPLING_KEYS, *_BESIDE), path)

    def part(read: Any, *arguments: Any) -> Any:
        try:
            return read(*arguments)
        except InputError as error:
            faults.extend(error.faults)
            return None

    schedule = part(GainCheck(document, path).schedule)
    problem = part(_problem, document, path)
    table = part(_table, document, path)
    runtime = part(_runtime, document, path)
    if problem is not None and schedule is not None:
        part(check_sample_time, schedule.sample_time_s, problem, str(path))
    faults += unsound_tables(document, str(path), ("certificate", "trial", "versions"))
    lacks = document.get("lacks") or []
    if not isinstance(lacks, list) or not all(isinstance(one, str) for one in lacks):
        faults.append(Fault(str(path), None, "lacks", "must be a list of texts"))
    if faults:
        raise InputError(faults)
    found = Coupling(
        problem=problem,
        schedule=replace(schedule, state_feedback=runtime.state_feedback),
        table=table,
        runtime=runtime,
        certificate=document.get("certificate"),
        trial=document.get("trial"),
        versions=document.get("versions") or {},
        lacks=tuple(lacks),
    )
    _check_whole(found, document, path)
    return found


def _check_whole(found: Coupling, document: Mapping[str, Any], path: Path) -> None:
    """Refuse a file that was changed in part: what is certified must be what runs."""
    again = "make it again: avc recommend P --out FILE, or avc solve P --out FILE"
    faults = []
    if document.get("id") != found.id:
        message = f"is {document.get('id')!r}, and what the file holds is {found.id!r}: it was changed since; {again}"
        faults.append(Fault(str(path), None, "id", message))
    beside = GainTable.of(found.schedule)(found.table.frequency_hz)
    if not np.allclose(beside, found.table.gains, rtol=1e-9, atol=0.0):
        faults.append(Fault(str(path), None, "table", f"is not that of the gains beside it; {again}"))
    wall, limit = document.get("wall"), document.get("max_force_n")
    if wall != {"damping_ns_per_m": found.wall.damping_ns_per_m, "stiffness_n_per_m": found.wall.stiffness_n_per_m}:
        faults.append(Fault(str(path), None, "wall", f"is not the environment of problem_file; {again}"))
    if document.get("contact", FIRST_CONTACT) != found.contact:
        faults.append(Fault(str(path), None, "contact", f"is not the law of problem_file and gains; {again}"))
    if limit != found.max_force_n:
        faults.append(
            Fault(str(path), None, "max_force_n", f"is not {spoken_key('device.max_force_n')} of problem_file; {again}")
        )
    if faults:
        raise InputError(faults)


def _unknown(found: Mapping[str, Any], known: Sequence[str], path: Path, table: str = "") -> Iterator[Fault]:
    """Yield a fault for each key that a table of the file does not have."""
    for key in found:
        if key not in known:
            near = difflib.get_close_matches(key[:60], known, n=1)
            allowed = (
                f"did you mean {spoken_key(near[0])!r}?" if near else f"allowed: {', '.join(map(spoken_key, known))}"
            )
            yield Fault(str(path), None, f"{table}{key}", f"is not a known key; {allowed}")


def _problem(document: Mapping[str, Any], path: Path) -> Problem:
    found = document.get("problem_file")
    if not isinstance(found, Mapping):
        raise InputError.of("is missing; allowed: the tables of a problem file", file=str(path), key="problem_file")
    box = found.get("coupling", {})
    if isinstance(box, Mapping):
        found = {**found, "coupling": {"contact": FIRST_CONTACT, **box}}
    return problem_of(found, file=str(path), key="problem_file")


def _table(document: Mapping[str, Any], path: Path) -> GainTable:
    found = document.get("table")
    if not isinstance(found, Mapping):
        raise InputError.of(
            f"is missing; allowed: a table with {', '.join(map(spoken_key, _TABLE))}", file=str(path), key="table"
        )
    unknown = list(_unknown(found, _TABLE, path, "table."))
    if unknown:
        raise InputError(unknown)
    rows = {name: found.get(name) for name in _TABLE} | {"structure": "damped"}
    try:
        return GainTable.of(GainCheck(rows, path).schedule())
    except InputError as error:
        raise InputError([Fault(one.file, one.line, f"table.{one.key}", one.message) for one in error.faults]) from None


def _runtime(document: Mapping[str, Any], path: Path) -> Runtime:
    found = document.get("runtime")
    known = sorted(item.name for item in fields(Runtime))
    if not isinstance(found, Mapping):
        raise InputError.of(f"must be a table with {', '.join(map(spoken_key, known))}", file=str(path), key="runtime")
    kinds: dict[str, tuple[type, ...]] = {
        "estimator": (str,),
        "guard": (str,),
        "passive": (bool,),
        "state_feedback": (Mapping,),
    }
    wrong = [*_unknown(found, known, path, "runtime.")]
    wrong += [
        Fault(str(path), None, f"runtime.{key}", f"is {value!r}, of the wrong type")
        for key, value in found.items()
        if key in known
        and (
            not (value is None or isinstance(value, kinds.get(key, (int, float))))
            or (value is True and key != "passive")
        )
    ]
    if wrong:
        raise InputError(wrong)
    feedback = state_feedback_of(found.get("state_feedback"), path, "runtime.state_feedback")
    try:
        runtime = Runtime(**{**found, "state_feedback": feedback})
        runtime.effects(constant=False)
    except InputError as error:
        raise InputError([Fault(str(path), None, f"runtime.{one.key}", one.message) for one in error.faults]) from None
    except ValidationError as error:  # outside the range of a scene
        faults = [
            Fault(str(path), None, f"runtime.{_RUNTIME_KEYS.get(key, key)}", one["msg"])
            for one in error.errors(include_url=False)
            for key in map(str, one["loc"][-1:])
        ]
        raise InputError(faults) from None
    return runtime
